"""Lessons without robot and haptic device: two people lift the beam, with a force-torque sensor at either handle.

The paper ends with this idea. Two people with the arms and habits of the teleoperated lessons hold the ends of one rigid beam;
the hand at end 1 stands where the robot's hand would be. Exact dynamics, vertical, two degrees of freedom (middle and tilt), each
person with a wrist of stiffness k_w:

    m z_c'' = f_1 + f_2 - m g        (m L^2/12) theta'' = (f_2 - f_1) L/2 - 2 k_w theta - 2 d_w theta'

The sensor at end 1 reads F_s = -f_1, and eq. (3) makes F of it as in every lesson.

The wrists matter: a hand that lets the beam pivot (k_w = 0) feels only its own half, F = (m/6)(z_1'' - z_2''), and a follower has
nothing to follow, and would have to look. k_w of two hands on a handle: some 10 to 300 N m/rad, taken as 100.

What is compared: force patterns, duration, effort, and what a model learned from one kind of lesson predicts of the other.
The people are models, and the same models on both sides: that direct lessons of real dyads look like this is not shown.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import sqrt
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from comanip.evaluation import drawing as figures
from comanip.evaluation.claims import Claim, at_least, at_most
from comanip.evaluation.metrics import effort
from comanip.evaluation.prediction import overall, predict
from comanip.experiments.readings import script
from comanip.interaction import Payload
from comanip.interfaces import STANDARD_GRAVITY, Array, Command, Observation, Partner
from comanip.learned.learn import learn
from comanip.lessons.demonstration import Demonstration, demonstrations
from comanip.loop import run as run_loop
from comanip.people.partners import HumanFollower, HumanLeader, HumanSharing, Plan, dyad
from comanip.plants.beam import Beam, WristSensor
from comanip.recording import Recording
from comanip.signals.second_order import second_order_step
from comanip.tasks import named
from comanip.teaching import SCENARIOS, Habits, teach

RATE_HZ = 100.0
LEARNED, HELD_OUT = 6, 6
KINDS = ("teleoperated", "direct")
WRIST_NM_PER_RAD = 100.0
WRISTS = (0.0, 10.0, 100.0, 1000.0)  # [N m/rad]


class TwoHands:
    """Two people on one rigid beam, as a plant that nobody commands: the observation is end 1's.

    wrist_nm_per_rad   k_w of each person; damping ratio of the beam on both wrists 0.5
    """

    axes: tuple[str, ...] = ("z",)

    def __init__(
        self,
        one: Partner,
        other: Partner,
        *,
        beam: Beam,
        wrist_nm_per_rad: float,
        sensor: WristSensor,
        dt: float,
        start_m: float,
        rng: np.random.Generator,
    ) -> None:
        self.one, self.other, self.beam, self.sensor, self.dt = one, other, beam, sensor, dt
        self._start, self._rng = start_m, rng
        self._inertia = beam.mass_kg * beam.length_m**2 / 12.0
        self._k = 2.0 * wrist_nm_per_rad
        self._d = sqrt(self._k * self._inertia)
        self._tilting = second_order_step(self._k / self._inertia, self._d / self._inertia, dt)
        self._f1, self._f2, self._true, self._tilt = np.zeros(1), np.zeros(1), np.zeros(1), np.zeros(1)
        self._far, self._a1 = np.zeros(1), np.zeros(1)
        self.reset()

    @property
    def stop_reason(self) -> str:
        return "" if np.isfinite(self.z).all() else "the beam's state is not finite"

    @property
    def channels(self) -> Mapping[str, tuple[Array, str]]:
        return {
            "partner.force": (self._f2, "N"),
            "partner.position": (self._far, "m"),
            "beam.tilt": (self._tilt, "rad"),
            "hand.acceleration": (self._a1, "m/s^2"),
            "hand.true_force": (self._true, "N"),
        }

    def reset(self) -> None:
        self.time = 0.0
        self.middle, self.rise, self.tilt, self.turn = self._start, 0.0, 0.0, 0.0
        self.z, self.v = np.full(2, self._start), np.zeros(2)
        self._f1[:] = self._f2[:] = 0.5 * self.beam.mass_kg * STANDARD_GRAVITY
        self._a1[:] = 0.0
        self.one.reset(self.z[:1].copy())
        self.other.reset(self.z[1:].copy())

    def read(self, obs: Observation) -> None:
        obs.time, obs.position[0], obs.velocity[0] = self.time, self.z[0], self.v[0]
        obs.sensor_force[0] = -self._f1[0] + self.sensor.noise_n * self._rng.standard_normal()
        self._far[0], self._tilt[0] = self.z[1], self.tilt
        self._true[0] = -self._f1[0] + 0.5 * self.beam.mass_kg * (STANDARD_GRAVITY + self._a1[0])

    def write(self, command: Command) -> None:
        pass

    def advance(self) -> None:
        """Exact for forces that are held over the period."""
        h = self.dt
        self.one.force(self.time, self.z[:1], self.v[:1], self._f1)
        self.other.force(self.time, self.z[1:], self.v[1:], self._f2)
        f1, f2, half = float(self._f1[0]), float(self._f2[0]), 0.5 * self.beam.length_m
        up = (f1 + f2) / self.beam.mass_kg - STANDARD_GRAVITY
        pull = (f2 - f1) * half / self._inertia
        turning = pull - (self._k * self.tilt + self._d * self.turn) / self._inertia
        self._a1[0] = up - half * turning
        self.middle += h * self.rise + 0.5 * h * h * up
        self.rise += h * up
        one, tilt, turn = self._tilting, self.tilt, self.turn
        self.tilt = one.yy * tilt + one.yv * turn + one.yu * pull
        self.turn = one.vy * tilt + one.vv * turn + one.vu * pull
        self.z[:] = self.middle - half * self.tilt, self.middle + half * self.tilt
        self.v[:] = self.rise - half * self.turn, self.rise + half * self.turn
        self.time += h


class Nobody:
    """The skill of a robot that is not there."""

    stop_reason = notice = ""
    diagnostics: Mapping[str, Array] = {}

    def reset(self, obs: Observation) -> None:
        pass

    def step(self, obs: Observation, command: Command) -> None:
        command.position[:] = obs.position
        command.velocity[:] = obs.velocity


def record(
    role: str,
    lessons: int,
    rng: np.random.Generator,
    *,
    wrist_nm_per_rad: float = WRIST_NM_PER_RAD,
    habits: Habits = Habits(),
    beam: Beam = Beam(),
) -> list[Recording]:
    """Direct lessons; `role` is what the person at end 1 does. Lifts are drawn as in `comanip.teaching.teach`."""
    recordings = []
    for number in range(lessons):
        share = 0.5 * beam.mass_kg
        drawn = Plan(
            lift_m=float(rng.normal(*habits.lift_m)),
            duration_s=max(habits.shortest_s, float(rng.normal(*habits.duration_s))),
            onset_s=float(rng.uniform(*habits.onset_s)),
            feedforward_kg=share,
        )
        one, other = _people(role, drawn, habits, share * STANDARD_GRAVITY, rng)
        plant = TwoHands(
            one,
            other,
            beam=beam,
            wrist_nm_per_rad=wrist_nm_per_rad,
            sensor=WristSensor(),
            dt=0.001,
            start_m=float(named("lift").start[0]),
            rng=rng,
        )
        metadata = {
            "role": role,
            "name": f"direct {role} {number + 1}",
            "load_mass_kg": beam.mass_kg,
            "lift_m": drawn.lift_m,
            "duration_s": drawn.duration_s,
            "onset_s": drawn.onset_s,
        }
        duration = drawn.onset_s + drawn.duration_s + habits.after_s
        recordings.append(run_loop(plant, Nobody(), duration_s=duration, metadata=metadata))
    return recordings


def _people(role: str, drawn: Plan, habits: Habits, carried: float, rng: np.random.Generator) -> tuple[Partner, Partner]:
    leading, following = (replace(dyad(rng, a), carried_n=carried) for a in (habits.leading_arm, habits.following_arm))
    if role == "natural":
        ideas = [
            replace(
                drawn,
                lift_m=drawn.lift_m + habits.lift_apart_m * rng.normal(),
                duration_s=drawn.duration_s * (1.0 + habits.duration_apart * rng.normal()),
                onset_s=max(0.0, drawn.onset_s + habits.onset_apart_s * rng.normal()),
            )
            for _ in range(2)
        ]
        return HumanSharing(ideas[0], habits.yielding, leading, rng=rng), HumanSharing(
            ideas[1], habits.yielding, replace(dyad(rng, habits.leading_arm), carried_n=carried), rng=rng
        )
    leader, follower = HumanLeader(drawn, leading, rng=rng), HumanFollower(habits.yielding, following, rng=rng)
    return (leader, follower) if role == "leader" else (follower, leader)


class Pattern(NamedTuple):
    """Of one lesson: mean F in the first third of the lift, cosine of F and velocity over all of it, and so on."""

    first_third_n: float
    cosine: float
    effort_n2s: float
    peak_n: float
    lift_s: float
    peak_speed_m_per_s: float


def pattern(lesson: Demonstration) -> Pattern:
    z, force, speed = lesson.position[:, 0], lesson.force[:, 0], lesson.velocity[:, 0]
    risen = (z - z[0]) / (z[-1] - z[0])
    first, last = int(np.argmax(risen > 0.02)), int(np.argmax(risen > 0.98))
    third = first + (last - first) // 3
    norm = float(np.sqrt((force @ force) * (speed @ speed)))
    return Pattern(
        first_third_n=float(force[first:third].mean()),
        cosine=float(force @ speed / norm),
        effort_n2s=effort(force, lesson.dt),
        peak_n=float(np.abs(force).max()),
        lift_s=(last - first) * lesson.dt,
        peak_speed_m_per_s=float(np.abs(speed).max()),
    )


class Numbers(NamedTuple):
    """By (kind, role): lessons and patterns. By (learned from, predicted, role): means of `evaluation.prediction`."""

    lessons: dict[tuple[str, str], tuple[Demonstration, ...]]
    patterns: dict[tuple[str, str], list[Pattern]]
    predicted: dict[tuple[str, str, str], dict[str, float]]
    wrists: dict[tuple[float, str], tuple[float, float]]  # by (k_w, role): mean effort [N^2 s], largest tilt [deg]


def numbers(seed: int) -> Numbers:
    n = LEARNED + HELD_OUT
    lessons: dict[tuple[str, str], tuple[Demonstration, ...]] = {}
    for i, role in enumerate(SCENARIOS):
        taught = teach(role, n, rng=np.random.default_rng([seed, 9, i]))
        named = [x.with_metadata(name=f"teleoperated {role} {k + 1}") for k, x in enumerate(taught)]
        direct = record(role, n, np.random.default_rng([seed, 9, i]))
        for kind, recordings in zip(KINDS, (named, direct), strict=True):
            lessons[kind, role] = demonstrations(recordings, rate_hz=RATE_HZ, payload=Payload(Beam().mass_kg))
    patterns = {key: [pattern(x) for x in several] for key, several in lessons.items()}
    predicted = {}
    for role in SCENARIOS:
        for source in KINDS:
            model = learn(lessons[source, role][:LEARNED], role=role)
            for target in KINDS:
                predicted[source, target, role] = overall([predict(model, x) for x in lessons[target, role][LEARNED:]])
    return Numbers(lessons, patterns, predicted, {(k, role): _with_wrist(k, role, seed) for k in WRISTS for role in SCENARIOS})


def _with_wrist(wrist: float, role: str, seed: int) -> tuple[float, float]:
    recordings = record(role, 3, np.random.default_rng([seed, 10]), wrist_nm_per_rad=wrist)
    tilt = max(float(np.abs(r["beam.tilt"].values).max()) for r in recordings)
    return float(np.mean([effort(r["hand.true_force"].values, 0.001) for r in recordings])), float(np.degrees(tilt))


def mean(found: Numbers, kind: str, role: str, name: str) -> float:
    return float(np.mean([getattr(p, name) for p in found.patterns[kind, role]]))


def claims(found: Numbers) -> list[Claim]:
    def thirds(role: str, sign: float) -> float:
        return min(sign * p.first_third_n for kind in KINDS for p in found.patterns[kind, role])

    told = ("leader", "follower")
    rmse = {key: value["one_step_velocity_rmse"] for key, value in found.predicted.items()}
    return [
        at_least(
            "both kinds: F < 0 in the first third when end 1 leads, least of all lessons",
            thirds("leader", -1.0),
            0.0,
            unit="N",
            refuted_by="a lesson with the other sign",
        ),
        at_least(
            "both kinds: F > 0 in the first third when end 1 follows, least of all lessons",
            thirds("follower", 1.0),
            0.0,
            unit="N",
            refuted_by="a lesson with the other sign",
        ),
        at_most(
            "following over a handle costs more: effort direct over teleoperated, robot's side follows",
            mean(found, "direct", "follower", "effort_n2s") / mean(found, "teleoperated", "follower", "effort_n2s"),
            0.7,
            refuted_by="direct lessons that cost their partners as much",
        ),
        at_most(
            "natural lessons show no role: largest |cosine| over that of told roles, means",
            max(abs(mean(found, k, "natural", "cosine")) for k in KINDS)
            / min(abs(mean(found, k, r, "cosine")) for k in KINDS for r in told),
            0.5,
            refuted_by="natural lessons that look like a role",
        ),
        at_most(
            "hands that let the beam pivot feel nothing of each other: effort with k_w = 0 over k_w = 100, told roles",
            max(found.wrists[0.0, r][0] / found.wrists[WRIST_NM_PER_RAD, r][0] for r in told),
            0.05,
            refuted_by="force between two people that needs no wrist",
        ),
        at_least(
            "each kind is predicted better by its own: smallest (other's rmse over own), told roles",
            min(rmse[KINDS[1 - i], k, r] / rmse[k, k, r] for i, k in enumerate(KINDS) for r in told),
            1.0,
            refuted_by="a kind that the other's model predicts better than its own",
        ),
    ]


def table(found: Numbers) -> str:
    lines = []
    for role in SCENARIOS:
        for kind in KINDS:
            values = " ".join(f"{name} {mean(found, kind, role, name):.3g}" for name in Pattern._fields)
            lines.append(f"{role}, {kind}: {values}")
        for source in KINDS:
            for target in KINDS:
                p = found.predicted[source, target, role]
                lines.append(
                    f"{role}, learned {source}, predicts {target}: one-step R2 {p['one_step_velocity_r2']:.3f}, "
                    f"rmse {100 * p['one_step_velocity_rmse']:.2f} cm/s, free run {100 * p['free_run_position_rmse_m']:.1f} cm, "
                    f"end {100 * p['free_run_end_error_m']:.1f} cm"
                )
    for (wrist, role), (cost, tilt) in found.wrists.items():
        lines.append(f"k_w {wrist:g} N m/rad, {role}: effort {cost:.3g} N^2 s, tilt up to {tilt:.2g} deg")
    return "\n".join(lines)


def draw(found: Numbers) -> Any:
    caption = (
        "Lessons over a haptic handle (top) and of two people directly on the beam (bottom), against the time since the lift's "
        f"onset, {LEARNED + HELD_OUT} a kind; F is eq. (3) from the sensor at end 1. Dark: that end leads; orange, dashed: it "
        "follows; grey: nobody was told. Refuted if a dark and an orange curve have the same sign in the first third of the lift."
    )
    with figures.taste():
        figure = figures.blank(7.4, 4.6, caption=caption)
        grid = figure.subplots(2, 3, sharex="col", sharey="col")
        for row, kind in zip(grid, KINDS, strict=True):
            _row(row, found, kind)
    return figure


def _row(row: Any, found: Numbers, kind: str) -> None:
    style = {**figures.ROLE_STYLE, "natural": {"color": figures.ASH, "linestyle": "-"}}
    for role in ("natural", "follower", "leader"):
        for lesson in found.lessons[kind, role]:
            first = int(np.argmax(lesson.position[:, 0] - lesson.position[0, 0] > 0.006))
            t = (np.arange(len(lesson)) - first) * lesson.dt
            for ax, values in zip(row, (lesson.force, lesson.velocity), strict=False):
                ax.plot(t, values[:, 0], linewidth=0.7, **style[role])
            row[2].plot(lesson.velocity[:, 0], lesson.force[:, 0], linewidth=0.7, **style[role])
    figures.label(row[0], "time since onset [s]", "F [N]", kind)
    figures.label(row[1], "time since onset [s]", "velocity [m/s]", "")
    figures.label(row[2], "velocity [m/s]", "F [N]", "")


def run(out: Path, *, seed: int = 0) -> list[Claim]:
    found = numbers(seed)
    print(table(found))
    figures.save(draw(found), out / "direct_recording.png")
    return claims(found)


if __name__ == "__main__":
    script(run)
