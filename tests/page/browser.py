"""A person by script at the page: real pointer, touch and key events in a real browser. And what there must be for that."""

from __future__ import annotations

import os
import random
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = (
    os.environ.get("COMANIP_CHROMIUM")
    or shutil.which("chromium")
    or shutil.which("chromium-browser")
    or shutil.which("google-chrome")
)
FORESEEN = 0.8  # share of the way meanwhile
READY = "html[data-ready=yes]"


def needs_browser() -> None:
    pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install playwright")
    if CHROMIUM is None:
        pytest.skip("no chromium in PATH; name one with COMANIP_CHROMIUM")


@contextmanager
def browser() -> Iterator[Any]:
    needs_browser()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        one = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        try:
            yield one
        finally:
            one.close()


@contextmanager
def opened(one: Any, file: Path | str, **context: Any) -> Iterator[Any]:
    """A tab with the page; what it says on the console or throws is an error of the test, and so is whatever it asks of a network."""
    kept = one.new_context(**{"viewport": {"width": 1280, "height": 800}, **context})
    tab = kept.new_page()
    wrong: list[str] = []
    tab.on("pageerror", lambda error: wrong.append(str(error)))
    tab.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
    where = file if isinstance(file, str) else file.resolve().as_uri()
    tab.on(
        "request",
        lambda asked: None if asked.url.startswith((where, "data:", "blob:")) else wrong.append(f"asks for {asked.url}"),
    )
    try:
        tab.goto(where)
        tab.wait_for_selector(READY, timeout=15000)
        yield tab
        assert not wrong, wrong
    finally:
        kept.close()


def minimum_jerk(s: float) -> float:
    s = min(max(s, 0.0), 1.0)
    return s * s * s * (10.0 + s * (-15.0 + 6.0 * s))


def handle(tab: Any) -> tuple[float, float]:
    """Where the handle is on the screen [px]."""
    x, y = tab.evaluate(
        "(() => { const b = document.getElementById('scene').getBoundingClientRect(), h = comanip.scene.handle; return [b.x + h[0], b.y + h[1]] })()"
    )
    return float(x), float(y)


def settled(tab: Any, timeout_s: float = 6.0) -> None:
    """Until the next lift may begin."""
    until = time.monotonic() + timeout_s
    while tab.evaluate("comanip.session.phase") != "idle":
        if time.monotonic() > until:
            raise AssertionError(f"not ready: {tab.evaluate('comanip.session.phase')}")
        time.sleep(0.03)
    time.sleep(0.08)  # drawn at least once since


def until(tab: Any, says: str, timeout_s: float = 15.0) -> None:
    """Until the page says so; playwright's own way is forbidden by the page's policy."""
    end = time.monotonic() + timeout_s
    while not tab.evaluate(says):
        assert time.monotonic() < end, f"never: {says}"
        time.sleep(0.03)


def lead(
    tab: Any,
    rng: random.Random,
    *,
    duration_s: float | None = None,
    onset_s: float | None = None,
    hand: Any = None,
    pace: float = 1.0,
) -> dict[str, Any]:
    """Lifts to where the page asks, as people do: by minimum jerk, in a time of their own. Gives the lift as the page kept it."""
    settled(tab)
    taken = tab.evaluate("comanip.takes.length")
    leads(tab, rng, duration_s=duration_s, onset_s=onset_s, hand=hand, pace=pace)
    return _taken(tab, taken)


def leads(
    tab: Any,
    rng: random.Random,
    *,
    duration_s: float | None = None,
    onset_s: float | None = None,
    hand: Any = None,
    pace: float = 1.0,
) -> None:
    x, y = handle(tab)
    goal = tab.evaluate(
        "(() => { const s = comanip.session, a = comanip.scene.at(s.here(), 1), b = comanip.scene.at(s.setup.goal, 1); return [b[0] - a[0], b[1] - a[1]] })()"
    )
    duration, onset = duration_s or rng.uniform(1.6, 3.5), onset_s or rng.uniform(0.6, 1.6)
    hand = hand or Mouse(tab)
    hand.down(x, y)
    begun = time.monotonic()
    while tab.evaluate("comanip.session.phase") == "runs" and time.monotonic() - begun < 30.0:
        share = minimum_jerk((pace * (time.monotonic() - begun) - onset) / duration)
        hand.move(x + goal[0] * share + rng.gauss(0.0, 0.4), y + goal[1] * share + rng.gauss(0.0, 0.4))
        time.sleep(0.012)
    hand.up()


