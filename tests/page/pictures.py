"""Pictures of the page to look at: `python tests/page/pictures.py FOLDER`. The README's is FOLDER/page.png; it belongs to docs/.

Every tab, light and dark, on a desk and on a phone; a lift at its middle, a HOLD and its end; and what somebody sees who is blind to red or green.
"""

from __future__ import annotations

import random
import sys
import tempfile
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from comanip.page.export import write_page
from comanip.teaching import ROLES
from comanip.trials.taught import taught
from page.browser import Swift, browser, follow, handle, lead, minimum_jerk, opened, settled, teach, wait

DESK = {"viewport": {"width": 1280, "height": 800}, "device_scale_factor": 2}
PHONE = {"viewport": {"width": 390, "height": 844}, "device_scale_factor": 2, "has_touch": True, "is_mobile": True}
TABS = ("teach", "study", "understand", "about")
BLIND = ("protanopia", "deuteranopia", "tritanopia", "achromatopsia")


def half_a_lift(tab: Any, hand: Any, seconds: float = 1.8) -> None:
    """The handle is held, and the beam on its way."""
    settled(tab)
    x, y = handle(tab)
    rises = 0.25 * tab.evaluate("comanip.scene.scale")
    hand.down(x, y)
    for n in range(round(seconds / 0.05)):
        hand.move(x, y - rises * minimum_jerk((0.05 * n - 0.6) / 1.6))
        wait(tab, 0.05)


def pictures(one: Any, file: Path, folder: Path, name: str, context: dict[str, Any]) -> None:
    """All tabs in one look."""
    with opened(one, file, **context) as tab:
        hand = Swift(tab)
        take = lambda what: tab.screenshot(path=folder / f"{name}-{what}.png")  # noqa: E731
        take("begins")
        half_a_lift(tab, hand)
        take("lifts")
        hand.up()
        wait(tab, 3.0)
        take("let-go")
        wait(tab, 9.0)
        tab.click("#roles [data-role=auto]")
        lead(tab, random.Random(2), duration_s=2.4, onset_s=0.8, hand=hand)
        take("ends")
        for tab_name in TABS:
            tab.click(f"#tab-{tab_name}")
            if tab_name == "teach":
                teach(tab, "leader", 2, random.Random(4), hand)
            wait(tab, 0.3)
            tab.screenshot(path=folder / f"{name}-{tab_name}.png", full_page=True)


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as made, browser() as one:
        file = Path(made) / "lift.html"
        write_page({role: taught(role, seed=0) for role in ROLES}, file)
        with opened(one, file, **{**DESK, "device_scale_factor": 1}) as tab:
            tab.click("#roles [data-role=leader]")
            follow(tab, random.Random(1), hand=Swift(tab))
            tab.click("#roles [data-role=auto]")
            half_a_lift(tab, Swift(tab), 1.5)
            tab.screenshot(path=folder / "page.png")
            session = tab.context.new_cdp_session(tab)
            for kind in BLIND:
                session.send("Emulation.setEmulatedVisionDeficiency", {"type": kind})
                tab.screenshot(path=folder / f"{kind}.png")
        for name, context in (("desk", DESK), ("phone", PHONE)):
            for look in ("light", "dark"):
                pictures(one, file, folder, f"{name}-{look}", {**context, "color_scheme": look, "device_scale_factor": 1})
    print(f"{len(list(folder.glob('*.png')))} pictures in {folder}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
