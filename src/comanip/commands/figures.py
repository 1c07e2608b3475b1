"""figures: the paper's figures drawn again, with claims as numbers."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from ..errors import ComanipWarning, ParameterError
from ..evaluation.claims import Claim
from .console import print_json, progress, say, table
from .ending import keeping
from .outputs import may_fill, must_draw
from .running import best_plant

NUMBERS = (2, 3, 4, 5, 6, 7)
RENDERED = 1  # needs MuJoCo and a renderer, so it is drawn only when asked for


def figures(numbers: Sequence[int], out: Path, seed: int, plant: str | None, json: bool, overwrite: bool = False) -> None:
    """Draws into `out` and prints the claims; exit code 1 when one fails. Lessons of Figs. 5 to 7 are taught on `plant`."""
    chosen = tuple(dict.fromkeys(numbers)) or NUMBERS
    for number in chosen:
        if number not in (RENDERED, *NUMBERS):
            raise ParameterError(f"there is no Fig. {number} to draw; there are: {', '.join(map(str, (RENDERED, *NUMBERS)))}")
    must_draw("figures")
    may_fill(out, (_picture(out, n).name for n in chosen), overwrite=overwrite)
    import_module("comanip.experiments.lifts").use(plant or best_plant())
    if seed < 0:
        raise ParameterError(f"seed is {seed}; allowed: 0 or more")
    found: dict[int, list[Claim]] = {}
    with progress("figures") as step, warnings.catch_warnings():
        warnings.simplefilter("ignore", ComanipWarning)  # lessons are made here; their notes are of no use to the reader
        for done, number in enumerate(chosen):
            step(done, len(chosen))
            keeping(f"{done} of {len(chosen)} figures are drawn in {out}")
            found[number] = import_module(f"comanip.experiments.figure_{number}").run(out, seed=seed)
        step(len(chosen), len(chosen))
    failed = [(number, claim) for number, claims in found.items() for claim in claims if not claim.passed]
    if json:
        content = {str(n): {"picture": str(_picture(out, n)), "claims": claims} for n, claims in found.items()}
        print_json({"figures": content, "passed": not failed})
    else:
        _print(found, out)
    for number, claim in failed:
        print(f"failed: Fig. {number}: {claim.text}: {claim.measured:.4g}, wanted {claim.bound}", file=sys.stderr)
    if failed:
        sys.exit(1)


def _picture(out: Path, number: int) -> Path:
    return out / f"figure_{number}.png"


def _print(found: dict[int, list[Claim]], out: Path) -> None:
    rows = [
        (f"Fig. {number}: {claim.text}", f"{claim.measured:.3g}", claim.bound, "pass" if claim.passed else "FAIL")
        for number, claims in found.items()
        for claim in claims
    ]
    passed = sum(row[-1] == "pass" for row in rows)
    table(f"{passed} of {len(rows)} claims hold", ("claim", "measured", "bound", ""), rows)
    say("pictures: " + ", ".join(str(_picture(out, n)) for n in found))