def follow(tab: Any, rng: random.Random, *, delay_s: float | None = None, hand: Any = None, pace: float = 1.0) -> dict[str, Any]:
    """Holds on and goes along with a robot that leads. Gives the lift as the page kept it."""
    settled(tab)
    taken = tab.evaluate("comanip.takes.length")
    follows(tab, rng, delay_s=delay_s, hand=hand, pace=pace)
    return _taken(tab, taken)


def follows(tab: Any, rng: random.Random, *, delay_s: float | None = None, hand: Any = None, pace: float = 1.0) -> None:
    """The eye is late by what people are late, and foresees most of a motion that goes on (pursuit)."""
    x, y = handle(tab)
    delay = (delay_s or rng.uniform(0.10, 0.25)) / pace
    hand = hand or Mouse(tab)
    hand.down(x, y)
    begun, seen = time.monotonic(), [(time.monotonic(), x, y)]
    while tab.evaluate("comanip.session.phase") == "runs" and time.monotonic() - begun < 30.0:
        seen.append((time.monotonic(), *handle(tab)))
        now = time.monotonic()
        while len(seen) > 2 and seen[2][0] < now - delay:
            seen.pop(0)
        (before, *was), (then, *there) = seen[0], seen[min(1, len(seen) - 1)]
        ahead = FORESEEN * (now - then) / max(then - before, 0.02)
        place = [at + ahead * (at - old) for at, old in zip(there, was, strict=True)]
        hand.move(place[0] + rng.gauss(0.0, 0.4), place[1] + rng.gauss(0.0, 0.4))
        time.sleep(0.01)
    hand.up()


def teach(tab: Any, role: str, count: int, rng: random.Random, *, pace: float = 1.0) -> int:
    """`count` lessons of a role, on the tab for teaching; how many tries it took."""
    tab.click("#tab-teach")
    tab.click(f"#teach [data-role={role}]")
    done = f"comanip.teach.lessons.filter(one => one.role === '{role}').length"
    for tries in range(1, 3 * count + 1):
        settled(tab)
        (follows if role == "leader" else leads)(tab, rng, pace=pace)
        until(tab, "comanip.session.phase !== 'runs'")
        if tab.evaluate(done) >= count:
            return tries
    raise AssertionError(f"{tab.evaluate(done)} lessons as {role} in {3 * count} tries")


def _taken(tab: Any, before: int) -> dict[str, Any]:
    until = time.monotonic() + 12.0
    while tab.evaluate("comanip.takes.length") == before and time.monotonic() < until:
        time.sleep(0.05)
    assert tab.evaluate("comanip.takes.length") == before + 1, tab.evaluate("comanip.session.phase")
    found: dict[str, Any] = tab.evaluate(
        "(() => { const t = comanip.takes[comanip.takes.length - 1]; return {verdict: t.verdict, role: t.role, goal: t.goal, take: t.take} })()"
    )
    return found


class Mouse:
    """Real mouse events."""

    def __init__(self, tab: Any) -> None:
        self.tab = tab

    def down(self, x: float, y: float) -> None:
        self.tab.mouse.move(x, y)
        self.tab.mouse.down()

    def move(self, x: float, y: float) -> None:
        self.tab.mouse.move(x, y)

    def up(self) -> None:
        self.tab.mouse.up()


class Finger:
    """Real touch events, through the browser's own protocol."""

    def __init__(self, tab: Any) -> None:
        self.session = tab.context.new_cdp_session(tab)

    def _send(self, kind: str, points: list[dict[str, float]]) -> None:
        self.session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def down(self, x: float, y: float) -> None:
        self._send("touchStart", [{"x": x, "y": y}])

    def move(self, x: float, y: float) -> None:
        self._send("touchMove", [{"x": x, "y": y}])

    def up(self) -> None:
        self._send("touchEnd", [])
