"""Five lessons a role taught on the page by real mouse events, learned there and by `comanip learn`, tried by `comanip trial`:
`python tests/page/taught_there.py [partners] [seed] [task]`, default 200 usual partners a role."""

from __future__ import annotations

import json
import random
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from comanip.learned.file import load
from comanip.page.export import write_page
from comanip.teaching import ROLES
from comanip.trials.taught import taught
from page.browser import browser, opened, teach


def kept(tab: Any, folder: Path, kind: str) -> list[Path]:
    """What "Keep all" keeps, as files."""
    with tab.expect_download() as one:
        tab.click(f"#teach button:has-text('Keep all as {kind}')")
    one.value.save_as(folder / f"{kind}.zip")
    with zipfile.ZipFile(folder / f"{kind}.zip") as bundled:
        bundled.extractall(folder)
        return sorted(folder / name for name in bundled.namelist())


def main(partners: int, seed: int, task: str) -> None:
    folder = Path(tempfile.mkdtemp())
    with browser() as one:
        write_page({role: taught(role, seed=0, task=task) for role in ROLES}, folder / "lift.html", task=task)
        with opened(one, folder / "lift.html") as tab:
            for role in ROLES:
                tries = teach(tab, role, 5, random.Random(f"{seed} {role}"))
                print(f"{role}: 5 lessons in {tries} tries", flush=True)
                tab.click("#teach button:has-text('Learn from these')")
                tab.click("#tab-teach")
                with tab.expect_download() as learned:
                    tab.click("#teach button:has-text('Keep the skill')")
                learned.value.save_as(folder / f"{role}-page.json")
            files = {kind: kept(tab, folder, kind) for kind in ("CSV", "MCAP")}
    for kind, of in files.items():
        skills = []
        for role in ROLES:
            lessons = [str(file) for file in of if file.name.startswith(role)]
            skill = folder / f"{role}-{kind}.json"
            subprocess.run(
                [sys.executable, "-m", "comanip", "learn", *lessons, "-o", str(skill)], check=True, capture_output=True
            )
            skills.append(str(skill))
            here, there = load(folder / f"{role}-page.json"), load(skill)
            apart = max(float(np.abs(getattr(here.model, n) - getattr(there.model, n)).max()) for n in ("means", "covariances"))
            print(f"{role}, {kind}: learned on the page and by comanip learn, farthest apart {apart:.1e}", flush=True)
        print(f"{kind}: learned {', '.join(skills)}", flush=True)
    for role, skill in zip(ROLES, skills, strict=True):
        command = [sys.executable, "-m", "comanip", "trial", "--role", role, "--task", task, "--skill", skill, "--partners", str(partners), "--seed", str(seed), "--json"]  # fmt: skip
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        print(role, json.dumps(json.loads(done.stdout))[:1500], flush=True)


if __name__ == "__main__":
    given = sys.argv[1:]
    main(int(given[0]) if given else 200, int(given[1]) if len(given) > 1 else 20263, given[2] if len(given) > 2 else "lift")
