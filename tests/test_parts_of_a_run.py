"""Parts that do not fit one another, or are no parts at all, are refused in one line and before the first command (C31)."""

from __future__ import annotations

import numpy as np
import pytest

from comanip import (
    BeamPlant,
    HumanFollower,
    HumanLeader,
    TaringInteractionForce,
    make_auto,
    make_skill,
    run,
    select_states,
    teach,
)
from comanip.devices.link import Link, Network
from comanip.errors import MismatchError, ParameterError
from comanip.fitting.hmm import fit_hmm
from comanip.interaction import CausalInteractionForce
from comanip.models.gmm import Gmm
from comanip.models.gmm import sample as sample_gmm
from comanip.people.partners import Arm, dyad
from comanip.safety.envelope import Envelope
from comanip.skills.baselines import MassDamper, VariableDamping
from comanip.tasks import named
from comanip.tasks.way import draw_lesson, draw_partner
from comanip.trials import draw_case

Z = ("z",)


def rng():
    return np.random.default_rng(0)


class Hand:
    """A robot that does as it is told, and counts what it was told."""

    stop_reason = ""
    channels = {}  # noqa: RUF012

    def __init__(self, axes=Z, dt=0.01):
        self.axes, self.dt, self.commands = axes, dt, 0

    def reset(self):
        self.time = 0.0

    def read(self, obs):
        obs.time = self.time
        obs.position[:], obs.velocity[:], obs.force[:] = 0.9, 0.0, 0.0

    def write(self, command):
        self.commands += 1

    def advance(self):
        self.time += self.dt


def laws(taught, axes, dt):
    """Every skill that ships, made for `axes` and `dt`; by name."""
    follower, leader = taught["follower"], taught["leader"]

    def plain():
        return MassDamper(n_axes=len(axes), dt=dt)

    return {
        "follower": lambda: make_skill(follower, axes=axes, dt=dt),
        "leader": lambda: make_skill(leader, axes=axes, dt=dt),
        "bare follower": lambda: make_skill(follower, axes=axes, dt=dt, envelope=False),
        "bare leader": lambda: make_skill(leader, axes=axes, dt=dt, envelope=False),
        "paper": lambda: make_skill(follower, axes=axes, dt=dt, law="paper", envelope=False),
        "auto": lambda: make_auto(taught, axes=axes, dt=dt),
        "bare auto": lambda: make_auto(taught, axes=axes, dt=dt, envelope=False),
        "damper": plain,
        "enveloped": lambda: Envelope(plain(), axes=axes, dt=dt),
        "variable": lambda: VariableDamping(n_axes=len(axes), dt=dt),
    }


NAMES = list(laws({"follower": None, "leader": None}, Z, 0.01))


@pytest.fixture(scope="module")
def taught(skills):
    return dict(skills)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("dt", [0.002, 0.04])
def test_a_skill_of_another_period_moves_nothing(taught, name, dt):
    hand = Hand(dt=dt)
    with pytest.raises(MismatchError, match=rf"made for a control period dt of 0\.01 s, the plant Hand has {dt} s"):
        run(hand, laws(taught, Z, 0.01)[name](), duration_s=1.0)
    assert hand.commands == 0
    hand = Hand(dt=0.01)
    run(hand, laws(taught, Z, 0.01)[name](), duration_s=0.05)
    assert hand.commands == 5


@pytest.mark.parametrize("name", [n for n in NAMES if n not in ("damper", "variable")])
def test_a_skill_of_other_axes_moves_nothing(taught, name):
    hand = Hand(axes=("x",))
    with pytest.raises(MismatchError, match="made for the axes z, the plant Hand has x"):
        run(hand, laws(taught, Z, 0.01)[name](), duration_s=1.0)
    assert hand.commands == 0


def test_what_an_envelope_wraps_is_asked_too():
    hand = Hand(dt=0.002)
    with pytest.raises(MismatchError, match=r"the skill MassDamper is made for a control period dt of 0\.01 s"):
        run(hand, Envelope(MassDamper(n_axes=1, dt=0.01), axes=Z, dt=0.002), duration_s=1.0)
    assert hand.commands == 0


