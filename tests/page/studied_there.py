"""A study of three laws, four lifts each, by real mouse events, analysed by `comanip study`:
`python tests/page/studied_there.py FOLDER [persons]`, default one person; the figure is FOLDER/study.png."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from comanip.page.export import write_page
from comanip.teaching import ROLES
from comanip.trials.taught import taught
from page.browser import browser, kept_study, opened, studied


def main(folder: Path, persons: int) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    write_page({role: taught(role, seed=0) for role in ROLES}, folder / "lift.html")
    files = []
    with browser() as one:
        for number in range(persons):
            with opened(one, folder / "lift.html") as tab:
                print(number, studied(tab, number, trials=4), flush=True)
                files.append(str(kept_study(tab, "Keep the file", folder / f"person-{number}.jsonl")))
    subprocess.run(
        [sys.executable, "-m", "comanip", "study", *files, "--plot", str(folder / "study.png"), "--overwrite"], check=True
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 1)
