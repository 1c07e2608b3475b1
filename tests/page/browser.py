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
WHEEL_M_PER_PX = 0.0002  # as app/hands.js
FRAME_S, STEP_S = 1.0 / 60.0, 1.0 / 20.0  # of what is drawn; of what is done, as by a slow mouse
# Time that passes when the script says so, a frame at a call: what a person by script does there does not hang on the machine's load.
STEPPED = """(() => { let now = 0, frames = [], timers = [], id = 0;
  performance.now = () => now; Date.now = () => now;
  requestAnimationFrame = does => { frames.push(does); return ++id; };
  setTimeout = (does, ms = 0) => { timers.push({ id: ++id, at: now + ms, does }); return id; };
  clearTimeout = which => { timers = timers.filter(one => one.id !== which); };
  globalThis.stepped = ms => { now += ms; const due = timers.filter(one => one.at <= now); timers = timers.filter(one => one.at > now); due.forEach(one => one.does());
    const drawn = frames; frames = []; drawn.forEach(does => does(now)); } })()"""
SEEN = """(() => { const b = document.getElementById('scene').getBoundingClientRect(), h = comanip.scene.handle ?? [0, 0];
  return [comanip.session.phase, b.x + h[0], b.y + h[1]] })()"""
# Frames pass, and the last one is drawn: a person sees no more of a script's.
PASSES = f"""frames => {{ const drawn = globalThis.comanip ? [comanip.scene, comanip.strips] : [];
  for (const one of drawn) one.draw = () => {{}};
  for (let n = 1; n <= frames; n++) {{ if (n === frames) for (const one of drawn) delete one.draw; stepped({1000.0 * FRAME_S}); }}
  return globalThis.comanip ? {SEEN} : ["", 0, 0] }}"""
# Stamps of made events are those of a time that stands still; no two of the page's own are alike.
SWIFT = """([kind, clientX, clientY]) => { const made = new PointerEvent(kind, { pointerId: 9, clientX, clientY, cancelable: true });
  Object.defineProperty(made, "timeStamp", { value: globalThis.stamped = (globalThis.stamped ?? 0) + 1 });
  document.getElementById("scene").dispatchEvent(made) }"""
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
def opened(one: Any, file: Path | str, *, real_time: bool = False, **context: Any) -> Iterator[Any]:
    """A tab with the page, whose time passes by `wait`, or really; what it says on the console or throws is an error of the test,
    and so is whatever it asks of a network."""
    kept = one.new_context(**{"viewport": {"width": 1280, "height": 800}, **context})
    tab = kept.new_page()
    if not real_time:
        tab.passed = 0.0
        tab.add_init_script(STEPPED)
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
        wait(tab, 0.1)
        yield tab
        assert not wrong, wrong
    finally:
        kept.close()


def minimum_jerk(s: float) -> float:
    s = min(max(s, 0.0), 1.0)
    return s * s * s * (10.0 + s * (-15.0 + 6.0 * s))


def _is_stepped(tab: Any) -> bool:
    return hasattr(tab, "passed")


def now(tab: Any) -> float:
    """[s] of the page's time."""
    return tab.passed if _is_stepped(tab) else time.monotonic()


def wait(tab: Any, seconds: float) -> tuple[str, float, float]:
    """Lets time pass; gives the phase of the lift and where the handle is on the screen [px]."""
    if not _is_stepped(tab):
        time.sleep(seconds)
        return tuple(tab.evaluate(SEEN)) if tab.evaluate("'comanip' in globalThis") else ("", 0.0, 0.0)
    frames = max(round(seconds / FRAME_S), 1)
    tab.passed += frames * FRAME_S
    return tuple(tab.evaluate(PASSES, frames))


def handle(tab: Any) -> tuple[float, float]:
    """Where the handle is on the screen [px]."""
    _, x, y = tab.evaluate(SEEN)
    return float(x), float(y)


def until(tab: Any, says: str, timeout_s: float = 15.0, step_s: float = 0.1) -> None:
    """Until the page says so; playwright's own way is forbidden by the page's policy."""
    begun, really = now(tab), time.monotonic()
    while not tab.evaluate(says):
        late = now(tab) - begun > timeout_s and time.monotonic() - really > 5.0
        assert not late, f"never: {says}"
        wait(tab, step_s)
        time.sleep(0.002)


def settled(tab: Any) -> None:
    """Until the next lift may begin, and is drawn."""
    until(tab, "comanip.session.phase === 'idle'")
    wait(tab, 0.08)


