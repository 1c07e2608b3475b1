"""Roll-outs on the beam with partners that answer: skill, force estimate, beam and person, as a trial runs them."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from comanip.learned.learn import learn
from comanip.lessons.demonstration import demonstrations
from comanip.plants.beam import BeamPlant
from comanip.reproduction import make_skill
from comanip.teaching import teach
from comanip.trials import draw_case, run_case
from machine import alternated, median, stay_on_one_core
from tick import only_numpy

N = 20


def beam_in_python(call: Callable[[], Any]) -> Callable[[], Any]:
    """The same call with beam and person in Python."""

    def wrapped() -> Any:
        compile_ = BeamPlant._compile
        BeamPlant._compile = lambda self, late: (None, self._rng)
        try:
            return call()
        finally:
            BeamPlant._compile = compile_

    return wrapped


def measure() -> dict[str, Any]:
    """Microseconds a tick and partners a second of each way to run the same partners; the paths agree, or the run stops."""
    stay_on_one_core()
    rng = np.random.default_rng(0)
    learned = learn(demonstrations(teach("follower", 5, rng=rng), rate_hz=100.0), role="follower")
    cases = [draw_case("follower", rng) for _ in range(N)]

    def runs(native: bool) -> Callable[[], Any]:
        with only_numpy(not native):
            skill = make_skill(learned, axes=learned.axes, dt=0.01, role="follower")

        def call() -> Any:
            with only_numpy(not native):
                return [run_case(case, skill) for case in cases]

        return call

    work = {
        "comanip": runs(True),
        "comanip, beam and person in Python": beam_in_python(runs(True)),
        "comanip, numpy twin": runs(False),
    }
    paths = {name: [np.array(r["hand.position"].values) for r in call()] for name, call in work.items()}
    for name, path in paths.items():
        if not all(np.allclose(a, b, atol=1e-8) for a, b in zip(path, paths["comanip"], strict=True)):
            raise AssertionError(f"{name} goes elsewhere")
    ticks = sum(map(len, paths["comanip"]))
    seconds = {name: median(t) for name, t in alternated(work, 7).items()}
    found = {
        "us": {name: s / ticks * 1e6 for name, s in seconds.items()},
        "partners_per_s": {name: N / s for name, s in seconds.items()},
    }
    print(found, file=sys.stderr)
    return found


if __name__ == "__main__":
    measure()
