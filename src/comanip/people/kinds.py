"""The kinds of people: one row each, with its source and whether defaults may be chosen on it.

A kind is put together of a plan (what it makes of the course), a body (what it changes in the drawn one), a mind (what moves the
hand, by role) and habits. A new kind is one row.

Two halves, drawn apart once and for all: numbers of this package may be chosen on the `tuning` kinds only, and results are
reported on the `judging` ones. The rows stand in families (how it is timed, what pulls, what the body is, what it does besides,
what it does wrong, how it follows); each family is split evenly, so both halves hold easy and hard ones of each.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from typing import Any

import numpy as np

from ..errors import ParameterError, check_generator
from ..interfaces import Partner
from ..parts import known, unknown
from . import habits as h
from . import minds as m
from . import plans
from .body import Body
from .intent import Course
from .lqg import Optimal
from .person import Person, Together

TUNING, JUDGING = "tuning", "judging"
LEADING, FOLLOWING = "leading", "following"
BOTH, LEADS, FOLLOWS = (LEADING, FOLLOWING), (LEADING,), (FOLLOWING,)
GROUPS = ("usual", TUNING, JUDGING, "all")


@dataclass(frozen=True)
class Kind:
    """One row.

    source     where people like this, or the numbers, come from
    split      "tuning" or "judging"
    roles      what it can play: "leading", "following"
    plan, body, minds, habits   what it is made of; a role without a mind gets the usual one
    behaviour  what the judge calls it (`trials.MISBEHAVIOURS`), "steady" for somebody who behaves
    criteria   bounds that replace the usual ones where the kind itself cannot keep those: fields of `trials.Bounds`, vibration_n
               [N rms], time_s (how long the motion may last)
    """

    about: str
    source: str
    split: str
    roles: tuple[str, ...] = BOTH
    plan: Callable[[Course, np.random.Generator], Course] = plans.as_told
    body: Callable[[Body, np.random.Generator], Body] = lambda body, rng: body
    minds: Mapping[str, type[m.Mind]] = field(default_factory=dict)
    habits: tuple[type[h.Habit], ...] = ()
    people: int = 1
    robot: str = ""  # another robot instead of a person: "told" its role, or "untold"
    behaviour: str = "steady"
    criteria: Mapping[str, float] = field(default_factory=dict)


class ExpectsSixKilograms(Optimal):
    """The same, for an object that it takes to be heavy."""

    believes_kg = 6.0


def _child(body: Body, rng: np.random.Generator) -> Body:
    weak = replace(body, arm_kg=0.5, force_limit_n=max(15.0, 1.25 * sum(map(abs, body.carried_n))), delay_s=0.12, relative=0.06)
    return weak.stiffened(float(rng.uniform(60.0, 150.0)))


def _strong(body: Body, rng: np.random.Generator) -> Body:
    return replace(body, force_limit_n=150.0).stiffened(1500.0)


def _braced(body: Body, rng: np.random.Generator) -> Body:
    return body.stiffened(body.stiffness_n_per_m, 0.15)


def _shaking(newtons: float, low_hz: float, high_hz: float) -> Callable[[Body, np.random.Generator], Body]:
    return lambda body, rng: replace(body, tremor_n=newtons, tremor_hz=float(rng.uniform(low_hz, high_hz)))


def _heavy_arm(body: Body, rng: np.random.Generator) -> Body:
    return replace(body, arm_kg=2.5, grip_n_per_m=4000.0, grip_ns_per_m=60.0).stiffened(body.stiffness_n_per_m, body.ratio)


def _loose(body: Body, rng: np.random.Generator) -> Body:
    return replace(body, grip_n_per_m=1000.0, grip_ns_per_m=8.0)


def _quick(body: Body, rng: np.random.Generator) -> Body:
    return replace(body, delay_s=0.03, reaction_s=0.15)


HARD = {"peak_n": 25.0, "vibration_n": 2.0}
KINDS: dict[str, Kind] = {
    # ---- how it is timed
    "plain": Kind("minimum jerk or yielding, with an arm", "Flash and Hogan 1985; Reed and Peshkin 2008", TUNING),
    "even speed": Kind("one speed, short ramps", "Milner and Ijaz 1990: guided, accurate moves", JUDGING,
                       LEADS, plans.even_speed),
    "quick start": Kind("fast first, long approach", "MacKenzie et al. 1987: precision", TUNING, LEADS, plans.quick_start),
    "asymmetric": Kind("top speed early or late", "Nagasaki 1989", JUDGING, LEADS, plans.asymmetric),
    "two sub-movements": Kind("a first move and a second over its end", "Novak et al. 2002", TUNING,
                              LEADS, plans.two_submovements),
    "ratchets": Kind("stop and go, 3-5 strokes", "Hogan and Sternad 2012", JUDGING, LEADS, plans.ratchet,
                     criteria={"time_s": inf, "vibration_n": 1.0}),
    "snatches": Kind("all of it in 0.6-0.9 s", "Fitts 1954: fast aims", TUNING, LEADS, plans.snatch,
                     criteria=HARD | {"tilt_deg": 4.0}),
    "crawls": Kind("2.5 cm/s", "Doeringer and Hogan 1998", JUDGING, LEADS, plans.crawl, criteria={"time_s": inf}),
    "starts late": Kind("begins after 7.5-12 s", "assumed: was not ready", TUNING, LEADS, plans.late),
    "fine-tunes": Kind("2-3 small moves about the goal", "Meyer et al. 1988", JUDGING, LEADS, plans.fine_tune),
    "corrects": Kind("falls short, sees it, corrects", "Meyer et al. 1988; Woodworth 1899", TUNING, LEADS,
                     minds={LEADING: m.Corrects}, criteria={"time_s": inf}),
    # ---- what pulls
    "optimal feedback": Kind("LQG, 120-200 ms late", "Todorov and Jordan 2002", TUNING, LEADS, minds={LEADING: Optimal}),
    "optimal, expects 6 kg": Kind("the same, for a heavy object", "Gordon et al. 1991", JUDGING, LEADS,
                                  minds={LEADING: ExpectsSixKilograms}),
    "Hill muscles": Kind("a muscle pair under a stretch reflex", "Hill 1938; Feldman 1986", JUDGING, LEADS,
                         minds={LEADING: m.SpringsByMuscle}),
    "reflexes": Kind("half of the stiffness 40 ms late", "Nichols and Houk 1976", TUNING, LEADS, minds={LEADING: m.Reflexes}),
    "pushes by Weber": Kind("no stiffness; changes a push by a tenth", "Weber; Jones 1989", TUNING, LEADS,
                            minds={LEADING: m.PushesByWeber}, criteria={"end_m": 0.05, "time_s": inf}),
    "pushes by eye": Kind("no stiffness, up to 8 N, late", "Miall et al. 1993", JUDGING, LEADS,
                          minds={LEADING: m.PushesByEye}, criteria={"end_m": 0.05, "time_s": inf}),
    "stiffens": Kind("three times as stiff while it moves", "Osu et al. 2002", JUDGING, LEADS, minds={LEADING: m.Stiffens}),
    "gives way": Kind("a plan, and yields to what it did not expect", "Reed and Peshkin 2008", TUNING, LEADS,
                      body=lambda body, rng: body.steady(), minds={LEADING: m.Shares}, criteria={"end_m": inf}),
    # ---- what the body is
    "strong": Kind("1,500 N/m", "Milner 2002: co-contraction", TUNING, LEADS, body=_strong),
    "braced": Kind("damping ratio 0.15", "Perreault et al. 2004", JUDGING, LEADS, body=_braced),
    "heavy arm": Kind("2.5 kg on a firm grip", "Dolan et al. 1993", TUNING, BOTH, body=_heavy_arm),
    "loose grip": Kind("1 kN/m, hardly damped", "Kuchenbecker et al. 2003", JUDGING, BOTH, body=_loose),
    "tremor": Kind("2 N at 4-6 Hz", "Elble and Koller 1990", JUDGING, BOTH, body=_shaking(2.0, 4.0, 6.0),
                   criteria={"vibration_n": 2.2, "ripple_m_per_s": 0.06, "residual_n": 6.0}),
    "trembles": Kind("0.6 N at 5 Hz, as an old hand", "Elble 2000", TUNING, BOTH, body=_shaking(0.6, 4.5, 5.5),
                     criteria={"vibration_n": 1.2, "ripple_m_per_s": 0.025}),
    "child": Kind("weak (15 N), light, soft", "Forssberg et al. 1991", JUDGING, BOTH, body=_child),
    "quick": Kind("answers a pull within 30 ms", "Pruszynski et al. 2011: long-latency reflex", TUNING, FOLLOWS, body=_quick),
    # ---- what it does besides
    "sways": Kind("0.3-0.5 Hz, 3-8 mm", "Winter 1995", TUNING, BOTH, habits=(h.Sways,),
                  criteria={"ripple_m_per_s": 0.03, "end_m": 0.04, "residual_n": 5.0, "time_s": inf}),
    "walks": Kind("bobs 4-10 mm at 2 Hz as it goes", "Gard et al. 2004", JUDGING, BOTH, habits=(h.Walks,),
                  criteria={"peak_n": 25.0, "vibration_n": 1.5, "residual_n": 6.0}),
    "steps on the spot": Kind("3-6 mm at 1.3-1.8 Hz for 2 s", "Winter 1995: weight shift", TUNING, BOTH, habits=(h.Steps,),
                              criteria={"peak_n": 25.0, "vibration_n": 1.2}),
    "coughs": Kind("4-9 N for 0.15-0.3 s, 1-3 times", "assumed: a jerk of the trunk", TUNING, BOTH,
                   habits=(h.Coughs,), criteria=HARD),
    "knocks": Kind("8-16 N for 30-60 ms", "assumed: bumps against it", JUDGING, BOTH, habits=(h.Knocks,), criteria=HARD),
    "rests an elbow": Kind("1-2.5 N of forearm on it as it moves", "de Leva 1996: forearm", JUDGING, BOTH,
                           habits=(h.RestsElbow,)),
    "tires": Kind("carries 8-20 % less after 10 s, trembles", "Enoka and Duchateau 2008", TUNING, BOTH, habits=(h.Tires,),
                  criteria={"residual_n": 5.0, "end_m": 0.05, "vibration_n": 1.0}),
    "two people": Kind("two at one end, not quite together", "Groten et al. 2009", JUDGING, BOTH, people=2),
    # ---- what it does wrong
    "hesitates": Kind("stops for 0.8-2.5 s on the way", "assumed: a change of mind", TUNING, LEADS, plans.hesitate,
                      criteria={"peak_n": 25.0, "time_s": inf}),
    "reverses": Kind("turns back and puts it where it was", "assumed: a change of mind", JUDGING, LEADS, plans.reverse,
                     behaviour="reverses", criteria={"time_s": inf}),
    "re-grasps": Kind("opens the hand for 0.1-0.5 s", "Johansson and Westling 1984", TUNING, BOTH, habits=(h.ReGrasps,),
                      criteria={"peak_n": 25.0, "tilt_deg": 5.0, "vibration_n": 3.0, "time_s": inf}),
    "releases slowly": Kind("lets go within 0.2-2 s", "Chan et al. 2012: hand-overs", JUDGING, BOTH,
                            habits=(h.Releases,), behaviour="lets go",
                            criteria={"vibration_n": inf, "time_s": inf, "tilt_deg": inf, "ripple_m_per_s": 0.02}),
    "hands over": Kind("stops wanting, and carries on holding", "Chan et al. 2012", TUNING, LEADS, habits=(h.HandsOver,),
                       behaviour="changes role", criteria={"end_m": inf, "time_s": inf}),
    "meets a wall": Kind("its end stands against 1-30 kN/m", "assumed: from a cushion to a table", TUNING, BOTH,
                         habits=(h.MeetsWall,), behaviour="blocks", criteria={"vibration_n": inf, "time_s": inf}),
    # ---- no person at all
    "another robot": Kind("this package's own law, grip 0.3-4 kN/m", "two robots carry together", TUNING, robot="told",
                          criteria={"end_m": 0.05, "time_s": inf}),
    "another robot, untold": Kind("the same, told nothing", "two robots carry together", JUDGING, FOLLOWS, robot="untold",
                                  criteria={"end_m": 0.05, "time_s": inf}),
    # ---- how it follows
    "resists": Kind("a damper", "Ikeura and Inooka 1995", TUNING, FOLLOWS, minds={FOLLOWING: m.Resists}),
    "stiff shoulder": Kind("2 N of friction and 45-60 N s/m", "assumed: static friction", JUDGING, FOLLOWS,
                           minds={FOLLOWING: m.StiffShoulder},
                           criteria={"time_s": inf}),
    "relaxes": Kind("a spring whose rest comes after", "Ikeura et al. 2002", JUDGING, FOLLOWS, minds={FOLLOWING: m.Relaxes}),
    "steps after": Kind("notices three times a second", "Burdet and Milner 1998: intermittence", TUNING, FOLLOWS,
                        minds={FOLLOWING: m.StepsAfter},
                        criteria={"vibration_n": 1.2}),
    "foresees": Kind("goes on as fast as it saw it go", "Mehta and Schaal 2002", TUNING, FOLLOWS, minds={FOLLOWING: m.Foresees}),
    "sticks": Kind("3 N of friction", "assumed: waits to be moved", JUDGING, FOLLOWS, minds={FOLLOWING: m.Sticks}),
    "trails": Kind("the arm, and a posture that comes after", "Dolan et al. 1993", JUDGING, FOLLOWS, minds={FOLLOWING: m.Trails}),
    "levels by eye": Kind("goes where the object is level", "Agravante et al. 2014", TUNING, FOLLOWS,
                          minds={FOLLOWING: m.Levels}),
}  # fmt: skip


def kind_of(name: str) -> Kind:
    return known("kind of person", name, KINDS)


def names_of(people: str | Sequence[str]) -> tuple[str, ...]:
    """Names of the kinds of "tuning", "judging", "all", or of one or several names."""
    chosen: list[str] = []
    for one in [people] if isinstance(people, str) else people:
        if one in (TUNING, JUDGING, "all"):
            chosen += [name for name, kind in KINDS.items() if one in (kind.split, "all")]
        elif one in KINDS:
            chosen.append(one)
        else:
            raise unknown("kind of person", one, KINDS, f"; or a group: {', '.join(GROUPS)}")
    return tuple(dict.fromkeys(chosen))


def for_tuning(people: str | Sequence[str] = TUNING) -> tuple[str, ...]:
    """Names of kinds to choose numbers on; a kind that judges is refused."""
    chosen = names_of(people)
    if judges := [name for name in chosen if KINDS[name].split == JUDGING]:
        raise ParameterError(f"people: {judges[0]!r} judges; numbers are chosen on: {', '.join(names_of(TUNING))}")
    return chosen


def planned(name: str, course: Course, rng: np.random.Generator) -> Course:
    """What a person of this kind makes of a course."""
    return kind_of(name).plan(course, rng)


def make(
    name: str,
    *,
    role: str,
    course: Course | None,
    body: Body,
    axes: Sequence[str],
    rng: np.random.Generator,
    event_s: float | None = None,
    substep_s: float = 0.001,
) -> Partner:
    """A person of the kind `name`.

    role     "leading", with a `course` (already `planned`), or "following", where the course is not used
    body     as drawn; the kind may change it
    event_s  when what happens once happens; None: at 0.3-0.7 of the course, or once the hand has been led a little

    Another robot is made of a skill instead: see `robot.RobotPartner` and `trials.people`.
    """
    kind = kind_of(name)
    if kind.robot:
        raise ParameterError(f"people: {name!r} is no person: it needs a skill; comanip trial --people gives it one")
    if role not in kind.roles:
        raise ParameterError(f"people: {name!r} plays {' and '.join(kind.roles)} only; got role {role!r}")
    if role == LEADING and course is None:
        raise ParameterError(f"people: {name!r} cannot lead without a course")
    if len(body.carried_n) != len(axes):
        raise ParameterError(
            f"people: a body that carries along {len(body.carried_n)} axes cannot hold {len(axes)}: {tuple(axes)}"
        )
    check_generator(rng)
    body = kind.body(body, rng)
    body = body if role == LEADING else body.steady()
    if event_s is None and course is not None and role == LEADING:
        event_s = course.start_s + float(rng.uniform(0.3, 0.7)) * plans.lasting(course)
    mind = kind.minds.get(role, m.Impedance if role == LEADING else m.Shares)
    own = course if role == LEADING else None
    n, people = len(axes), []
    for one, part in _parted(kind.people, own, body, rng):
        habits = [habit(part, n, event_s, rng) for habit in kind.habits]
        people.append(Person(part, mind(part, one, n, substep_s, rng), habits, n_axes=n, substep_s=substep_s, rng=rng))
    return people[0] if len(people) == 1 else Together(people)


def _parted(n: int, course: Course | None, body: Body, rng: np.random.Generator) -> list[tuple[Course | None, Body]]:
    """Several share the weight; the others are up to 0.25 s later and stop up to 1 cm elsewhere."""
    less: dict[str, Any] = {"load_kg": body.load_kg / n, "yielding_ns_per_m": body.yielding_ns_per_m / n}
    share = replace(body, carried_n=tuple(c / n for c in body.carried_n), **less)
    share = share.stiffened(share.stiffness_n_per_m / n, body.ratio) if n > 1 else body
    all_of_them: list[tuple[Course | None, Body]] = [(course, share)]
    for _ in range(n - 1):
        late, off = float(rng.uniform(0.05, 0.25)), 1.0 + float(rng.uniform(-0.03, 0.03))
        other = None if course is None else plans.later(plans.enlarged(course, off), late)
        all_of_them.append((other, share))
    return all_of_them