def lead(
    tab: Any, rng: random.Random, *, duration_s: float | None = None, onset_s: float | None = None, hand: Any = None
) -> dict[str, Any]:
    """Lifts to where the page asks, as people do: by minimum jerk, in a time of their own. Gives the lift as the page kept it."""
    settled(tab)
    taken = tab.evaluate("comanip.takes.length")
    leads(tab, rng, duration_s=duration_s, onset_s=onset_s, hand=hand)
    return _taken(tab, taken)


WAY = """(() => { const { session, scene } = comanip, { goal, guide } = session.setup, here = session.here(), depth = scene.depth;
  const rows = guide ?? [here.map(() => 0), goal], from = scene.at(here.map(() => 0), 1), deep = row => (depth < 0 ? 0 : row[depth]);
  return { guided: guide !== null, rows: rows.map(row => { const at = scene.at(row, 1); return [at[0] - from[0], at[1] - from[1], deep(row)] }) } })()"""


def leads(
    tab: Any, rng: random.Random, *, duration_s: float | None = None, onset_s: float | None = None, hand: Any = None
) -> None:
    """To the goal by minimum jerk, or along the way that the page shows, in the time that lessons took; the third axis by wheel."""
    way = tab.evaluate(WAY)
    rows, taught_s = way["rows"], tab.evaluate("comanip.guideS()")
    duration = duration_s or (taught_s * rng.uniform(0.9, 1.4) if way["guided"] else rng.uniform(1.6, 3.5))
    onset, deep = onset_s or rng.uniform(0.6, 1.6), 0.0
    hand, (x, y) = hand or Mouse(tab), handle(tab)
    hand.down(x, y)
    begun, phase = now(tab), "runs"
    while phase == "runs" and now(tab) - begun < 45.0:
        s = (now(tab) - begun - onset) / duration
        place = min(max(s, 0.0), 1.0) * (len(rows) - 1) if way["guided"] else minimum_jerk(s)
        n = min(int(place), len(rows) - 2)
        dx, dy, wanted = (a + (place - n) * (b - a) for a, b in zip(rows[n], rows[n + 1], strict=True))
        hand.move(x + dx + rng.gauss(0.0, 0.4), y + dy + rng.gauss(0.0, 0.4))
        if abs(wanted - deep) > 0.004:
            hand.dive(deep, wanted)
            deep = wanted
        phase, *_ = wait(tab, STEP_S)
    hand.up()


def follow(tab: Any, rng: random.Random, *, delay_s: float | None = None, hand: Any = None) -> dict[str, Any]:
    """Holds on and goes along with a robot that leads. Gives the lift as the page kept it."""
    settled(tab)
    taken = tab.evaluate("comanip.takes.length")
    follows(tab, rng, delay_s=delay_s, hand=hand)
    return _taken(tab, taken)


def follows(tab: Any, rng: random.Random, *, delay_s: float | None = None, hand: Any = None) -> None:
    """The eye is late by what people are late, and foresees most of a motion that goes on (pursuit)."""
    delay = delay_s or rng.uniform(0.10, 0.25)
    hand, (x, y) = hand or Mouse(tab), handle(tab)
    hand.down(x, y)
    begun, phase, seen = now(tab), "runs", [(now(tab), x, y)]
    while phase == "runs" and now(tab) - begun < 45.0:
        phase, *at = wait(tab, STEP_S)
        seen.append((now(tab), *at))
        while len(seen) > 2 and seen[2][0] < now(tab) - delay:
            seen.pop(0)
        (before, *was), (then, *there) = seen[0], seen[min(1, len(seen) - 1)]
        ahead = FORESEEN * (now(tab) - then) / max(then - before, 0.02)
        place = [one + ahead * (one - old) for one, old in zip(there, was, strict=True)]
        hand.move(place[0] + rng.gauss(0.0, 0.4), place[1] + rng.gauss(0.0, 0.4))
    hand.up()


def teach(tab: Any, role: str, count: int, rng: random.Random, hand: Any = None) -> int:
    """`count` lessons of a role, on the tab for teaching; how many tries it took."""
    tab.click("#tab-teach")
    tab.click(f"#teach [data-role={role}]")
    done = f"comanip.teach.lessons.filter(one => one.role === '{role}').length"
    for tries in range(1, 3 * count + 1):
        settled(tab)
        (follows if role == "leader" else leads)(tab, rng, hand=hand)
        until(tab, "comanip.session.phase !== 'runs'")
        if tab.evaluate(done) >= count:
            return tries
    raise AssertionError(f"{tab.evaluate(done)} lessons as {role} in {3 * count} tries")


