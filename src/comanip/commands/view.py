"""The live view of a run: a process of its own that draws what the loop hands it, ten times a second.

Drawing a table holds the interpreter for milliseconds, and the loop has ten. Where standard error is no terminal, or the view
is gone, what changes is told in lines instead.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from typing import Any

import numpy as np

from ..formats.children import command
from ..interfaces import Command, Observation
from ..robots.guard import Guarded

SHOWN_S = 0.1
TOLD_S = 5.0
MODES = ("RUN", "COMPLY", "HOLD")
KEYS = "space or r: go on after a HOLD   q or Ctrl-C: brake and end"


class View:
    """A tap: position, velocity, force, tank, mode and reason, where somebody looks."""

    def __init__(self, guard: Guarded, title: str, role: str, axes: tuple[str, ...], notice: Any = str) -> None:
        self._guard, self._notice, self._axes = guard, notice, axes
        self._due, self._told, self._said = 0.0, 0.0, ""
        self._about = {"title": title, "role": role, "axes": list(axes)}
        self._child: subprocess.Popen[bytes] | None = None

    def begin(self, recorder: Any) -> None:
        """Called by the loop before the first tick."""
        if not sys.stderr.isatty():
            return
        self._child = subprocess.Popen(command("comanip.commands.view"), stdin=subprocess.PIPE, start_new_session=True)
        assert self._child.stdin is not None
        if hasattr(os, "set_blocking"):
            os.set_blocking(self._child.stdin.fileno(), False)

    def __call__(self, obs: Observation, command: Command) -> None:
        now = time.monotonic()
        if now < self._due:
            return
        self._due = now + SHOWN_S
        shown = self._about | self.shown(obs, command)
        if self._child is None or not self._drawn(shown):
            self._tell(shown, now)

    def shown(self, obs: Observation, command: Command) -> dict[str, Any]:
        """What is to be seen now, as plain values."""
        about = self._guard.diagnostics
        mode = MODES[int(about["mode"][0])]
        reasons = [self._guard.notice.removeprefix(f"{mode}: "), self._notice()]  # the mode stands beside them
        return {
            "time": float(obs.time),
            "position": obs.position.tolist(),
            "velocity": command.velocity.tolist(),
            "force": obs.force.tolist(),
            "mode": mode,
            "tank": float(about["tank"][0]),
            "leads": _leads(about),
            "reason": "; ".join(r for r in reasons if r),
        }

    def _drawn(self, shown: dict[str, Any]) -> bool:
        assert self._child is not None
        assert self._child.stdin is not None
        try:
            os.write(self._child.stdin.fileno(), json.dumps(shown).encode() + b"\n")
        except BlockingIOError:  # the terminal is slow: the next one
            return True
        except OSError:
            self._child = None
            return False
        return True

    def _tell(self, shown: dict[str, Any], now: float) -> None:
        what = f"{shown['mode']}: {shown['reason']}" if shown["reason"] else shown["mode"]
        if what == self._said and now - self._told < TOLD_S:
            return
        self._said, self._told = what, now
        at = ", ".join(f"{a} {x:.3f} m" for a, x in zip(self._axes, shown["position"], strict=True))
        print(f"{shown['time']:7.2f} s  {at}  |F| {np.linalg.norm(shown['force']):.1f} N  {what}", file=sys.stderr)

    def end(self) -> None:
        """Called by the loop after the last tick."""
        if self._child is not None and self._child.stdin is not None:
            self._child.stdin.close()
            try:
                self._child.wait(2.0)
            except subprocess.TimeoutExpired:
                self._child.kill()


def _leads(about: Any) -> str:
    for name in ("leads", "leading", "role"):
        if name in about:
            return f"{float(about[name].ravel()[0]):.2f}"
    return ""


def drawn(shown: dict[str, Any]) -> Any:
    """The picture of one moment."""
    from rich.table import Table
    from rich.text import Text

    colour = {"RUN": "green", "COMPLY": "yellow", "HOLD": "bold red"}[shown["mode"]]
    out = Table(title=Text(f"{shown['title']}   {shown['time']:.1f} s"), title_justify="left", caption=Text(KEYS))
    for name in ("axis", "position m", "velocity m/s", "force N", ""):
        out.add_column(name, justify="left" if name == "axis" else "right")
    for axis, x, v, f in zip(shown["axes"], shown["position"], shown["velocity"], shown["force"], strict=True):
        out.add_row(Text(axis), f"{x:.3f}", f"{v:+.3f}", f"{f:+.1f}", Text(bar(f)))
    role = shown["role"] + (f" (leads {shown['leads']})" if shown["leads"] else "")
    out.add_section()
    out.add_row("role", Text(role), "tank J", f"{shown['tank']:.2f}", "")
    out.add_row(Text(shown["mode"], style=colour), Text(shown["reason"] or "all is well"), "", "", "")
    return out


def bar(force: float, most: float = 20.0, width: int = 21) -> str:
    """Where a force lies between -most and most."""
    half = width // 2
    if force != force:
        return "?".center(width)
    at = half + round(max(-1.0, min(1.0, force / most)) * half)
    return "".join("#" if i == at else "|" if i == half else "." for i in range(width))


def main() -> int:
    """The process that draws, from lines on its standard input until they end."""
    from rich.console import Console
    from rich.live import Live

    with Live(console=Console(stderr=True), auto_refresh=False) as live:
        for line in sys.stdin:
            live.update(drawn(json.loads(line)), refresh=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
