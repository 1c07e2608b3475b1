"""How far the teacher's coupling is stable: K_f against delay and grip, with and without the passivity controller.

Partner and teacher only hold still (2 kg beam, partner 150 N/m and 22 N s/m, s_v = 1.3, simulated PHANToM); the partner is
nudged once by 2 N for 0.1 s. Measured is the hand's rms speed in the last 1.5 s of 4: a limit cycle, or rest. The handle has no
edge here: a hand that is thrown against it rests there and would count as still.

Claims: delay lowers the K_f that is still; a light grip, which damps least, stands least; the passivity controller stills what
shakes and makes nothing shake that was still; K_f = 0.15, reduced with delay as `CouplingLimits` does, is still everywhere. What
people do that is worse than holding (tense up, change the grip, push back with a delay of their own) is not in this map.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from comanip.devices.link import Link, Network
from comanip.devices.phantom import Handle, HeldHandle, phantom
from comanip.evaluation import drawing as figures
from comanip.evaluation.claims import Claim, at_least, at_most
from comanip.experiments.readings import script
from comanip.interfaces import STANDARD_GRAVITY, Array
from comanip.loop import run as run_loop
from comanip.people.partners import Arm, HumanLeader, Plan, Unsteadiness
from comanip.people.teacher import Teacher, TeacherHand
from comanip.plants.beam import BeamPlant, WristSensor
from comanip.recording import Recording
from comanip.skills.passivity import Passive
from comanip.skills.teleoperation import CouplingLimits, Teleoperation

GRIPS = {"light": TeacherHand(0.15, 40.0, 2.0), "normal": TeacherHand(0.5, 100.0, 8.0), "stiff": TeacherHand(0.8, 300.0, 20.0)}
DELAYS_S = (0.0, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2)  # there and back
GAINS = (0.025, 0.05, 0.1, 0.15, 0.2, 0.3, 0.45, 0.7)  # at 0.7 half the beam is 6.9 N of the device's 8.5 N
STILL_M_PER_S = 0.01
AS_SET = CouplingLimits(full_feedback_s=9.0, no_feedback_s=10.0, handle_max_m_per_s=1e3)  # whatever the delay
TAUGHT_WITH = 0.15
WIDE = phantom(workspace_m=None)
SLIPPERY = phantom(workspace_m=None, coulomb_n=0.0)  # friction would hide a slow growth


class Nudged(HumanLeader):
    """A partner who only holds, and is nudged by 2 N for a tenth of a second."""

    def __init__(self, stiffness: float, damping: float, rng: np.random.Generator) -> None:
        steady = Unsteadiness(0.0, 0.0, 0.08, 0.0)
        super().__init__(Plan(lift_m=0.0), Arm(stiffness, damping, unsteadiness=steady), rng=rng)

    def force(self, time: float, position: Array, velocity: Array, out: Array) -> None:
        super().force(time, position, velocity, out)
        if 0.5 <= time < 0.6:
            out += 2.0


def both_hold(
    gain: float,
    delay_s: float,
    grip: str = "normal",
    *,
    passive: bool = False,
    stiffness: float = 150.0,
    damping: float = 22.0,
    duration: float = 4.0,
    limits: CouplingLimits = AS_SET,
    handle: Handle = WIDE,
    seed: int = 0,
) -> Recording:
    """Both hold still after one nudge, over a delay of half `delay_s` each way."""
    rng = np.random.default_rng([seed, 8])
    plant = BeamPlant(Nudged(stiffness, damping, rng), dt=0.001, sensor=WristSensor(0.05, 0.0, 0.005), rng=rng)
    static = np.array([-gain * limits.feedback(delay_s) * STANDARD_GRAVITY])
    held = HeldHandle(Teacher(hand=GRIPS[grip], static_force=static, unsteady_n=0.0, rng=rng), handle)
    link = Link(Passive(held) if passive else held, Network(0.5 * delay_s, 0.5 * delay_s), rng=rng)
    held_by = Teleoperation(link, n_axes=1, dt=plant.dt, force_gain=gain, limits=limits, carried=True)
    return run_loop(plant, held_by, duration_s=duration)


def ripple(recording: Recording, last_s: float = 1.5) -> float:
    """Rms speed of the hand [m/s] at the end."""
    v = recording["hand.velocity"].values[:, 0]
    return float(np.sqrt((v[-round(last_s / recording.metadata["dt_s"]) :] ** 2).mean()))


class Numbers(NamedTuple):
    """Ripple [m/s] by grip: (delays, gains) each; `reduced` (delays,) with K_f = 0.15, the default limits, no friction."""

    plain: dict[str, Array]
    passive: dict[str, Array]
    reduced: dict[str, Array]


def numbers(seed: int, *, gains: tuple[float, ...] = GAINS, delays: tuple[float, ...] = DELAYS_S) -> Numbers:
    def map_of(grip: str, passive: bool) -> Array:
        return np.array([[ripple(both_hold(k, d, grip, passive=passive, seed=seed)) for k in gains] for d in delays])

    def rule(grip: str) -> Array:
        return np.array(
            [ripple(both_hold(TAUGHT_WITH, d, grip, limits=CouplingLimits(), handle=SLIPPERY, seed=seed)) for d in delays]
        )

    return Numbers({g: map_of(g, False) for g in GRIPS}, {g: map_of(g, True) for g in GRIPS}, {g: rule(g) for g in GRIPS})


def highest_still(ripples: Array, gains: tuple[float, ...] = GAINS) -> list[float]:
    """By delay: the largest K_f of the grid up to which everything is still (0: none)."""
    still = np.cumprod(ripples < STILL_M_PER_S, axis=1).sum(axis=1)
    return [0.0 if n == 0 else gains[n - 1] for n in still]


def claims(found: Numbers) -> list[Claim]:
    plain, passive = (np.stack([m[g] for g in GRIPS]) for m in (found.plain, found.passive))
    shaking = plain >= STILL_M_PER_S
    by_grip = {g: np.array(highest_still(found.plain[g])) for g in GRIPS}
    taught = GAINS.index(TAUGHT_WITH)
    return [
        at_most(
            "delay never helps: largest rise of the highest still K_f from one delay to the next",
            float(max(np.diff(k).max() for k in by_grip.values())),
            0.0,
            refuted_by="a longer delay that stands more",
        ),
        at_least(
            "a firm grip stands more: lowest of normal over light, highest still K_f",
            float(np.min(by_grip["normal"] / np.maximum(by_grip["light"], GAINS[0]))),
            1.0,
            refuted_by="a light grip that stands more than a normal one at some delay",
        ),
        at_most(
            f"K_f = {TAUGHT_WITH} with a normal grip is still up to 20 ms: ripple",
            float(found.plain["normal"][: DELAYS_S.index(0.02) + 1, taught].max()),
            STILL_M_PER_S,
            unit="m/s",
            refuted_by="a limit cycle at a setting that lessons are taught with",
        ),
        at_least(
            "the passivity controller stills what shakes: share of shaking settings",
            float((passive[shaking] < STILL_M_PER_S).mean()),
            0.8,
            refuted_by="more than a fifth that go on shaking",
        ),
        at_most(
            "and starts nothing: settings that shake only with it",
            float((passive[~shaking] >= STILL_M_PER_S).sum()),
            0.0,
            refuted_by="one",
        ),
        at_most(
            f"K_f = {TAUGHT_WITH} reduced with delay is still for every grip and delay: worst ripple",
            float(max(r.max() for r in found.reduced.values())),
            STILL_M_PER_S,
            unit="m/s",
            refuted_by="a limit cycle in spite of the reduction",
        ),
    ]


def draw(found: Numbers) -> Any:
    caption = (
        "Stability map. Both hold still after one nudge; a point is one run of 4 s. Small dot: still (hand below 1 cm/s rms at "
        "the end). Ring: a limit cycle, still with the passivity controller. Filled: a limit cycle with it, too; size: "
        "speed without it. Line: K_f = 0.15 as the coupling reduces it with delay (none from 150 ms on). Refuted if a ring or "
        "a filled point lies on or below the line, or a still point turns into a limit cycle under the controller (cross)."
    )
    with figures.taste():
        figure = figures.blank(7.4, 3.6, caption=caption)
        panels = figure.subplots(1, len(GRIPS), sharey=True)
        for ax, grip in zip(panels, GRIPS, strict=True):
            _panel(ax, found, grip)
        panels[0].set_ylabel("K_f")
    return figure


def _panel(ax: Any, found: Numbers, grip: str) -> None:
    hand = GRIPS[grip]
    for i, _ in enumerate(DELAYS_S):
        for j, gain in enumerate(GAINS):
            plain, passive = found.plain[grip][i, j], found.passive[grip][i, j]
            shakes, cured = plain >= STILL_M_PER_S, passive < STILL_M_PER_S
            size = 14.0 + 160.0 * min(plain, 0.5)
            if not shakes:
                ax.plot(
                    i, gain, "." if cured else "x", color=figures.ASH if cured else figures.CLAY, markersize=3 if cured else 7
                )
            else:
                face = "white" if cured else figures.INK
                ax.scatter(i, gain, s=size, facecolor=face, edgecolor=figures.INK, linewidth=0.9, zorder=3)
    rule = [TAUGHT_WITH * CouplingLimits().feedback(d) for d in DELAYS_S]
    ax.plot([i for i, k in enumerate(rule) if k > 0], [k for k in rule if k > 0], color=figures.CLAY, linewidth=1.6, zorder=2)
    ax.set_yscale("log")
    ax.set_ylim(0.012, 1.4)
    ax.set_yticks(GAINS, [f"{k:g}" for k in GAINS], minor=False)
    ax.set_yticks([], minor=True)
    ax.set_xticks(range(len(DELAYS_S)), [f"{1000 * d:g}" for d in DELAYS_S])
    ax.set_xlabel("delay there and back [ms]")
    ax.set_title(f"{grip}: {hand.mass_kg:g} kg, {hand.stiffness_n_per_m:g} N/m, {hand.damping_ns_per_m:g} N s/m", fontsize=8)


def run(out: Path, *, seed: int = 0) -> list[Claim]:
    found = numbers(seed)
    for grip in GRIPS:
        for name, ripples in (("plain", found.plain[grip]), ("passive", found.passive[grip])):
            cells = (f"{1000 * d:g} ms {k:g}" for d, k in zip(DELAYS_S, highest_still(ripples), strict=True))
            print(f"highest still K_f, {grip}, {name}: {', '.join(cells)}")
    figures.save(draw(found), out / "stability_map.png")
    return claims(found)


if __name__ == "__main__":
    script(run)
