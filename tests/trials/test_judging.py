"""The judge: runs with one known defect give exactly its name; bounds say what they ask of whom."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np
import pytest

from comanip.interfaces import STANDARD_GRAVITY
from comanip.recording import Channel, Recording
from comanip.trials import Bounds, Case, bounds, judge
from comanip.trials.judging import NOTICED_S
from lifts import minimum_jerk

DT = 0.01
FOLLOWING = Case("follower", 0.3, 2.0, 1.0, 100.0, 20.0, 25.0, 0.15, 2.0, 0.0, 0.1, 0.0, 0.0, seed=0)
LEADING = replace(FOLLOWING, role="leader", partner="following")
LETS_GO = replace(FOLLOWING, behaviour="lets go")
ENDS = np.array([[1.14], [1.16]])


def run_of(case, *, starts=1.0, height=0.3, duration=2.0, force=0.0, tilt=0.0, ripple=0.0, mode=0.0, lasts=None):
    """What a faultless robot would have recorded, with one defect."""
    t = np.arange(round((lasts or case.run_s) / DT)) * DT
    x, v, a = minimum_jerk(t, starts, duration, height)
    last = t > t[-1] - 0.5
    v = v + np.where(last, ripple * np.sin(40.0 * t), 0.0)
    signals = {
        "hand.position": 0.85 + x,
        "hand.velocity": v,
        "hand.acceleration": a,
        "hand.true_force": force(t) if callable(force) else np.full_like(t, force),
        "partner.force": np.full_like(t, 0.5 * case.beam_mass_kg * STANDARD_GRAVITY),
        "beam.tilt": np.radians(tilt) * np.exp(-(((t - 2.0) / 0.2) ** 2)),
        "skill.mode": np.where(t >= case.event_s + 0.3, mode, 0.0),
    }
    return Recording({name: Channel(t, values) for name, values in signals.items()})


def between(start, stop, newtons):
    return lambda t: np.where((t >= start) & (t < stop), newtons, 0.0)


@pytest.mark.parametrize(
    ("case", "defect", "said"),
    [
        (FOLLOWING, {}, ()),
        (FOLLOWING, {"starts": 0.2}, ("moved before the partner",)),
        (FOLLOWING, {"height": 0.34}, ("missed the partner's goal",)),
        (FOLLOWING, {"height": 0.26}, ("missed the partner's goal",)),
        (FOLLOWING, {"height": 0.32}, ()),
        (FOLLOWING, {"force": between(2.0, 2.5, 20.0)}, ("peak force",)),
        (FOLLOWING, {"force": between(2.0, 2.5, 14.0)}, ()),
        (FOLLOWING, {"force": between(4.7, 9.0, -5.0)}, ("residual force",)),
        (FOLLOWING, {"force": between(4.55, 4.9, -5.0)}, ("residual force",)),
        (FOLLOWING, {"force": between(1.0, 4.3, -5.0)}, ()),
        (FOLLOWING, {"tilt": 4.0}, ("beam not level",)),
        (FOLLOWING, {"ripple": 0.02}, ("ripple at the end",)),
        (FOLLOWING, {"ripple": 0.008}, ()),
        (FOLLOWING, {"force": between(2.0, 2.01, np.nan)}, ("diverged",)),
        (FOLLOWING, {"force": between(2.0, 2.01, 1e10)}, ("diverged",)),
        (FOLLOWING, {"height": np.inf}, ("diverged",)),
        (LEADING, {}, ()),
        (LEADING, {"starts": 2.5}, ("did not start in time",)),
        (LEADING, {"height": 0.0}, ("did not start in time", "missed the taught height")),
        (LEADING, {"height": 0.34}, ("missed the taught height",)),
        (LEADING, {"force": between(6.0, 9.0, 5.0)}, ("residual force",)),
        (LETS_GO, {"duration": 1.0, "height": 0.04, "starts": 1.9, "mode": 2.0}, ()),
        (LETS_GO, {"duration": 1.0, "height": 0.04, "starts": 1.9, "mode": 1.0}, ()),
        (LETS_GO, {"duration": 1.0, "height": 0.04, "starts": 1.9}, ("letting go not noticed",)),
        (LETS_GO, {"duration": 1.0, "starts": 1.9, "mode": 2.0}, ("went on alone",)),
        (LETS_GO, {"starts": 4.0, "lasts": 2.2}, ("the run ended before the partner let go",)),
        (replace(FOLLOWING, behaviour="blocks"), {"force": between(2.0, 2.2, 50.0)}, ()),
        (replace(FOLLOWING, behaviour="blocks"), {"force": between(2.0, 2.2, 62.0)}, ("peak force",)),
        (replace(FOLLOWING, behaviour="blocks"), {"force": between(2.0, 9.0, -8.0)}, ("residual force",)),
    ],
)
def test_each_defect_has_its_name(case, defect, said):
    with np.errstate(invalid="ignore"):
        assert judge(case, run_of(case, **defect), taught_ends_m=ENDS).failures == said


def test_numbers_of_a_known_run():
    verdict = judge(FOLLOWING, run_of(FOLLOWING, force=4.0, height=0.31, tilt=1.5), taught_ends_m=ENDS)
    assert verdict.failures == ("residual force",)
    assert verdict.effort_n2s == pytest.approx(16.0 * FOLLOWING.run_s, rel=0.02)
    assert verdict.work_j == pytest.approx(4.0 * 0.31, rel=0.01)
    assert verdict.peak_force_n == pytest.approx(4.0, rel=0.02)
    assert verdict.end_error_m == pytest.approx(0.01, abs=1e-6)
    assert verdict.tilt_deg == pytest.approx(1.5, rel=0.01)
    assert verdict.duration_s == pytest.approx(1.33, abs=0.02)  # 30 of 31 cm of a minimum jerk of 2 s
    assert np.isnan(verdict.role_right)


@pytest.mark.parametrize(
    ("after_s", "said"), [(-0.02, ()), (0.02, ("letting go not noticed",)), (2.0, ("letting go not noticed",))]
)
def test_letting_go_is_noticed_half_a_second_after_the_hand_is_gone_and_not_later(after_s, said):
    recording = run_of(LETS_GO, duration=1.0, height=0.04, starts=1.9)
    t = recording["hand.position"].time
    at = LETS_GO.event_s + LETS_GO.within_s + NOTICED_S + after_s
    mode = Channel(t, np.where(t >= at - 1e-9, 2.0, 0.0))
    assert judge(LETS_GO, recording.with_channels({"skill.mode": mode}), taught_ends_m=ENDS).failures == said


def beside_the_load(mine, theirs):
    """(internal force [N], share of effort) of a lift in which both hands do more than the load asks [N]."""
    recording = run_of(FOLLOWING)
    half, t = 0.5 * FOLLOWING.beam_mass_kg, recording["hand.position"].time
    inertia = half * recording["hand.acceleration"].values[:, 0]
    true = Channel(t, inertia - mine)
    partner = Channel(t, half * STANDARD_GRAVITY + theirs * np.ones_like(t))
    verdict = judge(FOLLOWING, recording.with_channels({"hand.true_force": true, "partner.force": partner}), taught_ends_m=ENDS)
    return verdict.internal_force_n, verdict.effort_share


def test_what_moves_the_load_is_neither_internal_force_nor_effort():
    """Each hand carries half the weight and accelerates half the mass: beyond that the robot does nothing here."""
    assert beside_the_load(0.0, 0.0) == pytest.approx((0.0, 0.5), abs=1e-9)
    internal, share = beside_the_load(0.0, 3.0)
    assert internal == pytest.approx(0.0, abs=1e-9)
    assert share == pytest.approx(0.0, abs=1e-9)


def test_two_who_push_against_each_other_press_by_the_smaller_force_and_share_by_squares():
    assert beside_the_load(6.0, -4.0) == pytest.approx((4.0, 36.0 / 52.0), rel=1e-6)
    assert beside_the_load(-2.0, 5.0) == pytest.approx((2.0, 4.0 / 29.0), rel=1e-6)
    assert beside_the_load(6.0, 4.0) == pytest.approx((0.0, 36.0 / 52.0), abs=1e-6)


@pytest.mark.parametrize("patience", [0.2, 0.4])
def test_role_right_asks_a_third_of_a_second_after_the_first_centimetre(patience):
    """The opinion turns from wrong to right `patience` after the hand has gone 1 cm."""
    recording = run_of(FOLLOWING)
    t = recording["hand.position"].time
    moved = t[np.flatnonzero(recording["hand.position"].values[:, 0] > 0.86)[0]]
    right = (t >= moved + patience - 1e-9).astype(float)
    opinion = Channel(t, np.column_stack([1.0 - right, right, 0.0 * t]))
    assert judge(FOLLOWING, recording.with_channels({"skill.role": opinion})).role_right == float(patience < 0.3)


def of(role, behaviour, partner=None):
    leads = partner == "leading" if partner else role == "follower"
    return bounds(replace(FOLLOWING, role=role, partner="leading" if leads else "following", behaviour=behaviour))


def test_bounds_of_each_kind():
    theirs = {"goal": "partner's", "end_m": 0.03}
    taught = {"goal": "taught", "end_m": 0.02}
    assert of("follower", "steady") == Bounds(**theirs, waits=True)
    assert of("leader", "steady") == Bounds(**taught, starts_by_s=2.0)
    assert of("auto", "steady", "leading") == Bounds(**theirs, waits=True)
    assert of("auto", "steady", "following") == Bounds(**taught, starts_by_s=8.5)
    assert of("leader", "hesitates") == Bounds(**taught, starts_by_s=2.0, peak_n=25.0)
    assert of("leader", "changes role") == Bounds(**theirs, starts_by_s=2.0, peak_n=25.0)
    assert of("follower", "changes role") == Bounds(**theirs, waits=True, peak_n=25.0)
    assert of("auto", "changes role", "leading") == Bounds(**taught, waits=True, peak_n=25.0)
    assert of("auto", "changes role", "following") == Bounds(**theirs, starts_by_s=8.5, peak_n=25.0)
    for role, starts in (("leader", 2.0), ("follower", inf)):
        assert of(role, "reverses") == Bounds(**theirs, starts_by_s=starts, waits=role == "follower", peak_n=25.0)
    for role in ("leader", "follower", "auto"):
        assert of(role, "blocks") == Bounds(peak_n=60.0)
        assert of(role, "lets go") == Bounds(peak_n=inf, residual_n=inf, notices=True)
