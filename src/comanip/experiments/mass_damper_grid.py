"""The best mass-damper: which M and D of a grid serves partners best, by success first and by their effort second.

The partners are drawn for tuning (seed 404) and are none of those that results are reported on. What it finds is `TUNED` in
`comanip.trials.contestants`, the baseline that a learned follower has to beat. Refuted as a baseline by a pair of the grid with
more success, or with as much and less effort.

    python -m comanip.experiments.mass_damper_grid [partners]
"""

from __future__ import annotations

import sys
from typing import NamedTuple

import numpy as np

from comanip.reproduction import enveloped
from comanip.skills.baselines import MassDamper
from comanip.trials import draw_case, judge, run_case
from comanip.trials.contestants import TUNED

MASSES_KG = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0)
DAMPINGS_NS_PER_M = (5.0, 10.0, 15.0, 20.0, 25.0, 35.0)
SEED, DT = 404, 0.01


class Pair(NamedTuple):
    mass_kg: float
    damping_ns_per_m: float
    success: float
    effort_n2s: float  # median over partners


def numbers(partners: int = 40) -> list[Pair]:
    """Every pair of the grid, the best first."""
    rng = np.random.default_rng(SEED)
    cases = [draw_case("follower", rng) for _ in range(partners)]
    found = []
    for mass in MASSES_KG:
        for damping in DAMPINGS_NS_PER_M:
            verdicts = []
            for case in cases:
                skill = enveloped(MassDamper(n_axes=1, dt=DT, mass_kg=mass, damping_ns_per_m=damping), axes=("z",), dt=DT)
                verdicts.append(judge(case, run_case(case, skill, dt=DT)))
            effort = float(np.median([v.effort_n2s for v in verdicts]))
            found.append(Pair(mass, damping, float(np.mean([v.success for v in verdicts])), effort))
    return sorted(found, key=lambda pair: (-pair.success, pair.effort_n2s))


def main(partners: int = 40) -> None:
    found = numbers(partners)
    print("   M kg  D Ns/m  success  effort N²s")
    for pair in found:
        print(f"{pair.mass_kg:7.1f} {pair.damping_ns_per_m:7.1f} {100 * pair.success:7.1f} % {pair.effort_n2s:10.2f}")
    print(f"the baseline in use: {TUNED}")


if __name__ == "__main__":
    main(*(int(a) for a in sys.argv[1:2]))
