"""Altered settings against their readers: robots, tasks, mappings, skills and other people's partners. One line, or a value.

python tests/fuzz_settings.py 20000 [KIND ...]     # prints how many were refused, and the slowest

What is read is used for a moment, too: a value that passes here and fails in the first tick was not checked.
"""

from __future__ import annotations

import contextlib
import copy
import json
import re
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

import comanip.robots.settings as robots
from comanip.errors import ComanipError
from comanip.formats.mapping_file import mapping_file
from comanip.interfaces import Command, Observation
from comanip.learned.file import load, save
from comanip.learned.learn import learn
from comanip.lessons.demonstration import demonstration
from comanip.reproduction import make_skill
from comanip.tasks import TASKS, read_task, way
from comanip.tasks.way import usual
from comanip.trials.cases import draw_case
from comanip.trials.foreign import PartnersFrom
from comanip.whole_file import digest
from fuzz_readers import altered
from lifts import lift

EXTREME = (
    0,
    -1,
    1,
    2,
    1e-300,
    1e300,
    float("nan"),
    float("inf"),
    True,
    "",
    "z",
    "\n",
    [],
    [1],
    {},
    {"z": 1.0},
    None,
    10**30,
    [[]],
)
WORDS = tuple('nan inf -1 0 1e400 true "" "z" [] [1,2] {} [[1]] """a\nb""" 1979-05-27 0x10 \'\' 99999999999999999999'.split(" "))
MAPPING = 'position = ["z"]\nforce = "-f"\nrate_hz = 100.0\n[frames]\nft = "hand"\n'
PERSON = """
import numpy as np

class Pulls:
    goal_m = 0.3
    def __init__(self, case, rng):
        self.noise = float(rng.normal(0.0, 0.1))
        self.at = 0.0
    def reset(self, position):
        self.at = float(position[0])
    def force(self, time, position, velocity, out):
        out[:] = 300.0 * (self.at - position) - 20.0 * velocity + self.noise
"""


@cache
def _skill() -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        learned = learn([demonstration(lift(n), rate_hz=50.0) for n in range(3)], role="follower", n_states=3)
        save(learned, path := Path(folder) / "a.skill.json")
        return json.loads(path.read_text())


def spoilt(content: Any, rng: np.random.Generator) -> Any:
    """A copy of what JSON holds with one or two values lost, doubled, scaled or replaced."""
    content = copy.deepcopy(content)
    for _ in range(int(rng.integers(1, 3))):
        at: Any = content
        while True:
            keys = list(at) if isinstance(at, dict) else list(range(len(at)))
            if not keys:
                return content
            key = keys[int(rng.integers(len(keys)))]
            if not (isinstance(at[key], dict | list) and at[key]) or rng.random() < 0.25:
                break
            at = at[key]
        how = int(rng.integers(5))
        if how == 0:
            del at[key]
        elif how == 1 and isinstance(at, list):
            at.append(copy.deepcopy(at[key]))
        elif how == 2 and isinstance(at[key], float | int):
            at[key] = at[key] * float(rng.choice([-1.0, 0.0, 1e6, 1e-6, 1e200]))
        else:
            at[key] = copy.deepcopy(EXTREME[int(rng.integers(len(EXTREME)))])
    return content


def signed(rng: np.random.Generator) -> str:
    """A skill file with one or two values replaced, and a sha256 that says it is whole."""
    content = spoilt(_skill(), rng)
    with contextlib.suppress(TypeError, ValueError):
        content["sha256"] = digest(content)
    return json.dumps(content)


