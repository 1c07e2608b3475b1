"""What stands between a user and the envelope: re-arming, braking when asked to end, and the lesser of two limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from comanip.interfaces import Command, Observation
from comanip.robots.guard import APART_M, Guarded, limits_of
from comanip.robots.settings import load
from comanip.safety.limits import as_taught

DT, A_MAX, GOES_M_PER_S = 0.01, 2.0, 0.3
FAKE = load("fake")


class Going:
    """An envelope whose skill goes on and on; it re-arms when `pulled` is false."""

    diagnostics = {}  # noqa: RUF012
    stop_reason = "the end of the task"

    @property
    def mode(self):
        return "HOLD" if self.pulled else "RUN"

    @property
    def notice(self):
        return "HOLD: shaken" if self.pulled else ""

    def __init__(self):
        self.pulled = True

    def reset(self, obs):
        pass

    def rearm(self, obs):
        return "pulled" if self.pulled else ""

    def step(self, obs, command):
        command.velocity[:] = (GOES_M_PER_S, -GOES_M_PER_S)
        command.position[:] = obs.position + command.velocity * DT
        command.acceleration[:] = 1.0


@pytest.fixture
def going():
    guarded, obs, command = Guarded(Going(), dt=DT, a_max_m_per_s2=A_MAX), Observation(2), Command(2)
    obs.position[:] = (0.4, 0.9)
    guarded.reset(obs)
    guarded.step(obs, command)
    return guarded, obs, command


def test_asked_to_end_it_brakes_straight_to_rest_and_then_says_the_first_reason(going):
    guarded, obs, command = going
    guarded.ask_stop("you pressed q")
    guarded.ask_stop("interrupted")
    speeds = [np.hypot(*command.velocity)]
    while not guarded.stop_reason:
        guarded.step(obs, command)
        speeds.append(np.hypot(*command.velocity))
        np.testing.assert_allclose(command.position, obs.position + command.velocity * DT, rtol=0.0, atol=1e-15)
        assert command.velocity[0] == -command.velocity[1]
        assert not command.acceleration.any()
    np.testing.assert_allclose(np.diff(speeds)[:-1], -A_MAX * DT, atol=1e-12)
    assert (speeds[-1], guarded.stop_reason) == (0.0, "you pressed q")


def test_until_it_rests_the_end_of_the_task_does_not_end_the_run(going):
    guarded, obs, command = going
    assert guarded.stop_reason == "the end of the task"
    guarded.ask_stop()
    guarded.step(obs, command)
    assert guarded.stop_reason == ""


def test_only_what_was_granted_counts_as_re_armed(going):
    guarded, obs, command = going
    guarded.ask_rearm()
    guarded.step(obs, command)
    assert (guarded.rearmed, guarded.answer, guarded.notice) == (0, "pulled", "HOLD: shaken; not re-armed: pulled")
    guarded.envelope.pulled = False
    guarded.ask_rearm()
    guarded.step(obs, command)
    guarded.step(obs, command)
    assert (guarded.rearmed, guarded.answer, guarded.notice) == (1, "", "")


def test_what_was_refused_is_not_said_once_it_runs_by_itself(going):
    guarded, obs, command = going
    guarded.ask_rearm()
    guarded.step(obs, command)
    guarded.envelope.pulled = False
    assert (guarded.answer, guarded.notice) == ("pulled", "")


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [("speed_m_per_s", "v_max_m_per_s"), ("acceleration_m_per_s2", "a_max_m_per_s2"), ("force_n", "force_limit_n")],
)
def test_of_what_the_arm_may_and_what_was_taught_the_lesser_counts(skills, ours, theirs):
    learned = [skills["leader"]]
    taught = getattr(as_taught(learned, yields=True), theirs)
    for factor in (0.5, 2.0):
        settings = replace(FAKE, **{ours: factor * taught})
        assert getattr(limits_of(settings, ("z",), learned), theirs) == pytest.approx(min(1.0, factor) * taught)


def test_a_period_may_last_as_the_arm_says_and_a_shadow_may_run_off(skills):
    learned = [skills["leader"]]
    settings = replace(FAKE, late_s=0.083)
    taught = as_taught(learned, yields=True)
    assert limits_of(settings, ("z",), learned).late_s == 0.083
    assert limits_of(settings, ("z",), learned).drift_m == taught.drift_m < APART_M
    assert limits_of(settings, ("z",), learned, shadow=True).drift_m == APART_M
    half = limits_of(settings, ("z",), learned, share=0.5)
    assert half.v_max_m_per_s == pytest.approx(0.5 * limits_of(settings, ("z",), learned).v_max_m_per_s)
