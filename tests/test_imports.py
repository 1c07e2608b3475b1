"""What never imports what. The rules of the house, read from the source, and a planted violation that must be noticed."""

from __future__ import annotations

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import comanip

ROOT = Path(comanip.__file__).parent
BASE = {"errors", "interfaces", "kernels", "signals", "recording"}
ROOMS = {  # room of the house, or module at its top -> what of ours it may import, along a lesson's way from file to robot
    "errors": set(),
    "interfaces": set(),
    "kernels": {"errors"},
    "whole_file": set(),
    "moved": set(),
    "parts": {"errors"},
    "cli": {"commands"},
    "__main__": {"commands"},
    "signals": {"errors", "interfaces"},
    "recording": {"errors", "interfaces", "kernels"},
    "parallel": {"errors", "__version__"},
    "interaction": BASE,
    "loop": BASE,
    "formats": {*BASE, "parts", "parallel", "whole_file"},
    "lessons": {*BASE, "formats", "interaction"},
    "models": BASE,
    "fitting": {*BASE, "models", "parallel", "whole_file"},
    "peers": {*BASE, "models", "fitting"},
    "safety": BASE,
    "skills": {*BASE, "models"},
    "learned": {*BASE, "parts", "lessons", "models", "fitting", "skills", "parallel", "whole_file", "__version__"},
    "reproduction": {*BASE, "parts", "learned", "models", "skills", "safety"},
    "export": {*BASE, "parts", "interaction", "learned", "models", "reproduction", "safety", "skills", "__version__"},
    "people": {*BASE, "parts"},
    "devices": BASE,
    "plants": {*BASE, "interaction", "people"},
    "tasks": {*BASE, "parts", "people"},
    "teaching": {*BASE, "parts", "devices", "interaction", "loop", "people", "plants", "skills", "tasks"},
    "evaluation": {*BASE, "learned", "lessons", "loop", "models", "people", "plants", "skills", "tasks", "whole_file"},
    "trials": {
        *BASE,
        "parts",
        "evaluation",
        "interaction",
        "learned",
        "loop",
        "parallel",
        "people",
        "plants",
        "reproduction",
        "safety",
        "skills",
        "tasks",
        "teaching",
        "lessons",
    },
    "gym": {
        *BASE,
        "errors",
        "interaction",
        "learned",
        "loop",
        "parts",
        "people",
        "plants",
        "reproduction",
        "safety",
        "skills",
        "tasks",
        "trials",
    },
    "robots": {
        *BASE,
        "formats",
        "interaction",
        "learned",
        "loop",
        "people",
        "plants",
        "reproduction",
        "safety",
        "skills",
        "tasks",
        "trials",
    },
    "web": {*BASE, "trials", "evaluation"},
    "page": {*BASE, "formats", "interaction", "learned", "reproduction", "skills", "safety", "tasks", "whole_file"},
}
LEAVES = {"commands", "experiments", "__init__"}  # may import anything, and nothing imports them
LOOSE = 12  # modules at the top of the house, at most
ONLY_IN = {  # outside library -> files that may import it
    "mujoco": ("plants/",),
    "matplotlib": ("evaluation/drawing.py", "peers/mvn.py"),  # the second: gmr's interface draws ellipses on given axes
    "cyclopts": ("commands/app.py", "commands/flags.py", "commands/on_the_page.py"),
    "mcap": ("formats/",),
    "pyarrow": ("lessons/shards.py", "formats/parquet_file.py", "formats/lerobot_write.py"),
    "h5py": ("formats/hdf5_file.py", "formats/hdf5_inside.py", "formats/mat73_file.py"),
    "distributed": ("parallel.py",),
    "joblib": ("parallel.py",),
    "rich": ("commands/",),
    "zenoh": ("robots/zenoh_wire.py",),
    "cyclonedds": ("robots/dds_wire.py",),
    "rclpy": ("robots/rclpy_wire.py",),
    "gymnasium": ("gym/",),
    "pettingzoo": ("gym/",),
    "onnxruntime": ("trials/onnx_policy.py",),
    "stable_baselines3": ("trials/sb3_policy.py",),
}


def imported(path: Path, source: str) -> tuple[set[str], set[str]]:
    """(rooms of comanip, outside libraries) that a module imports anywhere in its text, through `import_module`, too."""
    package = ("comanip", *path.relative_to(ROOT).parent.parts)
    ours, others = set(), set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            target = [*base, *(node.module.split(".") if node.module else [])]
            names = [[*target, a.name] for a in node.names] if target == ["comanip"] else [target]
        elif isinstance(node, ast.Import):
            names = [a.name.split(".") for a in node.names]
        elif isinstance(node, ast.Call) and getattr(node.func, "id", getattr(node.func, "attr", "")) == "import_module":
            words = [n.value for n in ast.walk(node.args[0]) if isinstance(n, ast.Constant) and isinstance(n.value, str)]
            names = [words[0].rstrip(".").split(".")] if words else []
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
    room = relative.split("/")[0].removesuffix(".py")
    ours, others = imported(path, source)
    found = []
    if room not in LEAVES:
        found += [f"{relative} imports {name}" for name in ours - {room} - ROOMS.get(room, set())]
    found += [
        f"{relative} imports {library}"
        for library, allowed in ONLY_IN.items()
        if library in others and not relative.startswith(allowed)
    ]
    return found


def rooms() -> set[str]:
    return {p.name.removesuffix(".py") for p in ROOT.iterdir() if p.suffix == ".py" or (p / "__init__.py").exists()}


