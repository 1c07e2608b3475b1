"""How late the page answers a mouse and a finger, and how late a bare page is in the same browser:
`python tests/page/latency.py [seconds]`. A machine that does nothing else; milliseconds, medians and nine tenths.

The floor is a page with one listener and one rectangle. Chromium gives a page what a finger does just behind a frame, at once as
`pointerrawupdate` and one or two frames later as `pointermove`; what a mouse does it gives at any time.
"""

from __future__ import annotations

import random
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from comanip.page.export import write_page
from comanip.teaching import ROLES
from comanip.trials.taught import taught
from page.browser import Finger, Mouse, browser, handle, opened, settled

DESK = {"viewport": {"width": 1280, "height": 800}}
PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
BARE = """<!doctype html><meta name=viewport content="width=device-width, initial-scale=1"><canvas style="touch-action:none;width:100%;height:90vh"></canvas><script>
const canvas = document.querySelector("canvas"), g = canvas.getContext("2d"), comanip = { latencies: [], drawn: [] }; let when = null;
for (const name of ["pointerrawupdate", "pointermove"]) canvas.addEventListener(name, event => { if (event.timeStamp <= when) return; comanip.latencies.push(performance.now() - event.timeStamp); when = event.timeStamp; comanip.then ??= when; });
const frame = () => { g.clearRect(0, 0, 300, 150); g.fillRect(Math.random() * 200, 50, 50, 50); if (comanip.then !== undefined) comanip.drawn.push(performance.now() - comanip.then); comanip.then = undefined; requestAnimationFrame(frame) }; frame();
</script>"""


def moves(tab: Any, hand: Any, x: float, y: float, seconds: float) -> dict[str, list[float]]:
    """Slowly up and down, at times that are no multiple of a frame."""
    rng, begun = random.Random(1), time.monotonic()
    hand.down(x, y)
    time.sleep(0.6)
    tab.evaluate("comanip.latencies.length = comanip.drawn.length = 0")
    while time.monotonic() - begun < 0.6 + seconds:
        hand.move(x, y - 25.0 * abs(1.0 - (time.monotonic() - begun) % 2.0))
        time.sleep(rng.uniform(0.004, 0.030))
    hand.up()
    return {name: sorted(tab.evaluate(f"comanip.{name}")) for name in ("latencies", "drawn")}


def says(values: list[float]) -> str:
    return f"{values[len(values) // 2]:5.1f} {values[len(values) * 9 // 10]:5.1f}" if values else "no event"


def main(seconds: float) -> None:
    with tempfile.TemporaryDirectory() as folder, browser() as one:
        file, bare = Path(folder) / "lift.html", Path(folder) / "bare.html"
        write_page({role: taught(role, seed=0) for role in ROLES}, file)
        bare.write_text(BARE)
        for context, kind in ((DESK, Mouse), (PHONE, Finger)):
            kept = one.new_context(**context)
            tab = kept.new_page()
            tab.goto(bare.as_uri())
            floor = moves(tab, kind(tab), 200.0, 300.0, seconds)
            kept.close()
            with opened(one, file, real_time=True, **context) as tab:
                settled(tab)
                found = moves(tab, kind(tab), *handle(tab), seconds)
            name = kind.__name__.lower()
            print(f"{name}: event to motion {says(found['latencies'])} (a bare page has it after {says(floor['latencies'])}); "
                  f"to the drawn frame {says(found['drawn'])} (a bare page {says(floor['drawn'])}); {len(found['latencies'])} events", flush=True)  # fmt: skip


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 8.0)
