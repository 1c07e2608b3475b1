"""What a study on the page gave, drawn: a panel a measure, the differences of every two conditions with their intervals."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Any

from .drawing import CLAY, INK, SEA, blank, label, taste
from .shown import for_drawing

MOST_LETTERS = 24


def study_picture(found: Mapping[str, Any], measures: Mapping[str, tuple[str, str, bool]]) -> Any:
    """Figure of what `page.study.analysis` found; `measures`: name -> (what it is, unit, whether more is better)."""
    pairs = list(next(iter(found["differences"].values()), {}))
    caption = (
        f"Mean paired difference and its 95 % interval over pairs of {found['pairs_are']}, {found['persons']} persons. Right of "
        "the line the first of a pair has more. An interval over the line shows no difference; others may refute any of it."
    )
    with taste():
        figure = blank(9.0, 1.1 + 0.9 * max(len(pairs), 1), title="A study on the page", caption=caption)
        panels = figure.subplots(1, len(measures) + 1, squeeze=False)[0]
        for panel, (name, (what, unit, more)) in zip(panels, measures.items(), strict=False):
            _differences(panel, found["differences"][name], more)
            panel.set_title(for_drawing(what), fontsize=7.5)
            label(panel, unit or "difference", "")
        panels[0].set_yticks(range(len(pairs)), ["\n− ".join(map(_short, pair.split(" - ", 1))) for pair in pairs], fontsize=7.5)
        for panel in panels[1:-1]:
            panel.set_yticks(range(len(pairs)), [""] * len(pairs))
        _preference(panels[-1], found["prefer"])
    return figure


def _differences(panel: Any, differences: Mapping[str, Any], more_is_better: bool) -> None:
    panel.axvline(0.0, color="#9aa0a6", lw=0.9)
    for n, d in enumerate(differences.values()):
        if d.pairs == 0 or not isfinite(d.mean):
            continue
        better = (d.mean > 0.0) == more_is_better
        colour = INK if not d.told else SEA if better else CLAY
        marker = "o" if not d.told else "^" if better else "v"  # told apart without colours, too
        if isfinite(d.low):
            panel.plot([d.low, d.high], [n, n], color=colour, lw=1.6)
        panel.plot([d.mean], [n], marker=marker, color=colour, ms=6)
    panel.margins(x=0.15)
    panel.locator_params(axis="x", nbins=3, steps=[1, 2, 5, 10])
    panel.set_ylim(len(differences) - 0.5, -0.5)


def _preference(panel: Any, prefer: Mapping[str, int]) -> None:
    names = list(prefer)
    panel.barh(range(len(names)), [prefer[name] for name in names], color=INK, height=0.5)
    panel.set_yticks(range(len(names)), [_short(name) for name in names], fontsize=7)
    panel.set_ylim(len(names) - 0.5, -0.5)
    panel.set_title("preferred by", fontsize=7.5)
    label(panel, "persons", "")


def _short(name: str) -> str:
    """A condition's name, which somebody else's file may make as long as it likes."""
    return for_drawing(name if len(name) <= MOST_LETTERS else f"{name[: MOST_LETTERS - 1]}…")
