"""The envelope's invariants over very many ticks, and against an adversary that learns.

    python tests/hammer_envelope.py [ticks [seed]]        default: a million ticks of anything, then the search

Not collected by pytest as a whole: it takes minutes. tests/laws/test_hammer.py runs a short one.

The adversary is skill and partner at once: what is wished, with what force, with what periods and lost samples. It evolves
sequences toward the most energy given and toward the place farthest behind a wall, as long as |F| <= F_lim and the clock is
honest: the envelope promises no more than the budget, and no place behind the wall.
"""

from __future__ import annotations

import sys
from math import ceil, isfinite
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from comanip.safety.limits import Limits
from envelopes import DT, Bench

NASTY = np.array([np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324, -0.0, 0.0, 1e9, -1e9])
TO_STOP = 1  # ticks more than braking takes, before a HOLD must stand (I7)


def assert_invariants(bench: Bench, last: np.ndarray, before: str, period: float) -> None:
    """I1 to I5, and that a HOLD is latched and only ever slower."""
    command, envelope, limits = bench.command, bench.envelope, bench.envelope.limits
    v = command.velocity
    assert np.isfinite([command.position, v, command.acceleration]).all(), "I1"
    assert np.linalg.norm(v) <= limits.v_max_m_per_s + 1e-12, "I2"
    assert np.linalg.norm(v - last) <= limits.a_max_m_per_s2 * period + 1e-12, "I3"
    tank = envelope.diagnostics["tank"]
    assert ((tank >= 0.0) & (tank <= limits.energy_j)).all(), "I5"
    if before:
        assert bench.held == before, "I7: latched, with the first reason"
        assert np.linalg.norm(v) <= np.linalg.norm(last) + 1e-12, "I7: slower"
    assert "checker" not in envelope.reason, "the checker had to step in"
    assert "envelope:" not in envelope.reason, "an exception inside"


def anything(rng: np.random.Generator, n: int, d: int) -> int:
    """One run of n ticks of mostly ordinary, sometimes impossible input; gives how many were ticked."""
    walls = tuple((0.0, 1.0) for _ in range(d))
    bench = Bench(Limits(workspace_m=walls), d=d, start=rng.uniform(0.02, 0.98))
    rate, force, wish, in_hold = rng.choice([0.0, 0.002, 0.02, 0.2]), np.zeros(d), np.zeros(d), 0
    slow = ceil(bench.envelope.limits.v_max_m_per_s / (bench.envelope.limits.a_max_m_per_s2 * DT)) + TO_STOP
    for _ in range(n):
        last, before = bench.command.velocity.copy(), bench.latched
        force = np.clip(force + rng.normal(0.0, 2.0, d), -60.0, 60.0)
        wish = np.clip(wish + rng.normal(0.0, 0.2, d), -2.0, 2.0)
        period = float(rng.choice([DT, DT, DT, 0.5 * DT, 2.0 * DT, 2.9 * DT]))
        seen = {}
        for name in ("position", "velocity", "sensor_force", "touch"):
            if rng.uniform() < rate:
                seen[name] = rng.choice(NASTY, d) if rng.uniform() < 0.7 else rng.normal(0.0, 50.0, d)
        if rng.uniform() < 0.3 * rate:
            seen["time"] = float(rng.choice(NASTY)) if rng.uniform() < 0.5 else bench.time + rng.normal(0.0, 0.1)
        felt = seen.pop("touch", force)
        trick = rng.choice(NASTY) if rng.uniform() < 0.2 * rate else None
        sample = rng.uniform() > 0.5 * rate
        stamp = bench.envelope._stamp
        bench.tick(wish if trick is None else trick, felt, period=period if sample else DT, sample=sample, **seen)
        counted = bench.obs.time - stamp
        assert_invariants(bench, last, before, max(counted if isfinite(counted) else 0.0, DT))
        assert all(-1e-9 <= x <= 1.0 + 1e-9 for x in bench.envelope._x), "I4"
        in_hold = in_hold + 1 if bench.latched else 0
        assert in_hold < slow or (bench.command.velocity == 0.0).all(), "I7: stands"
        if in_hold > 2 * slow:  # the person re-arms, so that a run is not one HOLD
            bench.obs.position[:], bench.obs.velocity[:], bench.obs.force[:] = bench.hand.clip(0.0, 1.0), 0.0, 0.0
            bench.obs.time = bench.time
            if not bench.envelope.rearm(bench.obs):
                force[:], wish[:], in_hold = 0.0, 0.0, 0
            bench.hand[:] = bench.obs.position
    return n


