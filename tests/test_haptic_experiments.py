"""The stability map and the direct lessons: instruments against what is known beforehand, claims on small runs."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("matplotlib")
from comanip.experiments import direct_recording, stability_map
from comanip.experiments.direct_recording import Nobody, TwoHands, record
from comanip.experiments.stability_map import DELAYS_S, GAINS, GRIPS
from comanip.interfaces import STANDARD_GRAVITY
from comanip.loop import run
from comanip.plants.beam import Beam, WristSensor

QUIET = WristSensor(0.0, 0.0, 0.0)
HALF = 0.5 * Beam().mass_kg * STANDARD_GRAVITY


class Pull:
    def __init__(self, extra):
        self.extra = extra

    def reset(self, position):
        pass

    def force(self, time, position, velocity, out):
        out[:] = HALF + self.extra


def two(one, other, *, wrist, dt=0.001, seconds=1.0):
    plant = TwoHands(
        Pull(one),
        Pull(other),
        beam=Beam(),
        wrist_nm_per_rad=wrist,
        sensor=QUIET,
        dt=dt,
        start_m=0.0,
        rng=np.random.default_rng(0),
    )
    return run(plant, Nobody(), duration_s=seconds)


def test_two_equal_pulls_lift_the_beam_level_and_feel_no_interaction():
    recording = two(1.0, 1.0, wrist=100.0)
    t, z = recording["hand.position"].time, recording["hand.position"].values[:, 0]
    assert z == pytest.approx(0.5 * 2.0 / Beam().mass_kg * t**2, abs=1e-9)  # (f_1 + f_2 - m g)/m
    assert not recording["beam.tilt"].values.any()
    assert recording["hand.true_force"].values[1:] == pytest.approx(0.0, abs=1e-9)


def test_unequal_pulls_tilt_it_until_the_wrists_hold():
    recording = two(-2.0, 2.0, wrist=100.0, seconds=3.0)
    beam = Beam()
    assert recording["beam.tilt"].values[-1, 0] == pytest.approx(2.0 * beam.length_m / (2.0 * 100.0), rel=1e-4)
    assert recording["hand.position"].values[-1, 0] == pytest.approx(-0.5 * beam.length_m * recording["beam.tilt"].values[-1, 0])
    assert recording["hand.true_force"].values[-1, 0] == pytest.approx(2.0, abs=1e-3)


def test_a_pivoting_beam_leaves_only_inertia_to_feel():
    """F = (m/6)(z_1'' - z_2''); pulls of -1 and +1 N on 2 kg of 0.8 m: 7.5 rad/s^2, 3 m/s^2 at either end."""
    force = two(-1.0, 1.0, wrist=0.0, seconds=0.01)["hand.true_force"].values[1:]
    assert force == pytest.approx(-2.0, abs=1e-6)


def test_the_step_is_exact_for_held_forces():
    ends = [two(-1.0, 1.5, wrist=30.0, dt=dt, seconds=0.5 + dt)["partner.position"].values[-1, 0] for dt in (0.01, 0.0005)]
    assert ends[0] == pytest.approx(ends[1], abs=1e-9)


def test_hands_that_let_the_beam_pivot_feel_nothing_of_each_other():
    (loose,), (firm,) = (record("leader", 1, np.random.default_rng(0), wrist_nm_per_rad=k) for k in (0.0, 100.0))
    size = [float(np.sqrt((r["hand.true_force"].values ** 2).mean())) for r in (loose, firm)]
    assert size[0] < 0.2 * size[1]


def small(values, cells):
    """Ripples that are 0 but where `cells` says otherwise."""
    out = {grip: np.zeros((len(DELAYS_S), len(GAINS))) for grip in GRIPS}
    for grip, i, j in cells:
        out[grip][i, j] = values
    return out


def failing(plain, passive, reduced=0.0):
    found = stability_map.Numbers(plain, passive, {g: np.full(len(DELAYS_S), reduced) for g in GRIPS})
    return [c.text for c in stability_map.claims(found) if not c.passed]


def test_the_map_s_claims_can_fail():
    top = len(GAINS) - 1
    shaking = [("light", i, top) for i in range(1, len(DELAYS_S))]
    assert failing(small(0.2, shaking), small(0.0, [])) == []
    assert any("starts nothing" in t for t in failing(small(0.2, shaking), small(0.2, [("stiff", 0, 0)])))
    assert any("stills what shakes" in t for t in failing(small(0.2, shaking), small(0.2, shaking)))
    assert any("delay never helps" in t for t in failing(small(0.2, [("light", 1, top)]), small(0.0, [])))
    assert any("reduced with delay" in t for t in failing(small(0.2, shaking), small(0.0, []), reduced=0.1))
    assert any("normal grip is still" in t for t in failing(small(0.2, [("normal", 0, 3)]), small(0.0, [])))
    assert any("firm grip" in t for t in failing(small(0.2, [("normal", 6, 1)]), small(0.0, [])))


def test_the_highest_still_gain_stops_at_the_first_that_shakes():
    ripples = np.zeros((2, len(GAINS)))
    ripples[0, 2] = ripples[1, 0] = 0.1
    assert stability_map.highest_still(ripples) == [GAINS[1], 0.0]


def test_the_direct_lessons_small_run_keeps_its_signs_and_draws(tmp_path, monkeypatch):
    monkeypatch.setattr(direct_recording, "LEARNED", 2)
    monkeypatch.setattr(direct_recording, "HELD_OUT", 1)
    monkeypatch.setattr(direct_recording, "WRISTS", (0.0, 100.0))
    found = direct_recording.numbers(1)
    assert {c.text: c.measured for c in direct_recording.claims(found)[:3] if not c.passed} == {}
    from comanip.evaluation import drawing as figures

    figures.save(direct_recording.draw(found), tmp_path / "direct.png")
    mirrored = found._replace(
        patterns={k: [p._replace(first_third_n=-p.first_third_n) for p in v] for k, v in found.patterns.items()}
    )
    assert [c.passed for c in direct_recording.claims(mirrored)[:2]] == [False, False]
