"""Stability said before anybody holds the other end: against known loops, and against what happens in closed loop."""

from __future__ import annotations

import numpy as np
import pytest

from comanip.learned.learn import learn
from comanip.models.hmm import Hmm
from comanip.models.stability import (
    PARTNERS,
    Delays,
    PartnerImpedance,
    compliance_gain,
    stability,
    warnings_of,
)


def line(a, b):
    """A model of one state in which v = a x + b F exactly, up to a little noise."""
    rng = np.random.default_rng(0)
    inputs = rng.standard_normal((4000, 2)) * [0.1, 3.0]
    v = inputs @ [a, b] + 1e-6 * rng.standard_normal(4000)
    data = np.column_stack([inputs, v])
    channels = ("position.z", "force.z", "velocity.z")
    return Hmm(np.ones(1), np.ones((1, 1)), data.mean(axis=0)[None], np.cov(data.T)[None], channels)


@pytest.mark.parametrize("a", [-2.0, 0.5])
@pytest.mark.parametrize("b", [0.02, -0.01])
def test_slopes_of_a_known_line_are_found(a, b):
    found = stability(line(a, b))
    assert found.contraction[0] == pytest.approx(a, rel=1e-3)
    assert found.slope[0] == pytest.approx(b, rel=1e-3)
    assert np.isinf(found.loop_gain).all() == (b < 0)


def test_gain_grows_in_proportion_to_the_slope():
    one, two = stability(line(-1.0, 0.01)).loop_gain, stability(line(-1.0, 0.02)).loop_gain
    np.testing.assert_allclose(two, 2.0 * one, rtol=1e-3)


@pytest.mark.parametrize("partner", PARTNERS)
def test_the_limit_said_is_the_limit_that_is_simulated(partner):
    """Damping a little above what gain 1 asks for comes to rest, a little below it grows: Euler at 0.1 ms against Nyquist."""
    delays = Delays()

    def grows(damping):
        dt, n = 1e-4, 60000
        late = round(delays.dead_s / dt)
        felt, past = 0.0, np.zeros(n + late)
        v = sent = x = 0.0
        peak = []
        for i in range(n):
            force = -partner.stiffness_n_per_m * x - partner.damping_ns_per_m * v + (1.0 if i < 100 else 0.0)
            felt += dt * 2 * np.pi * delays.cutoff_hz * (force - felt)
            past[i + late] = felt
            sent += dt / 3.0 * (past[i] - damping * sent)
            v += dt / delays.lag_s * (sent - v)
            x += dt * v
            peak.append(abs(x))
        return max(peak[-n // 4 :]) > max(peak[n // 4 : n // 2])

    low, high = 0.01, 400.0
    for _ in range(40):
        middle = np.sqrt(low * high)
        stable = compliance_gain(3.0, middle, [partner])[0] < 1.0
        low, high = (low, middle) if stable else (middle, high)
    if high < 0.02:
        assert not grows(0.5)
    else:
        assert not grows(1.15 * high)
        assert grows(0.85 * high)


def test_a_leaders_lessons_are_warned_of_under_the_papers_law_and_not_under_the_default(lessons):
    told = [n for n in learn(lessons["leader"], role="leader", law="paper").notes if "positive feedback" in n]
    assert len(told) == 1
    assert not [n for n in learn(lessons["leader"], role="leader").notes if "loop gain" in n or "feedback" in n]


def test_a_compliance_without_damping_is_warned_of(lessons):
    weak = {"virtual_mass_kg": 0.5, "moving_damping_ns_per_m": 1.0, "shake_damping_ns_per_m_per_n": 0.0}
    notes = learn(lessons["follower"], role="follower", settings=weak).notes
    assert any("loop gain" in n and "600 N/m" in n for n in notes)


def test_nothing_is_said_where_all_is_well():
    assert warnings_of(stability(line(-2.0, 1e-4)), "paper", (3.0, 43.0)) == []
    assert compliance_gain(6.0, 30.0, [PartnerImpedance(50.0, 10.0)])[0] < 1.0