def studied(tab: Any, number: int, trials: int, hand: Any = None) -> list[str]:
    """A study by script on its tab: the laws as they were shown, which is not told before the end."""
    tab.evaluate(f"comanip.study.plan.trials = {trials}; comanip.study.plan.practice = 0")
    tab.click("#tab-study")
    tab.fill("#study input[type=number]", str(number))
    assert tab.locator("#study button.main").is_disabled()  # without consent nothing begins
    tab.check("#study input[type=checkbox]")
    tab.click("#study button:has-text('Begin')")
    names = tab.evaluate("comanip.study.plan.conditions.map(one => one.name)")
    for block in range(len(names)):
        for trial in range(trials):
            settled(tab)
            assert f"Robot {block + 1} of {len(names)}, lift {trial + 1}" in tab.locator("#study h2").inner_text()
            shown = tab.locator("#study").inner_text()
            assert not any(name in shown for name in names), "the law is shown"
            if tab.evaluate("comanip.session.setup.asked") == "leader":
                follows(tab, random.Random(trial), delay_s=0.18, hand=hand)
            else:
                leads(tab, random.Random(trial), duration_s=2.4, onset_s=0.8, hand=hand)
        until(tab, "document.querySelector('#study fieldset') !== null")
        for name in ("ease", "predictability"):
            tab.locator(f"#study input[name={name}][value='{6 - block}']").check(force=True)
        tab.click("#study button:has-text('Go on')")
    tab.fill("#study textarea", "<img src=x onerror=\"document.title='owned'\">")
    tab.click("#study button:has-text('Robot 1')")
    return tab.evaluate("comanip.study.order.map(one => one.name)")


def kept_study(tab: Any, kind: str, file: Path) -> Path:
    with tab.expect_download() as kept:
        tab.click(f"#study button:has-text('{kind}')")
    kept.value.save_as(file)
    return file


def _taken(tab: Any, before: int) -> dict[str, Any]:
    until(tab, f"comanip.takes.length === {before + 1}", 12.0)
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

    def dive(self, before: float, wanted: float) -> None:
        self.tab.mouse.wheel(0.0, (before - wanted) / WHEEL_M_PER_PX)

    def up(self) -> None:
        self.tab.mouse.up()


class Finger:
    """Real touch events, through the browser's own protocol; a second finger moves into the picture."""

    def __init__(self, tab: Any) -> None:
        self.tab, self.session = tab, tab.context.new_cdp_session(tab)
        self.points: dict[int, tuple[float, float]] = {}

    def _send(self, kind: str) -> None:
        points = [{"id": n, "x": x, "y": y} for n, (x, y) in self.points.items()]
        self.session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def down(self, x: float, y: float) -> None:
        self.points = {0: (x, y)}
        self._send("touchStart")

    def move(self, x: float, y: float) -> None:
        self.points[0] = (x, y)
        self._send("touchMove")

    def dive(self, before: float, wanted: float) -> None:
        if 1 not in self.points:
            x, y = self.points[0]
            self.points[1] = (x - 70.0, y)
            self._send("touchStart")
        x, y = self.points[1]
        self.points[1] = (x, y + (before - wanted) * self.tab.evaluate("comanip.scene.scale"))
        self._send("touchMove")

    def up(self) -> None:
        self.points = {}
        self._send("touchEnd")


class Swift:
    """Events that are made in the page: a real mouse's wait for a frame of the browser each, and a lift has a hundred."""

    def __init__(self, tab: Any) -> None:
        self.tab = tab
        tab.evaluate("document.getElementById('scene').setPointerCapture = () => {}")  # there is no such pointer to capture

    def _send(self, kind: str, x: float, y: float) -> None:
        self.tab.evaluate(SWIFT, [kind, x, y])

    def down(self, x: float, y: float) -> None:
        self._send("pointerdown", x, y)

    def move(self, x: float, y: float) -> None:
        self._send("pointermove", x, y)

    def dive(self, before: float, wanted: float) -> None:
        turned = f"new WheelEvent('wheel', {{ deltaY: {(before - wanted) / WHEEL_M_PER_PX}, cancelable: true }})"
        self.tab.evaluate(f"document.getElementById('scene').dispatchEvent({turned})")

    def up(self) -> None:
        self._send("pointerup", 0.0, 0.0)
