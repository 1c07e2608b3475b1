"""What never imports what. The rules of the house, read from the source, and a planted violation that must be noticed."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import comanip

ROOT = Path(comanip.__file__).parent
PARTS = {  # part of the house -> parts of ours that it may not know
    "interfaces": {"*"},
    "errors": {"*"},
    "kernels": {"*"},
    "models": {"skills", "plants", "devices", "loop", "web", "commands", "cli", "evaluation", "teaching", "trials", "learned"},
    "skills": {"plants", "devices", "recorder", "web", "loop", "commands", "cli", "evaluation", "teaching", "trials"},
    "plants": {"models", "skills", "devices", "loop", "web", "commands", "cli", "evaluation", "learned"},
    "devices": {"models", "skills", "plants", "loop", "web", "commands", "cli", "evaluation", "learned"},
    "formats": {"models", "skills", "plants", "devices", "loop", "web", "commands", "cli", "evaluation", "learned"},
}
LEAVES = {"cli", "commands", "web", "experiments"}  # only leaves may import leaves
ONLY_IN = {  # outside library -> files that may import it
    "mujoco": ("plants/",),
    "matplotlib": (
        "evaluation/figures.py",
        "models/estimators/mvn.py",
    ),  # the second: gmr's interface draws ellipses on given axes
    "cyclopts": ("cli.py", "cli_flags.py"),
    "mcap": ("formats/",),
    "pyarrow": ("shards.py",),
    "distributed": ("engine.py",),
    "joblib": ("engine.py",),
    "rich": ("commands/", "cli.py"),
}


def imported(path: Path, source: str) -> tuple[set[str], set[str]]:
    """(parts of comanip, outside libraries) that a module imports anywhere in its text."""
    package = ("comanip", *path.relative_to(ROOT).with_suffix("").parts)[: -1 if path.name != "__init__.py" else None]
    if path.name == "__init__.py":
        package = ("comanip", *path.relative_to(ROOT).parent.parts)
    ours, others = set(), set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            target = [*base, *(node.module.split(".") if node.module else [])]
            names = [[*target, a.name] for a in node.names] if target == ["comanip"] else [target]
        elif isinstance(node, ast.Import):
            names = [a.name.split(".") for a in node.names]
        else:
            continue
        for name in names:
            if name[0] == "comanip":
                ours.add(name[1] if len(name) > 1 else "")
            else:
                others.add(name[0])
    return ours, others


def violations(path: Path, source: str) -> list[str]:
    relative = path.relative_to(ROOT).as_posix()
    part = relative.split("/")[0].removesuffix(".py")
    ours, others = imported(path, source)
    ours.discard(part)
    found = []
    forbidden = PARTS.get(part, set())
    found += [f"{relative} imports {name}" for name in ours if "*" in forbidden or name in forbidden]
    if part not in LEAVES:
        found += [f"{relative} imports the leaf {name}" for name in ours & (LEAVES - {"web"})]
    found += [
        f"{relative} imports {library}"
        for library, allowed in ONLY_IN.items()
        if library in others and not relative.startswith(allowed)
    ]
    return found


def test_nothing_imports_what_it_must_not():
    wrong = [v for path in ROOT.rglob("*.py") for v in violations(path, path.read_text())]
    assert wrong == []


def test_a_planted_violation_is_noticed():
    assert violations(ROOT / "models" / "planted.py", "from ..skills.paper import PaperLaw\n")
    assert violations(ROOT / "plants" / "planted.py", "def f():\n    from ..models import hmm\n")
    assert violations(ROOT / "interfaces.py", "from .recording import Recording\n")
    assert violations(ROOT / "skills" / "planted.py", "import matplotlib.pyplot as plt\n")
    assert violations(ROOT / "trials.py", "from .commands import demo\n")
    assert not violations(ROOT / "models" / "planted.py", "from ..errors import ParameterError\nimport numpy\n")


def loaded_after(statement: str) -> set[str]:
    code = f"import sys; {statement}; print(*sorted({{m.split('.')[0] for m in sys.modules}}))"
    return set(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split())


def test_nothing_heavy_is_loaded_by_import_or_help():
    heavy = {"numpy", "scipy", "matplotlib", "mcap", "joblib", "distributed", "pyarrow", "sklearn", "mujoco"}
    assert not loaded_after("import comanip") & heavy
    assert not loaded_after("import comanip.cli") & heavy
    learning = loaded_after("import comanip.learned, comanip.skill_file")
    assert not learning & (heavy - {"numpy"})