def reworded(text: str, rng: np.random.Generator) -> bytes:
    """Some values of a text replaced by other words, lines doubled, moved or lost; or its bytes altered."""
    if rng.random() < 0.3:
        return altered(text.encode(), rng)
    for _ in range(int(rng.integers(1, 4))):
        lines = text.split("\n")
        n = int(rng.integers(len(lines)))
        how = int(rng.integers(6))
        if how == 0:
            del lines[n]
        elif how == 1:
            lines.insert(n, lines[int(rng.integers(len(lines)))])
        elif how == 2:
            lines[n] = lines[n].replace("=", rng.choice(["", "==", ".a =", "-b ="]), 1)
        else:
            places = list(re.finditer(r"-?\d+\.?\d*|\"[^\"]*\"|\b[a-z_]+\b", lines[n]))
            if places:
                one = places[int(rng.integers(len(places)))]
                lines[n] = lines[n][: one.start()] + WORDS[int(rng.integers(len(WORDS)))] + lines[n][one.end() :]
        text = "\n".join(lines) or "\n"
    return text.encode()


def _use_skill(path: Path) -> None:
    learned = load(path)
    skill = make_skill(learned, axes=learned.axes, dt=0.01)
    obs, command = Observation(len(learned.axes)), Command(len(learned.axes))
    for n in range(3):
        obs.time = 0.01 * n
        for values in (obs.position, obs.velocity, obs.force, obs.sensor_force):
            values[:] = 0.1
        if n == 0:
            skill.reset(obs)
        skill.step(obs, command)
    assert np.isfinite(command.velocity).all(), command.velocity


def _use_task(path: Path) -> None:
    task = read_task(path)
    made = way(task, usual(task, next(iter(task.goals), "")))
    assert np.isfinite(made.course.at(0.5)[0]).all() if hasattr(made.course, "at") else True


def _use_person(path: Path) -> None:
    case = draw_case("follower", np.random.default_rng(1))
    person = PartnersFrom(str(path))(case, np.random.default_rng(0))
    out = np.zeros(len(case.axes))
    person.reset(np.zeros(len(case.axes)))
    person.force(0.0, np.zeros(len(case.axes)), np.zeros(len(case.axes)), out)


def _texts(folder: Path) -> list[str]:
    return [path.read_text() for path in sorted(folder.glob("*.toml"))]


Make = Callable[[np.random.Generator], bytes]


def _any_of(texts: list[str]) -> Make:
    return lambda rng: reworded(texts[int(rng.integers(len(texts)))], rng)


KINDS: dict[str, tuple[str, Make, Callable[[Path], Any]]] = {  # kind -> (suffix, an altered file, reading and using it)
    "robot": (".toml", _any_of(_texts(robots.HOME)), robots.load),
    "task": (".toml", _any_of(_texts(Path(str(next(iter(TASKS.values())))).parent)), _use_task),
    "mapping": (".toml", _any_of([MAPPING]), mapping_file),
    "skill": (".json", lambda rng: altered(json.dumps(_skill()).encode(), rng), _use_skill),
    "signed skill": (".json", lambda rng: signed(rng).encode(), _use_skill),
    "person": (".py", _any_of([PERSON]), _use_person),
}


def fuzz(kind: str, count: int, seed: int = 0) -> tuple[float, int, list[str]]:
    """(slowest [s], how many were refused, what no user should see)."""
    suffix, make, use = KINDS[kind]
    slowest, refused, wrong = 0.0, 0, []
    with tempfile.TemporaryDirectory() as place, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for n in range(count):
            path = Path(place) / f"a{n if kind == 'person' else ''}{suffix}"
            path.write_bytes(make(np.random.default_rng([seed, n])))
            started = time.process_time()
            try:
                use(path)
            except ComanipError as error:
                refused += 1
                if "\n" in str(error):
                    wrong.append(f"{kind} ({seed}, {n}): two lines: {error!s:.200}")
            except BaseException as error:
                wrong.append(f"{kind} ({seed}, {n}): {type(error).__name__}: {error!s:.200}")
            slowest = max(slowest, time.process_time() - started)
            path.unlink()
    return slowest, refused, wrong


if __name__ == "__main__":
    for kind in sys.argv[2:] or KINDS:
        slowest, refused, wrong = fuzz(kind, int(sys.argv[1]))
        print(f"{kind}: {refused} of {sys.argv[1]} refused, slowest {slowest:.3f} s, {len(wrong)} wrong", flush=True)
        print("\n".join(wrong[:40]), flush=True)
