"""Changes one place at a time in the safety rooms and counts how many of the changes their tests notice.

    python tests/mutate_envelope.py [--rooms checker detectors ...] [--number 30] [--seed 0]

What is changed is chosen by Cosmic Ray (pip install cosmic-ray), not by us: numbers by one, sums and products, comparisons,
and/or/not, loops that never run, exceptions; `--number` of each room are drawn at random. Its replacements that give an error of
types at once (a bit shift of a float) are left out: anything would notice them.
The Python is changed and the C kernels are off, so what notices is how it behaves and not the comparison with its twin. Each
change is tried in a fork of one process, by the tests that are named for its room. Not collected by pytest: it takes an hour.
"""

from __future__ import annotations

import argparse
import importlib.abc
import importlib.util
import os
import resource
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

ROOT = Path(__file__).parent.parent
FAULTS, SAFETY = "tests/faults/test_controller_faults.py", "tests/faults/test_safety_faults.py"
LAWS, FITS = "tests/laws/test_envelope_laws.py", "tests/faults/test_matching_parts.py"
WATCHES, RULES = "tests/skills/test_watching.py", "tests/skills/test_envelope_rules.py"
FORCE = ("tests/test_interaction.py", "tests/test_interaction_wrench.py")
ROOMS: dict[str, tuple[str, tuple[str, ...]]] = {  # room -> (its module, the tests that are to notice, quick ones first)
    "checker": ("safety/checker.py", (RULES, LAWS, SAFETY)),
    "detectors": ("safety/detectors.py", (WATCHES, RULES, FAULTS, SAFETY)),
    "situation": ("safety/situation.py", (RULES, WATCHES, FAULTS, SAFETY)),
    "bounds": ("safety/bounds.py", (RULES, FAULTS, LAWS, SAFETY)),
    "envelope": ("safety/envelope.py", (RULES, FAULTS, FITS, LAWS, SAFETY)),
    "limits": ("safety/limits.py", ("tests/skills/test_limits.py", RULES, FAULTS, SAFETY)),
    "reasons": ("safety/reasons.py", ("tests/skills/test_reasons.py",)),
    "interaction": ("interaction.py", FORCE),
    "roles": ("skills/roles.py", ("tests/skills/test_roles.py",)),
}
SENSELESS = ("Mod", "Pow", "FloorDiv", "Shift", "Bit", "Invert", "VariableReplacer", "VariableInserter", "RemoveDecorator")
UNSHRUNK = ("living_partners", "C22")  # too slow, and about other rooms
MOST_S = 900  # of processor: a change that makes the tests so slow is noticed; the slowest room's own take some 300 s


class Place(NamedTuple):
    """One change: Cosmic Ray's operator and where it applies."""

    operator: str
    occurrence: int


