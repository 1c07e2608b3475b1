"""Lessons: the sign of the force tells who led, natural lessons cost little force, dyads differ, and roles separate."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
import pytest

from comanip.errors import ParameterError
from comanip.lessons.demonstration import demonstrations
from comanip.people.intent import Intent, Plan, Yielding
from comanip.plants import makers
from comanip.plants.beam import Beam, BeamPlant
from comanip.teaching import DYADS, ROLES, SCENARIOS, teach

N = 6  # lessons a scenario; all 200 a role were looked at once (docs/physics.md)


@pytest.fixture(scope="module")
def taught():
    return {role: teach(role, N, rng=np.random.default_rng([5, n])) for n, role in enumerate(SCENARIOS)}


def first_third(lesson):
    """Mean F [N] over the first third of the lift that was meant."""
    onset, duration = lesson.metadata["onset_s"], lesson.metadata["duration_s"]
    force = lesson["hand.true_force"]
    return float(force.values[(force.time >= onset) & (force.time <= onset + duration / 3.0)].mean())


def size(lesson):
    return float(np.sqrt((lesson["hand.true_force"].values ** 2).mean()))


def along(lesson):
    """Cosine between force and velocity: +1 when the partner always pushes along the motion."""
    force, velocity = lesson["hand.true_force"].values[:, 0], lesson["hand.velocity"].values[:, 0]
    return float(force @ velocity / np.sqrt((force @ force) * (velocity @ velocity)))


def test_in_the_first_third_a_leading_hand_feels_drag_and_a_following_hand_is_pulled(taught):
    assert max(map(first_third, taught["leader"])) < 0.0
    assert min(map(first_third, taught["follower"])) > 0.0


def test_natural_lessons_cost_less_force_than_told_roles(taught):
    natural = np.mean([size(x) for x in taught["natural"]])
    assert natural < 0.6 * min(np.mean([size(x) for x in taught[role]]) for role in ROLES)
    assert abs(np.mean([first_third(x) for x in taught["natural"]])) < 1.5
    assert {np.sign(first_third(x)) for x in taught["natural"]} == {-1.0, 1.0}  # now one is ahead, now the other


def test_roles_separate_by_velocity_and_force_and_natural_lies_between(taught):
    spans = {role: (min(map(along, lessons)), max(map(along, lessons))) for role, lessons in taught.items()}
    assert spans["leader"][1] < -0.3
    assert spans["follower"][0] > 0.3
    assert spans["leader"][1] < np.mean([along(x) for x in taught["natural"]]) < spans["follower"][0]


def test_all_lessons_arrive_and_end_at_rest(taught):
    for lesson in (x for lessons in taught.values() for x in lessons):
        z, v = lesson["hand.position"].values[:, 0], lesson["hand.velocity"].values[:, 0]
        assert z[-1] - z[0] == pytest.approx(lesson.metadata["lift_m"], abs=0.06)  # two ideas of it, 1.5 cm apart each
        assert np.abs(v[-400:]).max() < 0.03


@pytest.mark.parametrize("name", ["b", "c"])
def test_other_dyads_show_the_same_signs_by_other_means(name, taught):
    for role, sign in (("leader", -1.0), ("follower", 1.0)):
        lessons = teach(role, 2, rng=np.random.default_rng(1), habits=DYADS[name])
        assert min(sign * first_third(x) for x in lessons) > 0.0
        others = [x.duration_s for x in taught[role]]
        assert abs(np.mean([x.duration_s for x in lessons]) - np.mean(others)) > 0.2


def test_natural_lessons_are_not_suspected_of_a_wrong_sign(taught, recwarn):
    """A partner who hangs back throughout is no error when nobody was told to follow."""
    leader = [x.with_metadata(role="natural", name=f"{n}") for n, x in enumerate(taught["leader"][:2])]
    assert demonstrations([*leader, *taught["natural"][:3]], rate_hz=100.0)[0].role == "natural"
    assert not [w for w in recwarn if "sign" in str(w.message)]


def test_lessons_hold_raw_and_compensated_force_commanded_and_applied(taught):
    for lesson in (lessons[0] for lessons in taught.values()):
        apart = lesson["hand.compensated_force"].values - lesson["hand.true_force"].values
        assert np.sqrt((apart**2).mean()) < 0.5
        assert {
            *("hand.sensor_force", "hand.position", "command.velocity", "partner.force", "partner.position", "beam.tilt"),
            *("device.velocity", "device.position", "device.force", "device.applied", "device.clutch"),
        } <= set(lesson.channels)
        assert [lesson[f"device.{n}"].unit for n in ("position", "velocity", "force", "applied")] == ["m", "m/s", "N", "N"]


def test_a_plant_of_ones_own_is_taught_on():
    made = []

    def maker(partner, *, beam, sensor, dt, start_position, rng):
        made.append(BeamPlant(partner, beam=beam, sensor=sensor, dt=dt, start_position=start_position, rng=rng))
        return made[-1]

    (lesson,) = teach("leader", 1, rng=np.random.default_rng(0), plant=maker, beam=Beam(mass_kg=3.0))
    assert made[0].beam.mass_kg == lesson.metadata["load_mass_kg"] == 3.0
    (usual,) = teach("leader", 1, rng=np.random.default_rng(0), beam=Beam(mass_kg=3.0))
    assert lesson["hand.position"].values.tobytes() == usual["hand.position"].values.tobytes()


def test_a_plant_that_is_not_there_is_named_with_its_remedy(monkeypatch):
    def absent(name):
        raise ImportError(f"no module named {name!r}")

    monkeypatch.setattr(makers, "import_module", absent)
    with pytest.raises(ParameterError, match=r"pip install 'comanip\[humanoid\]'"):
        teach("leader", 1, rng=np.random.default_rng(0), plant="humanoid")
    with pytest.raises(ParameterError, match="there are: beam, humanoid"):
        teach("leader", 1, rng=np.random.default_rng(0), plant="biped")


@pytest.mark.skipif(not (find_spec("mujoco") and find_spec("comanip.plants.humanoid")), reason="needs the humanoid")
def test_a_humanoid_is_taught_like_the_beam():
    (lesson,) = teach("leader", 1, rng=np.random.default_rng(0), plant="humanoid")
    z = lesson["hand.position"].values[:, 0]
    assert lesson.metadata["stop_reason"] == "duration"
    assert z[-1] - z[0] == pytest.approx(lesson.metadata["lift_m"], abs=0.04)
    assert first_third(lesson) < 0.0


def test_an_unknown_scenario_is_named():
    with pytest.raises(ParameterError, match="there are: leader, follower, natural"):
        teach("boss", 1, rng=np.random.default_rng(0))


def intended(intent, pull, speed, seconds, h=0.001):
    path = []
    for n in range(round(seconds / h)):
        path.append(intent.step(n * h)[0])
        intent.feel(pull, speed(n * h) if callable(speed) else speed)
    return np.array(path)


def test_a_plan_alone_does_not_give_way_and_yielding_alone_goes_where_it_is_pulled():
    plan, soft = Plan(0.3, 1.0, 0.0), Yielding(persistence=0.0)
    assert intended(Intent(plan, None, 0.001), 50.0, 0.0, 2.0)[-1] == pytest.approx(0.3)
    moved = intended(Intent(None, soft, 0.001), 5.8, 0.0, 3.0)
    assert 0.0 <= np.flatnonzero(moved)[0] / 1000.0 - soft.delay_s < 0.01  # not before his own delay
    assert moved[-1] - moved[-1001] == pytest.approx(5.0 / soft.damping_ns_per_m, rel=1e-3)  # (pull - dead zone) / D


def test_who_shares_keeps_his_plan_while_all_is_as_expected():
    plan = Plan(0.3, 1.0, 0.1)
    shared = intended(Intent(plan, Yielding(), 0.001), 0.5, lambda t: plan.at(t)[1], 2.0)
    assert shared == pytest.approx(intended(Intent(plan, None, 0.001), 0.0, 0.0, 2.0), abs=1e-3)
    pushed = intended(Intent(plan, Yielding(), 0.001), -5.0, lambda t: plan.at(t)[1], 2.0)
    assert pushed[-1] < 0.1


def test_impossible_habits_are_named():
    with pytest.raises(ParameterError, match="duration_s must be positive"):
        Plan(duration_s=0.0)
    with pytest.raises(ParameterError, match="lag_s must be positive"):
        Yielding(lag_s=0.0)


def test_each_lesson_can_be_stored_before_the_next_begins():
    kept = []

    def keep(number, lesson):
        kept.append((number, lesson.metadata["lesson"]))
        if number == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        teach("leader", 3, rng=np.random.default_rng(0), keep=keep)
    assert kept == [(0, 0), (1, 1)]