class Genes(NamedTuple):
    """One adversary: per tick, periods until the next (n,), lost sample, force along the motion and wish, both as shares."""

    periods: np.ndarray
    lost: np.ndarray
    force: np.ndarray
    wish: np.ndarray


def born(rng: np.random.Generator, n: int) -> Genes:
    return Genes(rng.uniform(0.2, 3.0, n), rng.uniform(size=n) < 0.1, rng.uniform(-1.0, 1.0, n), rng.uniform(-1.0, 1.0, n))


def mutated(genes: Genes, rng: np.random.Generator) -> Genes:
    n = len(genes.wish)
    other, part = born(rng, n), rng.uniform(size=n) < rng.choice([0.03, 0.1, 0.4])
    if rng.uniform() < 0.5:  # a stretch rather than single ticks
        start, length = int(rng.integers(n)), int(rng.integers(2, 25))
        part[:] = False
        part[start : start + length] = True
        other = Genes(*(np.full(n, rng.choice(values)) for values in other))
        if rng.uniform() < 0.5:
            other = other._replace(force=np.full(n, -1.0), wish=np.sign(other.wish))
    return Genes(*(np.where(part, new, old) for new, old in zip(other, genes, strict=True)))


def harm(genes: Genes, energy_j: float, start: float) -> tuple[float, float]:
    """(energy given to the person [J], how far behind a wall the hand came [m], negative inside)."""
    limits = Limits(workspace_m=((0.0, 1.0),), energy_j=energy_j, blocked_n=59.9, blocked_s=0.2)
    bench, given, most, behind, dropped = Bench(limits, start=start), 0.0, 0.0, -1.0, 0
    bench.tick(0.0, 0.0)
    for periods, lost, share, wish in zip(*(g.tolist() for g in genes), strict=True):
        dropped = dropped + 1 if lost else 0
        came, period = dropped == 0, DT if lost else periods * DT
        last, before = bench.command.velocity.copy(), bench.latched
        force = share * limits.force_limit_n * (float(np.sign(last[0])) or 1.0)
        bench.tick(2.0 * wish, force, period=period, sample=came)
        given -= force * float(last[0]) * period
        most, behind = max(most, given), max(behind, float(bench.hand[0]) - 1.0, -float(bench.hand[0]))
        assert_invariants(bench, last, before, max(period, DT))
    return most, behind


def search(rng: np.random.Generator, generations: int, n: int = 80, children: int = 8) -> dict[str, float]:
    """The worst that evolution finds: energy given beyond the budget [J], and place behind a wall [m]; above 0 is a breach."""
    worst = {"energy beyond the budget [J]": -np.inf, "place behind the wall [m]": -np.inf}
    for energy, start in ((0.1, 0.5), (0.5, 0.9), (3.0, 0.95), (100.0, 0.5)):
        for which, name in enumerate(worst):
            best = born(rng, n)
            score = -np.inf
            for _ in range(generations):
                for genes in [mutated(best, rng) for _ in range(children)]:
                    found = harm(genes, energy, start)
                    if found[which] >= score:
                        best, score = genes, found[which]
            worst[name] = max(worst[name], score - energy if which == 0 else score)
    return worst


def hammer(ticks: int, generations: int, seed: int) -> dict[str, float]:
    rng, done = np.random.default_rng(seed), 0
    with np.errstate(all="ignore"):
        while done < ticks:
            done += anything(rng, 500, int(rng.choice([1, 1, 3])))
            if done % 100_000 == 0:
                print(f"{done:,} ticks, no invariant broken", flush=True)
        worst = search(rng, generations)
    for name, value in worst.items():
        assert value <= 1e-9, f"{name}: {value}"
    return worst


if __name__ == "__main__":
    words = [int(word) for word in sys.argv[1:]]
    count, seed = words + [1_000_000, 0][len(words) :]
    print(hammer(count, 250, seed))
