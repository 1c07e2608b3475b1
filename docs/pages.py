"""Pages of the site that are made, not written: the home page is the README, examples are the scripts, the API its docstrings."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parent.parent
ELSEWHERE = {  # public names that their room gives under another one, or only when asked
    "save_skill": "comanip.learned.file.save",
    "load_skill": "comanip.learned.file.load",
    "HumanoidPlant": "comanip.plants.humanoid.plant.HumanoidPlant",
}


def groups() -> dict[str, list[str]]:
    """Heading -> public names, as `comanip/__init__.py` groups them by its comments."""
    found: dict[str, list[str]] = {}
    for line in (ROOT / "src/comanip/__init__.py").read_text().split("_PUBLIC = {")[1].split("\n}")[0].splitlines():
        if line.strip().startswith("# "):
            found[line.strip()[2:]] = []
        elif match := re.match(r'\s+"(\w+)": "([\w.]+)"', line):
            [*found.values()][-1].append(f"{match[2]}:{match[1]}")
    return found


def api() -> dict[str, str]:
    """One page a group; a name is shown as `comanip.X`, and its docstring comes from the module that holds it."""
    pages = {}
    for heading, names in groups().items():
        parts = [f"# {heading}\n"]
        for entry in names:
            module, name = entry.split(":")
            where = ELSEWHERE.get(name, f"{module}.{name}")
            parts.append(f"::: {where}\n    options:\n      heading: comanip.{name}\n")
        pages[page_of(heading)] = "\n".join(parts)
    return pages


def page_of(heading: str) -> str:
    return "api/" + re.sub(r"\W+", "-", heading.lower()) + ".md"


def on_config(config: Any) -> Any:
    config.nav.append({"API": [{heading: page_of(heading)} for heading in groups()]})
    return config


def examples() -> str:
    parts = ["# Examples\n", "Each runs in seconds; a test runs them all.\n"]
    for path in sorted((ROOT / "examples").glob("[0-9]*.py")):
        text = path.read_text()
        what = (ast.get_docstring(ast.parse(text)) or "").split("\n")[0]
        parts.append(f"## {path.name}\n\n{what}\n\n```python\n{text.split(chr(10), 2)[2].strip()}\n```\n")
    return "\n".join(parts)


def home() -> str:
    return (ROOT / "README.md").read_text().replace("](docs/", "](").replace("docs/", "")


def on_files(files: Files, config: Any) -> Files:
    pages = {"index.md": home(), "examples.md": examples(), **api()}
    for name, text in pages.items():
        files.append(File.generated(config, name, content=text))
    return files
