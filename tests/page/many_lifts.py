"""Scripted lifts with real mouse and touch events: `python tests/page/many_lifts.py [lifts] [roles] [seed] [task] [--real-time]`.

Default 100 lifts a role: half by mouse at 1280 x 800, half by finger at 390 x 844. Of the robot that is told nothing, the person
leads every other lift. Prints success by the page's judge and why not; with --real-time, on a machine that does nothing else, frames
a second and latency, too (12 minutes a role).
"""

from __future__ import annotations

import random
import sys
import tempfile
from collections import Counter
from math import nan
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from comanip.page.export import write_page
from comanip.teaching import ROLES
from comanip.trials.taught import taught
from page.browser import Finger, Mouse, browser, follow, lead, opened

DESK = {"viewport": {"width": 1280, "height": 800}}
PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
FRAMES = """() => new Promise(done => { const at = []; const next = t => { at.push(t); at.length > 120
    ? done(1000 * 120 / (at[120] - at[0])) : requestAnimationFrame(next) }; requestAnimationFrame(next) })"""


def lifts(one: Any, file: Path, role: str, count: int, seed: int, *, finger: bool, real_time: bool) -> tuple[int, Counter[str]]:
    """How many of `count` succeeded, and why the others did not."""
    good, why = 0, Counter[str]()
    with opened(one, file, real_time=real_time, **(PHONE if finger else DESK)) as tab:
        tab.click(f"#roles button[data-role={role}]")
        frames = tab.evaluate(FRAMES) if real_time else nan
        for n in range(count):
            rng, hand = random.Random(f"{seed} {role} {finger} {n}"), Finger(tab) if finger else Mouse(tab)
            goes_along = role == "leader" or (role == "auto" and n % 2)
            found = follow(tab, rng, hand=hand) if goes_along else lead(tab, rng, hand=hand)
            verdict = found["verdict"]
            good += verdict["success"]
            why.update(verdict["failures"])
            if not verdict["success"]:
                print(f"  {role} {'finger' if finger else 'mouse'} {n}: {verdict}", flush=True)
        late = sorted(tab.evaluate("comanip.latencies ?? []")) if real_time else []
    says = f", {frames:.0f} frames/s, pointer to motion {late[len(late) // 2]:.1f} ms" if late else ""
    print(f"{role} by {'finger' if finger else 'mouse'}: {good} of {count}{says}", flush=True)
    return good, why


def main(count: int, roles: tuple[str, ...], seed: int, task: str, real_time: bool) -> None:
    with tempfile.TemporaryDirectory() as folder, browser() as one:
        file = Path(folder) / "lift.html"
        write_page({role: taught(role, seed=0, task=task) for role in ROLES}, file, task=task)
        for role in roles:
            mouse, why = lifts(one, file, role, count - count // 2, seed, finger=False, real_time=real_time)
            finger, more = lifts(one, file, role, count // 2, seed, finger=True, real_time=real_time)
            print(f"{role}: {mouse + finger} of {count}; {dict(why + more)}", flush=True)


if __name__ == "__main__":
    given = [one for one in sys.argv[1:] if not one.startswith("--")]
    main(
        int(given[0]) if given else 100,
        tuple(given[1].split(",")) if len(given) > 1 else (*ROLES, "auto"),
        int(given[2]) if len(given) > 2 else 1,
        given[3] if len(given) > 3 else "lift",
        "--real-time" in sys.argv,
    )
