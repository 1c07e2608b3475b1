"""The two readings of the paper's law that the figures compare, and how a figure is run as a script."""

from __future__ import annotations

import argparse
import inspect
from collections.abc import Callable, Sequence
from pathlib import Path

from comanip.evaluation.claims import Claim
from comanip.skills.paper import PaperLaw

# eqs. (4)-(10) to the letter: weights from all of xi, x_hat from the measured velocity, kappa^P of eq. (9)
LETTER = PaperLaw()

# What the text around them describes. Three departures, each argued in docs/figures.md: weights that do not listen to the model's
# own velocity, x_hat from v_hat instead of the measured velocity, and a pull that is felt three standard deviations away
READING = PaperLaw(weight_channels=("position",), target_position="predicted", gain="confidence")


def script(run: Callable[..., Sequence[Claim]]) -> None:
    """`python -m comanip.experiments.figure_N [folder]`: draws there and prints the claims."""
    text, plain = inspect.getdoc(inspect.getmodule(run)), argparse.RawTextHelpFormatter
    about = argparse.ArgumentParser(description=text, formatter_class=plain)
    about.add_argument("folder", nargs="?", type=Path, default=Path("out/figures"), help="where to draw (default: out/figures)")
    out = about.parse_args().folder
    for claim in run(out, seed=0):
        print(f"{claim.verdict}  {claim.text}: {claim.measured:.4g} ({claim.bound})")
    print(f"pictures in {out}")
