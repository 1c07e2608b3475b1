"""Commands stopped at random times, by Control-C and by kill -9: no traceback, nobody left, every output whole or absent.

python tests/hammer_commands.py 20 [COMMAND ...]     # times each, of each kind; prints a line a command
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from comanip.errors import ComanipError
from comanip.formats import read
from comanip.learned.file import FORMAT, load
from test_ending import COMANIP, gone, started

COMMANDS = {  # name -> (words, about how long it takes [s])
    "teach": ("teach --role leader --lessons 40 -o out", 6.0),
    "demo": ("demo --plant beam --out out", 12.0),
    "trial": ("trial --role follower --partners 200 --workers 2 --skill skill.json", 6.0),
    "learn": ("learn lessons -o out/skill.json --states auto", 5.0),
    "run": ("run skill.json --role follower --robot beam --realtime --preflight-s 1 --out out/run.mcap", 8.0),
    "figures": ("figures 4 5 --plant beam --out out", 12.0),
}


def prepared(folder: Path) -> None:
    """Six lessons and a skill for whoever needs them."""
    for words in (f"teach --role follower --lessons 6 -o {folder}/lessons", f"learn {folder}/lessons -o {folder}/skill.json"):
        subprocess.run([*COMANIP, *words.split()], check=True, capture_output=True)


def whole(path: Path) -> str:
    """Nothing, or what is wrong with an output."""
    if path.name.startswith(".") or path.suffix == ".tmp":
        return f"{path.name} is left over"
    if path.name.endswith(".live.mcap"):
        return ""  # the take as far as it went: `comanip recover` makes a whole file of it
    try:
        if path.suffix == ".json" and json.loads(path.read_text()).get("format") == FORMAT:
            load(path)
        if path.suffix == ".png":
            return "" if path.read_bytes().endswith(b"IEND\xaeB`\x82") else f"{path.name} is cut"
        if path.suffix == ".html":
            return "" if path.read_text().rstrip().endswith("</html>") else f"{path.name} is cut"
        if path.suffix in (".mcap", ".csv"):
            read(path)
    except (ComanipError, ValueError, OSError) as error:
        return f"{path.name}: {error}"
    return ""


def once(name: str, folder: Path, after_s: float, how: int) -> list[str]:
    """What was wrong when a command was stopped after so long."""
    words = COMMANDS[name][0].split()
    process = started(*words, cwd=folder)
    try:
        process.wait(after_s)
        ended = True
    except subprocess.TimeoutExpired:
        ended = False
        (os.killpg if how == signal.SIGINT else os.kill)(process.pid, how)
    out, err = process.communicate(timeout=120)
    begun = "comanip" in err + out or not err  # before that it is Python's own start, in which nobody can answer
    wrong = [f"a traceback: {err}"] if "Traceback" in err + out and begun else []
    if not ended and how == signal.SIGINT and process.returncode not in (130, 0) and begun:
        wrong.append(f"code {process.returncode}: {err[-200:]}")
    if not gone(process.pid, 20.0):
        wrong.append("somebody is left")
    for path in (folder / "out").rglob("*") if (folder / "out").is_dir() else ():
        if path.is_file() and (said := whole(path)) and not (how == signal.SIGKILL and said.endswith("is left over")):
            wrong.append(said)
    return [f"{name}, {signal.Signals(how).name} after {after_s:.2f} s: {one}" for one in wrong]


def hammer(base: Path, name: str, count: int, how: int, seed: int = 0) -> list[str]:
    """What was wrong with a command that was stopped `count` times, in folders below a prepared one."""
    rng, found = np.random.default_rng(seed), []
    for n in range(count):
        folder = base / f"{name}-{int(how)}-{n}"
        folder.mkdir()
        for needed in ("lessons", "skill.json"):
            (folder / needed).symlink_to(base / needed)
        found += once(name, folder, float(rng.uniform(0.05, COMMANDS[name][1])), how)
    return found


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it, and so would its children
    with tempfile.TemporaryDirectory() as base:
        prepared(Path(base))
        for name in sys.argv[2:] or COMMANDS:
            for how in (signal.SIGINT, signal.SIGKILL):
                began = time.monotonic()
                wrong = hammer(Path(base), name, int(sys.argv[1]), how)
                print(f"{name}, {how.name}: {len(wrong)} wrong of {sys.argv[1]} in {time.monotonic() - began:.0f} s", flush=True)
                print("\n".join(wrong), flush=True)