@pytest.mark.parametrize(
    "make",
    [
        lambda dt, g: TaringInteractionForce(dt, gravity=g),
        lambda dt, g: CausalInteractionForce(dt, gravity=g, mass_kg=2.0),
    ],
)
def test_an_estimator_of_another_period_or_of_other_axes_is_refused(make):
    skill = MassDamper(n_axes=1, dt=0.01)
    with pytest.raises(MismatchError, match=r"made for a control period dt of 0\.002 s, the plant Hand has 0\.01 s"):
        run(Hand(), skill, duration_s=1.0, estimator=make(0.002, [-9.8]))
    with pytest.raises(MismatchError, match="made for 3 axes, the plant Hand has 1: z; give it gravity with one entry an axis"):
        run(Hand(), skill, duration_s=1.0, estimator=make(0.01, [0.0, 0.0, -9.8]))


class Nothing:
    pass


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        (lambda: (Nothing(), MassDamper(n_axes=1, dt=0.01), 1.0), r"^plant is .*Nothing.*it has no axes, dt, channels"),
        (lambda: (Hand, MassDamper(n_axes=1, dt=0.01), 1.0), r"^plant is .*it has no axes"),
        (lambda: (Hand(), Nothing(), 1.0), r"^skill is .*it has no diagnostics, stop_reason, notice, reset, step; comanip\."),
        (
            lambda: (Hand(), MassDamper(n_axes=1, dt=0.01), "6"),
            r"^duration_s must be a positive number of seconds; got '6' \(str\)",
        ),
        (lambda: (Hand(), MassDamper(n_axes=1, dt=0.01), np.nan), r"^duration_s must be a positive number of seconds; got nan"),
        (lambda: (Hand(), MassDamper(n_axes=1, dt=0.01), np.inf), r"^duration_s must be a positive number of seconds; got inf"),
    ],
)
def test_what_is_no_part_is_one_line(parts, said):
    plant, skill, duration = parts()
    with pytest.raises(ParameterError, match=said):
        run(plant, skill, duration_s=duration)


def test_a_partner_without_its_methods_is_one_line():
    with pytest.raises(ParameterError, match=r"^partner is .*it has no reset, force; comanip\.interfaces\.Partner says"):
        BeamPlant(Nothing(), rng=rng())


@pytest.mark.parametrize("seed", [0, 1, None, np.random.RandomState(3), "7"])
@pytest.mark.parametrize(
    "draws",
    [
        lambda r: HumanLeader(rng=r),
        lambda r: HumanFollower(rng=r),
        lambda r: BeamPlant(HumanLeader(rng=rng()), rng=r),
        lambda r: teach("leader", 1, rng=r),
        lambda r: draw_case("leader", r),
        lambda r: draw_lesson(named("lift"), r),
        lambda r: draw_partner(named("lift"), r, 0.3, 1.0, 1.0),
        lambda r: dyad(r, Arm()),
        lambda r: sample_gmm(Gmm(np.ones(1), np.zeros((1, 1)), np.ones((1, 1, 1)), ("position.z",)), 3, r),
        lambda r: Link(object(), Network(), rng=r),
    ],
)
def test_a_seed_in_place_of_a_generator_is_one_line(draws, seed):
    with pytest.raises(ParameterError, match=r"^rng is .*; allowed: a numpy Generator, for example numpy\.random\.default_rng\("):
        draws(seed)


@pytest.mark.parametrize("how", [{"initial_guess": "kmeans"}, {"restarts": 2}, {}])
def test_a_fit_takes_no_seed_either(how):
    lessons = [np.random.default_rng(k).normal(size=(60, 2)) for k in range(2)]
    with pytest.raises(ParameterError, match=r"^rng is 1 \(int\); allowed: a numpy Generator"):
        fit_hmm(lessons, 2, channels=("position.z", "force.z"), rng=1, **how)
    with pytest.raises(ParameterError, match=r"^rng is 1 \(int\); allowed: a numpy Generator"):
        select_states(lessons, (2, 3), channels=("position.z", "force.z"), rng=1, **how)