def test_every_room_has_its_entry_and_every_entry_its_room():
    assert rooms() - LEAVES == set(ROOMS)
    assert {word for allowed in ROOMS.values() for word in allowed} - {"__version__"} <= rooms()


def test_few_modules_stand_outside_a_room():
    loose = [p.name for p in ROOT.glob("*.py") if not p.name.startswith("__")]
    assert len(loose) <= LOOSE, sorted(loose)


def test_no_two_rooms_import_each_other():
    """Anywhere in their text, so inside functions, too; the entries above are an order."""
    left = {room: set(allowed) & set(ROOMS) for room, allowed in ROOMS.items()}
    while ready := [room for room, allowed in left.items() if not allowed & left.keys()]:
        for room in ready:
            del left[room]
    assert not left, f"in a circle: {sorted(left)}"


def module_of(name: str) -> Path | None:
    """The file of a module of ours by its dotted name, None for anything else."""
    stem = ROOT.joinpath(*name.split(".")[1:])
    return next((f for f in (stem.with_suffix(".py"), stem / "__init__.py") if name.startswith("comanip") and f.exists()), None)


def needs(path: Path, source: str) -> set[Path]:
    """Modules of ours that a module imports while it runs, inside functions, too; not what only type checkers read."""
    package = ["comanip", *path.relative_to(ROOT).parent.parts]
    tree, found = ast.parse(source), set()
    checked = [n for n in ast.walk(tree) if isinstance(n, ast.If) and "TYPE_CHECKING" in ast.unparse(n.test)]
    only_typed = {id(inner) for block in checked for line in block.body for inner in ast.walk(line)}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and id(node) not in only_typed:
            base = package[: len(package) - node.level + 1] if node.level else []
            whole = ".".join([*base, *(node.module.split(".") if node.module else [])])
            found |= {module_of(f"{whole}.{a.name}") or module_of(whole) for a in node.names}
        elif isinstance(node, ast.Import):
            found |= {module_of(a.name) for a in node.names}
    return {f for f in found if f is not None} - {path}


def in_circles(graph: dict[Path, set[Path]]) -> list[str]:
    """What is left when whatever needs nothing more is taken away, again and again; and then what nothing left needs."""
    left = dict(graph)
    while done := [f for f in left if not graph[f] & left.keys()] or [f for f in left if not any(f in graph[g] for g in left)]:
        for file in done:
            del left[file]
    return sorted(f.relative_to(ROOT).as_posix() for f in left)


def test_no_two_modules_need_each_other():
    """By any way round, inside functions, too: a helper that is imported late to get out of a circle stands in the wrong file."""
    graph = {path: needs(path, path.read_text()) for path in ROOT.rglob("*.py")}
    assert in_circles(graph) == []
    one, other = ROOT / "lessons" / "lesson.py", ROOT / "lessons" / "agreement.py"
    assert other in needs(one, "def f():\n    from .agreement import check_set\n")
    graph[one] |= {other}
    assert {"lessons/agreement.py", "lessons/lesson.py"} <= set(in_circles(graph))


def test_no_module_is_longer_than_500_lines():
    long = {p.name: n for p in ROOT.rglob("*.py") if (n := len(p.read_text().splitlines())) > 500}
    assert long == {}


def test_nothing_imports_what_it_must_not():
    wrong = [v for path in ROOT.rglob("*.py") for v in violations(path, path.read_text())]
    assert wrong == []


def test_a_planted_violation_is_noticed():
    assert violations(ROOT / "models" / "planted.py", "from ..skills.paper import PaperLaw\n")
    assert violations(ROOT / "plants" / "planted.py", "def f():\n    from ..models import hmm\n")
    assert violations(ROOT / "interfaces.py", "from .recording import Recording\n")
    assert violations(ROOT / "skills" / "planted.py", "import matplotlib.pyplot as plt\n")
    assert violations(ROOT / "loop.py", "from .commands import demo\n")
    assert violations(
        ROOT / "plants" / "planted.py", "from importlib import import_module\nimport_module('comanip.models.hmm')\n"
    )
    assert not violations(ROOT / "models" / "planted.py", "from ..errors import ParameterError\nimport numpy\n")


def loaded_after(statement: str) -> set[str]:
    code = f"import sys; {statement}; print(*sorted({{m.split('.')[0] for m in sys.modules}}))"
    return set(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split())


def test_nothing_heavy_is_loaded_by_import_or_help():
    heavy = {"numpy", "scipy", "matplotlib", "mcap", "joblib", "distributed", "pyarrow", "sklearn", "mujoco"}
    assert not loaded_after("import comanip") & heavy
    assert not loaded_after("import comanip.commands.app") & heavy
    learning = loaded_after("import comanip.learned.skill, comanip.learned.file")
    assert not learning & (heavy - {"numpy"})


def test_a_module_that_moved_is_found_by_its_old_name_and_says_the_new_one():
    from comanip.moved import MOVED

    assert {old for old in MOVED if (ROOT / (old.replace(".", "/") + ".py")).exists()} == set()
    lines = [f"import comanip.{old} as old, comanip.{new} as new; assert old is new" for old, new in MOVED.items()]
    command = [sys.executable, "-W", "always", "-c", "\n".join(lines)]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    told = [f"comanip.{old} is now comanip.{new}" for old, new in MOVED.items()]
    assert [line for line in told if line not in said] == []


def test_a_name_that_never_was_is_still_missing():
    with pytest.raises(ModuleNotFoundError, match=r"comanip\.demonstrations"):
        importlib.import_module("comanip.demonstrations")
