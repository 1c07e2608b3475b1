"""Page against Python over many ticks: `python tests/page/long_twin.py [ticks]`, default 100,000 a role (two minutes)."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from comanip.learned.learn import learn
from comanip.lessons.demonstration import demonstrations
from comanip.page.numbers import numbers, robot
from comanip.tasks import named
from comanip.teaching import ROLES, teach
from page.worlds import DT, Rearmed, in_page, in_python, wandering


def main(ticks: int) -> None:
    task = named("lift")
    lessons = {role: teach(role, 5, rng=np.random.default_rng(n)) for n, role in enumerate(ROLES)}
    skills = {role: learn(demonstrations(some, rate_hz=100.0), role=role) for role, some in lessons.items()}
    for role in (*ROLES, "auto"):
        trace = wandering(task, ticks * DT, np.random.default_rng(11), way=np.array([0.3]))
        holds = np.ones(len(trace))
        for at in range(60_000, len(trace) - 20_000, 100_000):  # lets go now and then, and asks to go on
            holds[at : at + 3000] = 0.0
        # Every two seconds: the tick of a period begins with it.
        asks = {n for n in range(200, ticks, 200) if holds[10 * n] > 0.0}
        holds[[10 * n for n in asks]] = -1.0
        with tempfile.TemporaryDirectory() as folder:
            found = in_page(Path(folder), task, trace, holds=holds, numbers=numbers(robot(skills, role, dt=DT), task))
        recording = in_python(task, trace, holds=holds, skill=Rearmed(robot(skills, role, dt=DT), asks))
        apart = {
            name: float(np.abs(found[name] - recording[name].values).max())
            for name in found
            if name.startswith(("hand.", "command."))
        }
        modes = np.bincount(found["mode"].astype(int), minlength=3).tolist()
        same = bool((found["mode"] == recording["skill.mode"].values[:, 0]).all())
        print(
            f"{role}: {len(found['mode'])} ticks, farthest apart {max(apart.values()):.1e}; RUN, COMPLY, HOLD {modes}, the same: {same}",
            flush=True,
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100_000)
