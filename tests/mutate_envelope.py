"""Changes one operator or number at a time in a copy of the envelope's modules and counts how many of them the tests notice.

    python tests/mutate_envelope.py [n [seed]]        n of them drawn at random: the score, and which survived

Nobody chose them by hand: every comparison, sum, product, min, max, negation and number of the modules below may be drawn.
Not collected by pytest: it takes minutes. The Python is changed, and the C kernels are off.
"""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parent.parent
SOURCES = (*(f"safety/{one}.py" for one in "envelope bounds situation detectors checker".split()), "interaction.py")
TESTS = [
    "tests/faults/test_controller_faults.py", "tests/faults/test_safety_faults.py", "tests/faults/test_matching_parts.py",
    "tests/laws/test_envelope_laws.py", "tests/test_interaction.py",
]  # fmt: skip
OTHER = {
    ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip
NAMES = {"min": "max", "max": "min"}
PLUGIN = """from hypothesis import Phase, settings
settings.register_profile("unshrunk", phases=[Phase.explicit, Phase.generate])
settings.load_profile("unshrunk")
"""  # a defect is caught by any failure; the shortest one is of no interest


class Change(ast.NodeTransformer):
    """Changes the `nth` place that can be changed; `seen` counts them, `said` says which it was."""

    def __init__(self, nth: int) -> None:
        self.nth, self.seen, self.said = nth, 0, ""

    def here(self, node: ast.AST) -> bool:
        self.seen += 1
        if self.seen - 1 == self.nth:
            self.said = f"line {node.lineno}: {ast.unparse(node)[:70]}"
        return bool(self.seen - 1 == self.nth)

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        self.generic_visit(node)
        if type(node.ops[0]) in OTHER and self.here(node):
            node.ops[0] = OTHER[type(node.ops[0])]()
        return node

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        if type(node.op) in OTHER and self.here(node):
            node.op = OTHER[type(node.op)]()
        return node

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.AST:
        self.generic_visit(node)
        if self.here(node):
            node.op = OTHER[type(node.op)]()
        return node

    def visit_Name(self, node: ast.Name) -> ast.AST:
        if node.id in NAMES and self.here(node):
            node.id = NAMES[node.id]
        return node

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        if type(node.value) is float and self.here(node):
            node.value = 2.0 * node.value if node.value else 1.0
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        if node.value is not None:
            node.value = self.visit(node.value)
        return node


def places(name: str) -> int:
    counted = Change(-1)
    counted.visit(ast.parse((ROOT / "src/comanip" / name).read_text()))
    return counted.seen


def noticed(folder: Path) -> bool:
    path = os.pathsep.join([str(folder), str(ROOT / "tests")])
    quick = ["-x", "-q", "-p", "no:cacheprovider", "-p", "unshrunk", "-k", "not living_partners and not C22"]
    command = [sys.executable, "-m", "pytest", *quick, *TESTS]
    environment = {**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1", "COMANIP_KERNELS": "numpy"}
    try:
        return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, timeout=120).returncode != 0
    except subprocess.TimeoutExpired:
        return True


def survives(name: str, nth: int, folder: Path) -> str:
    """What was changed, if no test noticed."""
    source, copy = (ROOT / "src/comanip" / name).read_text(), folder / "comanip" / name
    change = Change(nth)
    copy.write_text(ast.unparse(change.visit(ast.parse(source))))
    try:
        seen = noticed(folder)
    finally:
        copy.write_text(source)
    print("caught  " if seen else "SURVIVES", name, change.said, flush=True)
    return "" if seen else f"{name} {change.said}"


def main() -> None:
    n, seed = ([int(a) for a in sys.argv[1:]] + [40, 0][len(sys.argv) - 1 :])[:2]
    every = [(name, nth) for name in SOURCES for nth in range(places(name))]
    drawn = np.random.default_rng(seed).permutation(len(every))[:n]
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        (folder / "unshrunk.py").write_text(PLUGIN)
        shutil.copytree(ROOT / "src/comanip", folder / "comanip")
        if noticed(folder):
            sys.exit("the tests fail without any change")
        alive = [said for i in drawn if (said := survives(*every[i], folder))]
    print(f"{len(drawn) - len(alive)} of {len(drawn)} caught ({len(every)} there are); alive: {'; '.join(alive) or 'none'}")


if __name__ == "__main__":
    main()