class Changed(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Imports one module from other text than its file's."""

    def __init__(self, name: str, path: Path, text: str) -> None:
        self._name, self._path, self._text = name, path, text

    def find_spec(self, fullname: str, path: object, target: object = None) -> importlib.machinery.ModuleSpec | None:
        if fullname != self._name:
            return None
        return importlib.util.spec_from_file_location(fullname, self._path, loader=self)

    def exec_module(self, module: ModuleType) -> None:
        exec(compile(self._text, str(self._path), "exec"), module.__dict__)


def operators() -> dict[str, Any]:
    """Cosmic Ray's, and a number twice as large: by one is very much for a threshold of 0.02 N."""
    import parso
    from cosmic_ray.operators.operator import Operator
    from cosmic_ray.plugins import get_operator, operator_names

    class Doubled(Operator):
        def mutation_positions(self, node: Any) -> Iterator[Any]:
            if isinstance(node, parso.python.tree.Number) and "." in node.value:
                yield node.start_pos, node.end_pos

        def mutate(self, node: Any, index: int) -> Any:
            return parso.python.tree.Number(f" {2.0 * float(node.value) or 1.0}", node.start_pos)

        @classmethod
        def examples(cls) -> tuple[Any, ...]:
            return ()

    chosen = [name for name in sorted(operator_names()) if not any(word in name for word in SENSELESS)]
    return {**{name: get_operator(name)() for name in chosen}, "doubled": Doubled()}


def places(text: str) -> list[Place]:
    from cosmic_ray.ast import ast_nodes, get_ast

    tree, found = get_ast(text), []
    for name, operator in operators().items():
        where = [node for node in ast_nodes(tree) for _ in operator.mutation_positions(node)]
        found += [Place(name, n) for n, node in enumerate(where) if not in_annotation(node)]
    return found


def in_annotation(node: Any) -> bool:
    """A type, which nothing looks at when it runs."""
    while node is not None:
        parent = node.parent
        if parent is not None and parent.type == "annassign" and parent.children[1] is node:
            return True
        if parent is not None and parent.type == "tfpdef" and parent.children[-1] is node:
            return True
        node = parent
    return False


def changed(text: str, place: Place) -> str:
    from cosmic_ray.mutating import mutate_code

    return mutate_code(text, operators()[place.operator], place.occurrence) or text


def said(old: str, new: str) -> str:
    """The line that differs."""
    for n, (a, b) in enumerate(zip(old.splitlines(), new.splitlines(), strict=False), 1):
        if a != b:
            return f"{n}: {a.strip()}  ->  {b.strip()}"
    return "the same"


def _tests(finder: Changed | None, tests: Sequence[str], log: Path) -> int:
    """In a fork: pytest's exit code."""
    import pytest
    from hypothesis import Phase, settings

    if finder is not None:
        sys.meta_path.insert(0, finder)
    settings.register_profile("unshrunk", phases=[Phase.explicit, Phase.generate], database=None, derandomize=True)
    settings.load_profile("unshrunk")  # a defect is caught by any failure; the shortest one is of no interest
    out = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(out, 1), os.dup2(out, 2)
    left_out = " and ".join(f"not {word}" for word in UNSHRUNK)
    return int(pytest.main(["-x", "-q", "-n", "0", "-p", "no:cacheprovider", "-p", "no:randomly", "-k", left_out, *tests]))


def noticed(finder: Changed | None, tests: Sequence[str], log: Path) -> bool:
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        resource.setrlimit(resource.RLIMIT_CPU, (MOST_S, MOST_S))
        code = 1
        try:
            code = _tests(finder, tests, log)
        finally:
            os._exit(code)
    _, status = os.waitpid(child, 0)
    return status != 0


def try_room(room: str, number: int, seed: int, log: Path) -> tuple[int, list[str]]:
    name, tests = ROOMS[room]
    path = ROOT / "src/comanip" / name
    text = path.read_text()
    if noticed(None, tests, log):
        sys.exit(f"{room}: its tests fail without any change: {log}")
    every = places(text)
    drawn = np.random.default_rng([seed, len(every)]).permutation(len(every))[:number]
    module, alive, tried = "comanip." + name.removesuffix(".py").replace("/", "."), [], 0
    for i in drawn:
        new = changed(text, every[i])
        if new == text:
            continue
        seen = noticed(Changed(module, path, new), tests, log)
        tried += 1
        what = f"{name} {said(text, new)}"
        print("caught  " if seen else "SURVIVES", what, flush=True)
        if not seen:
            alive.append(what)
    print(f"{room}: {tried - len(alive)} of {tried} caught ({len(every)} there are)", flush=True)
    return tried, alive


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--rooms", nargs="*", default=list(ROOMS), choices=list(ROOMS))
    asked.add_argument("--number", type=int, default=30)
    asked.add_argument("--seed", type=int, default=0)
    given = asked.parse_args()
    os.environ["COMANIP_KERNELS"] = "numpy"
    os.chdir(ROOT)
    sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "src")]
    log, tried, alive = Path(tempfile.gettempdir()) / f"mutants-{os.getpid()}.log", 0, []
    for room in given.rooms:
        n, left = try_room(room, given.number, given.seed, log)
        tried, alive = tried + n, alive + left
    p, n = (tried - len(alive)) / tried, tried
    half = 1.96 * np.sqrt(p * (1.0 - p) / n + 1.96**2 / (4.0 * n**2)) / (1.0 + 1.96**2 / n)
    middle = (p + 1.96**2 / (2.0 * n)) / (1.0 + 1.96**2 / n)
    print(f"{tried - len(alive)} of {tried} caught, {100 * p:.1f} % ({100 * (middle - half):.1f} to {100 * (middle + half):.1f})")
    print("alive:", *(alive or ["none"]), sep="\n  ")


if __name__ == "__main__":
    main()
