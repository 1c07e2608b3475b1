"""One episode: the run that `comanip trial` makes of a case, one tick at a time, with what it is worth and the judge's verdict.

The reward is the sum of its parts, which are in `info["parts"]`, each tick:

    place    -dt min(|x - x_meant| / size, 1)      x_meant: where a partner who leads means to be now, or where lessons ended
    effort   -dt min(|F|^2 / (5 N)^2, 1)           F: the true interaction force
    rough    -dt min(|dv/dt|^2 / (2 m/s^2)^2, 1)   v: what was sent to the robot
    end      +10 where the judge calls the run a success; -3 a second that is left where it stops a lost one early

so nothing is gained by losing early. The score counts the judge's verdict alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot, inf, radians
from typing import Any, NamedTuple

import numpy as np

from ..interfaces import Array, Partner, Skill
from ..learned.skill import LearnedSkill
from ..loop import Stepper
from ..parts import PLANTS, known
from ..people.kinds import kind_of
from ..recording import Recording
from ..reproduction import enveloped
from ..tasks import Task, named
from ..trials.cases import TASK, Case, partner_of
from ..trials.foreign import stated_by
from ..trials.judging import DIVERGED, MOVED_M, Bounds, Verdict, bounds, end_error, judge, partners_goal
from ..trials.people import USUAL, criteria_of, judged, person_of
from ..trials.running import clearance, estimator_for, plant_for, told_goal
from ..trials.sight import Seen, Sight, Told
from ..trials.taught import kept
from .asked import check_case, settings
from .draw import MISBEHAVING, kinds

EFFORT_N, ROUGH_M_PER_S2 = 5.0, 2.0  # at which a part costs 1 a second
SUCCESS, LOST = 10.0, -3.0  # once; a second that is left
STANDS_M_PER_S, NEAR_M = 1e-4, 1e-3  # slower is at rest; so much beyond the judge's bound a resting hand has missed for certain
LEAST_ROWS = 20  # of fewer no force can be smoothed: why it stopped is all that is said


@dataclass(frozen=True)
class Setting:
    """What all episodes of an environment share; the arguments of `comanip/Carry-v0`.

    task         of `comanip tasks` that can be run, or your own .toml
    role         what the robot is told: "leader", "follower", "auto" (nothing)
    people       "usual" (judged as `comanip trial` does), or "tuning", "judging", "all", kinds of people (as `--people` does)
    misbehaving  share of the usual people who hesitate, reverse, block, let go or change role
    plant        "beam", exact and fast, or "humanoid"
    history      how many ticks are seen; action: "velocity" or "acceleration" (`trials.sight`)
    envelope     whether the safety envelope stands between policy and robot, as in every trial
    ends_early   stops a run that the judge can only call lost: moved before the partner, did not start in time, not level
    """

    task: Task
    role: str = "follower"
    people: tuple[str, ...] = (USUAL,)
    misbehaving: float = MISBEHAVING
    plant: str = "beam"
    history: int = 1
    action: str = "velocity"
    envelope: bool = True
    ends_early: bool = True
    by_kind: bool = False
    dt: float = 0.01

    @classmethod
    def of(cls, task: Any = TASK, role: str = "follower", people: Any = USUAL, **more: Any) -> Setting:
        """From what somebody types. Raises ParameterError that lists what there is."""
        what = named(task).in_arcs().runnable()
        known("plant", more.get("plant", "beam"), PLANTS)
        by_kind = people not in (USUAL, (USUAL,), [USUAL])
        asked = settings(cls, more, ("task", "role", "people", "by_kind"))
        made = cls(task=what, role=role, people=kinds(people, role), by_kind=by_kind, **asked)
        assert made.seen
        return made

    @property
    def seen(self) -> Seen:
        """What a policy sees and says here."""
        told = self.role == "leader" and len(self.task.goals) >= 2
        return Seen(len(self.task.axes), self.history, told, self.action)

    def learned(self) -> Mapping[str, LearnedSkill]:
        """What lessons taught, where judge or partners ask for it: ends, obstacles, and skills of partners who are robots."""
        robots = any(kind != USUAL and kind_of(kind).robot for kind in self.people)
        if robots or self.task.obstacles:
            natural = ("natural",) if robots and self.role == "auto" else ()
            return kept(self.task, ("leader", "follower", *natural))
        return kept(self.task, ("leader",)) if self.role != "follower" else {}


class Parts(NamedTuple):
    """Of the reward."""

    place: float = 0.0
    effort: float = 0.0
    rough: float = 0.0
    end: float = 0.0


class Episode:
    """One run of one case. `tick` until `over`; then `verdict` is what `comanip trial` would say.

    brain   what decides within the envelope; default `Told`, whom the caller tells
    """

    def __init__(
        self,
        setting: Setting,
        case: Case,
        learned: Mapping[str, LearnedSkill],
        *,
        partner: Partner | None = None,
        brain: Skill | None = None,
    ) -> None:
        check_case(case, setting)
        self.setting, self.case, self.learned = setting, case, learned
        rng = np.random.default_rng(case.seed)
        made = partner_of(case, rng) if not case.kind else None
        self.person = partner or made or person_of(case, rng, learned, setting.dt)
        self.told = brain if isinstance(brain, Told) else Told(setting.seen, dt=setting.dt)
        axes, inner = case.axes, brain or self.told
        skill = enveloped(inner, axes=axes, dt=setting.dt) if setting.envelope else inner
        plant = plant_for(setting.plant, self.person, case, setting.dt, rng)
        self.loop = Stepper(plant, skill, estimator_for(case, setting.dt), most_s=case.run_s)
        self.skill, self.stated = skill, stated_by(self.person)
        self.sight = Sight(setting.seen, told_goal(case))
        self.seen = self.sight.begin(self.loop.obs)
        self.ticks, self.most = 0, max(1, round(case.run_s / setting.dt))
        self.over, self.reason = False, ""
        self.verdict: Verdict | None = None
        self._prepare()

    def _prepare(self) -> None:
        """What each tick asks again."""
        case, setting = self.case, self.setting
        self.within: Bounds = criteria_of(case).within if setting.by_kind else bounds(case)
        self.onset_s = float(self.stated.get("onset_s", case.onset_s))
        self.start, self.tilt_rad = case.start_m.tolist(), radians(self.within.tilt_deg)
        self.size_m = max(case.task.size_m, 1e-3)
        # a partner who leads means to be somewhere at each moment; with one who follows, the lessons' end counts
        times: Array = np.arange(1.0, self.most + 2.0) * setting.dt
        self.meant = (case.start_m + case.course.sampled(times) if case.leads else self.taught_end()[None]).tolist()
        self._truth = self.loop.plant.channels["hand.true_force"][0]
        self._tilts = self.loop.plant.channels["beam.tilt"][0]
        self.sent = [0.0] * len(case.axes)
        self.moved = False

    def taught_end(self) -> Array:
        """(d,) [m] where lessons ended on average, of the goal that is led to."""
        goal = told_goal(self.case)
        if goal is not None:
            return goal
        if "leader" in self.learned:
            return np.asarray(self.learned["leader"].ends.mean(axis=0))
        return np.asarray(self.case.start_m + self.case.way.course.end)

    @property
    def time_s(self) -> float:
        """Of the run that has passed [s]."""
        return self.ticks * self.setting.dt

    @property
    def mode(self) -> str:
        """Of the envelope: "RUN", "COMPLY" or "HOLD"; always "RUN" without one."""
        return str(getattr(self.skill, "mode", "RUN"))

    def tick(self) -> Parts:
        """One control period under what was told last; the parts of its reward. After the last one `over` is True."""
        return self.after(self.loop.act())

    def after(self, reason: str) -> Parts:
        """What is left of a tick when the command was sent."""
        self.ticks += 1
        if not reason and self.ticks < self.most:
            self.loop.advance()
            self.seen = self.sight.look(self.loop.obs)
            reason = self.lost() if self.setting.ends_early else ""
        return self.worth(reason)

    def worth(self, reason: str = "") -> Parts:
        """The parts of this tick's reward; `reason`: why the run stops here, before its time."""
        dt, obs, sent = self.setting.dt, self.loop.obs.position.tolist(), self.loop.command.velocity.tolist()
        meant = self.meant[min(self.ticks, len(self.meant)) - 1]
        apart = hypot(*[x - m for x, m in zip(obs, meant, strict=True)]) / self.size_m
        force = hypot(*self._truth.tolist()) / EFFORT_N
        change = hypot(*[v - w for v, w in zip(sent, self.sent, strict=True)]) / dt / ROUGH_M_PER_S2
        self.sent, end = sent, 0.0
        if reason or self.ticks >= self.most:
            end = self.finish(reason)
        return Parts(-dt * least(apart, 1.0), -dt * least(force * force, 1.0), -dt * least(change * change, 1.0), end)

    def lost(self) -> str:
        """Why the judge can only call this run lost already; empty where it is open."""
        gone = hypot(*[x - s for x, s in zip(self.loop.obs.position.tolist(), self.start, strict=True)])
        if not gone < inf or self.loop.plant.stop_reason:
            return "diverged"
        if gone > MOVED_M:
            if self.within.waits and not self.moved and self.loop.obs.time < self.onset_s:
                return "moved before the partner"
            self.moved = True
        elif not self.moved and self.time_s > self.within.starts_by_s:
            return "did not start in time"
        if hypot(*self._tilts.tolist()) > self.tilt_rad:
            return "beam not level"
        return self._stopped_short() if self.mode == "HOLD" else ""

    def _stopped_short(self) -> str:
        """A fault of the envelope lasts until somebody re-arms, and nobody does here: a hand that stands elsewhere has missed."""
        within, obs = self.within, self.loop.obs
        stands = not self.skill.passes and hypot(*self.sent, *obs.velocity.tolist()) < STANDS_M_PER_S  # type: ignore[attr-defined]
        if not stands or not within.goal:
            return ""
        ends = self.learned["leader"].ends if "leader" in self.learned else None
        goal = self.stated.get("goal_m", partners_goal(self.case))
        off = end_error(self.case, within, goal, obs.position - self.case.start_m, ends)
        if not off > within.end_m + NEAR_M:
            return ""
        return "missed the partner's goal" if within.goal == "partner's" else f"missed the taught {self.case.task.end_is}"

    def finish(self, reason: str) -> float:
        """The verdict, and what the end is worth."""
        if reason and self.ticks < self.most:
            self._last_row()
        self.over, self.reason = True, reason
        self.verdict = verdict = self.judged()
        if verdict.success:
            return SUCCESS
        return LOST * self.setting.dt * (self.most - self.ticks)

    def _last_row(self) -> None:
        """What ended the run is in its recording."""
        self.loop.act()

    def recording(self) -> Recording:
        """The run so far, as `comanip trial` records it."""
        about = {"role": self.case.role, "task": self.case.task.name, "partner": self.case.about(), "plant": self.setting.plant}
        about |= {"stated": self.stated} if self.stated else {}
        return self.loop.recording(about | {"stop_reason": self.reason or "duration"})

    def judged(self) -> Verdict:
        """By the criteria of `comanip trial`, or, with kinds of people, of `comanip trial --people`."""
        recording = self.recording()
        if len(recording["hand.position"].time) < LEAST_ROWS:
            return DIVERGED._replace(failures=(self.reason or "diverged",))
        ends = self.learned["leader"].ends if "leader" in self.learned else None
        about: dict[str, Any] = {"taught_ends_m": ends, "lessons_clearance_m": clearance(self.learned)}
        with np.errstate(all="ignore"):  # a policy that diverges is a verdict, not a warning
            if self.setting.by_kind:
                met = judged(self.case, recording, **about)
                return met.verdict._replace(failures=met.failures)
            return judge(self.case, recording, **about)


def least(value: float, most: float) -> float:
    """`value`, at most `most`; NaN is the most."""
    return value if value < most else most
