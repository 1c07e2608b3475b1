"""Where modules of version 0.1 stand now: importing one by its old name gives the module itself, and says the new name.

Public names are `comanip.X` and never move; this is for scripts that reached into rooms.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

MOVED = {
    "alignment": "lessons.alignment",
    "checks": "lessons.faults",
    "cli_flags": "commands.flags",
    "clocks": "lessons.stamps",
    "demonstration": "lessons.demonstration",
    "devices.teacher": "people.teacher",
    "engine": "parallel",
    "evaluation.figures": "evaluation.drawing",
    "exact_step": "signals.second_order",
    "filters": "signals.filters",
    "humans": "people.intent",
    "models.baum_welch": "fitting.baum_welch",
    "models.estimators": "peers",
    "models.estimators.gaussian_hmm": "peers.gaussian_hmm",
    "models.estimators.gmm": "peers.gmm",
    "models.estimators.mvn": "peers.mvn",
    "models.estimators.regressor": "peers.regressor",
    "models.learning": "fitting.climb",
    "models.lessons": "fitting.coordinates",
    "models.selection": "fitting.selection",
    "models.streaming": "fitting.streaming",
    "plants.misbehaving": "people.misbehaving",
    "plants.partners": "people.partners",
    "sealed": "whole_file",
    "shards": "lessons.shards",
    "shown": "evaluation.shown",
    "skill_file": "learned.file",
    "skills.checker": "safety.checker",
    "skills.envelope": "safety.envelope",
    "skills.ordinary": "safety.compiled_tick",
    "skills.vectors": "signals.vectors",
    "skills.watching": "safety.detectors",
    "streamed": "learned.stream",
}


class _Moved(MetaPathFinder, Loader):
    """Asked first, and at once done with any other name."""

    def find_spec(self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> ModuleSpec | None:
        return ModuleSpec(name, self) if name.startswith("comanip.") and name[8:] in MOVED else None

    def create_module(self, spec: ModuleSpec) -> None:
        """Nothing of its own: `exec_module` puts the module itself into its place."""

    def exec_module(self, module: ModuleType) -> None:
        new = "comanip." + MOVED[module.__name__.removeprefix("comanip.")]
        warnings.warn(f"{module.__name__} is now {new}", DeprecationWarning, stacklevel=2)
        sys.modules[module.__name__] = import_module(new)


def follow() -> None:
    """From now on old names are found."""
    if not any(isinstance(finder, _Moved) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Moved())  # before a room under its old name finds a module a second time
