"""The loop: what is recorded, why it ends, real time, and that a run can be learned from like a lesson."""

from __future__ import annotations

import time

import numpy as np
import pytest

from comanip.errors import ParameterError
from comanip.interfaces import Command, Observation
from comanip.learned.learn import learn
from comanip.lessons.demonstration import demonstrations
from comanip.loop import WallClock, run
from comanip.plants.replay import ReplayPlant, distort_time
from comanip.reproduction import make_skill
from comanip.trials import draw_case, run_case


class Steady:
    """Moves up at a constant speed; asks to stop after `ticks` steps."""

    notice = ""

    def __init__(self, ticks=10**9):
        self.ticks, self.stop_reason = ticks, ""

    diagnostics = {}  # noqa: RUF012

    def reset(self, obs):
        self.count, self.stop_reason = 0, ""

    def step(self, obs: Observation, command: Command):
        self.count += 1
        command.velocity[:] = 0.1
        command.position[:] = obs.position + 0.01 * 0.1
        if self.count >= self.ticks:
            self.stop_reason = "enough"


def replay(n=100):
    return ReplayPlant(np.zeros((n, 1)), dt=0.01, start_position=np.zeros(1))


def test_a_run_records_every_tick_with_names_units_and_a_reason():
    recording = run(replay(), Steady(), duration_s=1.0, metadata={"role": "leader"})
    assert recording.metadata["stop_reason"] == "duration"
    assert recording.metadata["role"] == "leader"
    position = recording["hand.position"]
    assert len(position.time) == 100
    assert position.unit == "m"
    assert position.values[:, 0] == pytest.approx(0.001 * np.arange(100))
    assert np.diff(position.time) == pytest.approx(0.01)
    assert "hand.sensor_force" not in recording  # this plant has none, so none is pretended


def test_a_skill_ends_the_run_and_ctrl_c_keeps_what_was_recorded():
    assert run(replay(), Steady(ticks=20), duration_s=1.0).metadata["stop_reason"] == "enough"

    def interrupt(obs, command):
        if obs.time > 0.3:
            raise KeyboardInterrupt

    recording = run(replay(), Steady(), duration_s=1.0, taps=[interrupt])
    assert recording.metadata["stop_reason"] == "interrupted"
    assert len(recording["hand.position"].time) == 32


class Hands:
    """A monotonic clock that somebody turns: sleep, and `works` [s] of each look at it."""

    def __init__(self, works=0.0):
        self.now, self.works = 100.0, works

    def monotonic(self):
        self.now += self.works
        return self.now

    def sleep(self, seconds):
        assert seconds > 0.0
        self.now += seconds


def test_the_wall_clock_takes_the_time_it_says(monkeypatch):
    hands = Hands()
    monkeypatch.setattr("comanip.loop._time", hands)
    recording = run(replay(), Steady(), duration_s=0.3, clock=WallClock())
    assert hands.now - 100.0 == pytest.approx(0.3, abs=0.0101)
    assert (recording["loop.late"].values == 0.0).all()


def test_the_wall_clock_is_that_of_the_wall():
    started = time.monotonic()
    recording = run(replay(), Steady(), duration_s=0.1, clock=WallClock())
    assert time.monotonic() - started >= 0.09
    assert (recording["loop.late"].values >= 0.0).all()


def test_a_late_wall_clock_drops_ticks_instead_of_a_burst(monkeypatch):
    hands = Hands()
    monkeypatch.setattr("comanip.loop._time", hands)
    clock = WallClock()
    clock.start(0.01)
    hands.now += 0.055
    assert clock.wait() == pytest.approx(0.045)
    assert clock.wait() == 0.0
    assert hands.now - 100.0 == pytest.approx(0.06), "the next tick is due where it would have been, the missed ones are gone"


def test_two_runs_with_one_seed_are_equal_byte_for_byte(skills):
    learned = skills["follower"]
    case = draw_case("follower", np.random.default_rng(1))
    runs = [run_case(case, make_skill(learned, axes=("z",), dt=0.01)) for _ in range(2)]
    for name, channel in runs[0].channels.items():
        assert channel.values.tobytes() == runs[1][name].values.tobytes(), name


def test_a_reproduction_can_be_learned_from_like_a_lesson(skills):
    rng = np.random.default_rng(8)
    runs = [run_case(draw_case("leader", rng), make_skill(skills["leader"], axes=("z",), dt=0.01)) for _ in range(4)]
    again = learn(demonstrations(runs, rate_hz=100.0), role="leader")
    assert again.model.channels == skills["leader"].model.channels
    assert again.ends.mean() == pytest.approx(skills["leader"].ends.mean(), abs=0.03)


def test_time_can_be_distorted_but_never_backwards():
    new = distort_time(1.0, [(0.0, 0.0), (0.5, 0.0), (1.0, 0.5)], 0.1)
    assert new == pytest.approx([0, 0, 0, 0, 0, 0, 0.1, 0.2, 0.3, 0.4, 0.5])
    with pytest.raises(ParameterError, match="backwards"):
        distort_time(1.0, [(0.0, 0.5), (1.0, 0.2)], 0.1)
    with pytest.raises(ParameterError, match="duration_s must be a positive number"):
        run(replay(), Steady(), duration_s=0.0)
