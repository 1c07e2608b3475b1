"""C31: period, axes and units of skill, plant and estimator that are not one another's are refused before anything moves."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.errors import MismatchError
from comanip.interaction import CausalInteractionForce, TaringInteractionForce
from comanip.loop import run
from comanip.people.partners import HumanFollower
from comanip.plants.beam import BeamPlant
from comanip.reproduction import make_auto, make_skill
from envelopes import Bench


class Counted(BeamPlant):
    """Counts what was commanded."""

    def __init__(self, **about):
        rng = np.random.default_rng(0)
        super().__init__(HumanFollower(rng=rng), rng=rng, **about)
        self.written = 0

    def write(self, command):
        self.written += 1
        super().write(command)


def estimators(dt, gravity):
    return TaringInteractionForce(dt, gravity=gravity), CausalInteractionForce(dt, mass_kg=2.0, gravity=gravity)


@pytest.mark.parametrize("envelope", [True, False])
@pytest.mark.parametrize(("ours", "plants"), [(0.01, 0.002), (0.002, 0.01), (0.01, 0.04)])
def test_C31_a_skill_of_another_period_is_refused_before_the_first_command(skills, ours, plants, envelope):
    plant = Counted(start_position=np.array([0.9]), dt=plants)
    made = [make_skill(skills["leader"], axes=("z",), dt=ours, envelope=envelope)]
    made.append(make_auto(skills, axes=("z",), dt=ours, envelope=envelope))
    for skill in made:
        with pytest.raises(
            MismatchError, match=rf"is made for a control period dt of {ours} s, the plant Counted has {plants} s"
        ):
            run(plant, skill, duration_s=1.0)
    assert plant.written == 0


@pytest.mark.parametrize("axes", [("x",), ("x", "z"), ("z", "x")])
def test_C31_a_skill_of_other_axes_is_refused(skills, axes):
    plant = Counted(start_position=np.full(len(axes), 0.9), axes=axes)
    skill = make_skill(skills["leader"], axes=("z",), dt=0.01)
    with pytest.raises(MismatchError, match=f"is made for the axes z, the plant Counted has {', '.join(axes)}"):
        run(plant, skill, duration_s=1.0)
    assert plant.written == 0


def test_C31_an_estimator_of_another_period_or_number_of_axes_is_refused(skills):
    plant = Counted(start_position=np.array([0.9]))
    skill = make_skill(skills["leader"], axes=("z",), dt=0.01)
    for estimator in estimators(0.002, [-9.8]):
        with pytest.raises(MismatchError, match=r"is made for a control period dt of 0\.002 s, the plant Counted has 0\.01 s"):
            run(plant, skill, duration_s=1.0, estimator=estimator)
    for estimator in estimators(0.01, [0.0, -9.8]):
        with pytest.raises(MismatchError, match="is made for 2 axes, the plant Counted has 1: z"):
            run(plant, skill, duration_s=1.0, estimator=estimator)
    assert plant.written == 0


def test_C31_a_plant_that_states_other_units_is_refused(skills):
    plant = Counted(start_position=np.array([0.9]))
    plant.units = {"position": "mm", "velocity": "m/s"}
    with pytest.raises(MismatchError, match="the plant's position is in 'mm'; skills take 'm'"):
        run(plant, make_skill(skills["leader"], axes=("z",), dt=0.01), duration_s=1.0)
    assert plant.written == 0


def test_C31_the_same_period_in_other_digits_passes(skills):
    plant = Counted(start_position=np.array([0.9]), dt=1.0 / 300.0)
    skill = make_skill(skills["leader"], axes=("z",), dt=0.0033333333333)
    run(plant, skill, duration_s=0.1, estimator=TaringInteractionForce(1.0 / 300.0, gravity=[-9.8]))
    assert plant.written == 30


@pytest.mark.parametrize(("share_n", "refused"), [(20.0, False), (24.0, True), (39.2, True)])
def test_C27_an_object_too_heavy_is_refused_at_rest_with_its_weight(share_n, refused):
    bench = Bench(start=0.5)
    for n in range(40):
        bench.tick(0.0, 0.0, sensor_force=-share_n + 1e-3 * np.sin(n * n))
    assert bench.latched == (f"the object weighs {share_n:.0f} N on this hand > 22 N: too heavy to carry" if refused else "")


def test_a_command_that_is_faded_does_not_go_with_the_position_of_one_that_is_not():
    """A low level that follows positions would go as fast as the skill asks, and the ledger would be off by the difference."""
    bench = Bench(tells=lambda obs: 0.5)
    for _ in range(60):
        bench.tick(0.2, 0.0)
        assert abs(bench.command.position[0] - bench.obs.position[0] - 0.01 * bench.command.velocity[0]) < 1e-12
    assert bench.command.velocity[0] == pytest.approx(0.1)


def test_who_is_re_armed_goes_on_in_the_task_and_who_starts_begins_it(skills):
    called = []
    bench = Bench()
    bench.skill.resume = lambda obs: called.append("resume")
    bench.ticks(5, 0.0, 0.0)
    bench.envelope.step(bench.obs, bench.command)
    assert bench.envelope.rearm(bench.obs) == ""
    assert called == ["resume"]
    bench.envelope.reset(bench.obs)
    assert called == ["resume"]
    assert bench.skill.resets == 2
