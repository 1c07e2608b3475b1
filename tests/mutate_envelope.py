"""Plants one defect at a time in a copy of safety/envelope.py and watching.py and counts how many the tests notice.

    python tests/mutate_envelope.py [first [last]]        the score, and which defects survived

Not collected by pytest: it takes minutes. Each defect is one replacement of text that occurs exactly once in the two files.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parent.parent
SOURCES = ("envelope.py", "watching.py")
TESTS = ["tests/faults/test_controller_faults.py", "tests/laws/test_envelope_laws.py", "tests/skills/test_watching.py"]
DEFECTS = [
    ("no clip to the reachable", "velocity.append(min(max(v, old - change), old + change))", "velocity.append(v)"),
    ("no clip to the brakeable", "v = min(max(self._asked[i], -down), up)", "v = self._asked[i]"),
    (
        "the two clips in the wrong order",
        "v = min(max(self._asked[i], -down), up)",
        "v = min(max(self._asked[i], old - change), old + change); old, change = v, 0.0; v = min(max(v, -down), up)",
    ),
    ("no upper wall", "self._cap(min(high - max(x, at), tank))", "self._cap(tank)"),
    ("no lower wall", "self._cap(min(min(x, at) - low, tank))", "self._cap(tank)"),
    ("no tank upwards", "self._cap(min(high - max(x, at), tank))", "self._cap(high - max(x, at))"),
    ("no tank downwards", "self._cap(min(min(x, at) - low, tank))", "self._cap(min(x, at) - low)"),
    ("cap without the period", "sqrt(2.0 * a * room) - 0.5 * a * self._late", "sqrt(2.0 * a * room) - 0.0 * a * self._late"),
    ("cap too fast", "sqrt(2.0 * a * room)", "sqrt(2.4 * a * room)"),
    ("cap too slow", "sqrt(2.0 * a * room)", "sqrt(1.0 * a * room)"),
    ("no top speed upwards", "up = min(limits.v_max_m_per_s, self._cap", "up = min(9.0, self._cap"),
    ("no top speed downwards", "down = min(limits.v_max_m_per_s, self._cap", "down = min(9.0, self._cap"),
    ("change by the nominal period", "change = limits.a_max_m_per_s2 * period", "change = limits.a_max_m_per_s2 * self._dt"),
    ("energy with the wrong sign", "gain = self._force[i] * way", "gain = -self._force[i] * way"),
    ("unknown force booked as none", "else -limits.force_limit_n * abs(way)", "else 0.0"),
    ("tank without a top", "min(limits.energy_j, max(0.0, self._energy[i] + gain))", "max(0.0, self._energy[i] + gain)"),
    ("tank without a bottom", "max(0.0, self._energy[i] + gain)", "self._energy[i] + gain"),
    ("late: assumed held all the time", "if late:  # a command", "if False:  # a command"),
    ("ledger by the nominal period", "way = v * period", "way = v * self._dt"),
    ("ledger stands still", "self._x[i] += way", "self._x[i] += 0.0 * way"),
    ("a force of NaN is good", "if not abs(force) < ABSURD:", "if abs(force) >= ABSURD:"),
    ("force limit doubled", "velocity[i], limits.force_limit_n if", "velocity[i], 2.0 * limits.force_limit_n if"),
    ("force limit on one side", "if abs(force) > limit:", "if force > limit:"),
    ("velocity never doubted", "if abs(velocity) > 10.0", "if abs(velocity) > 1e99"),
    ("jump never doubted", "if jump > limits.position_jump_m", "if jump > 1e9 + limits.position_jump_m"),
    ("drift never doubted", "> limits.drift_m and", "> 1e9 and"),
    ("stuck never doubted", "if self._same_s[i] > limits.stuck_s + 1e-9:", "if self._same_s[i] > 1e9:"),
    ("stuck at rest too", "and abs(self._v[i]) > limits.moving_m_per_s:\n", "and True:\n"),
    ("late never doubted", "late = period > self._late + 1e-9", "late = False"),
    ("stale never doubted", "if self._age > self._stale + 1e-9:", "if self._age > 1e9:"),
    ("age never reset", "max(t, self._time), 0.0\n", "max(t, self._time), self._age\n"),
    ("backwards is fine", "if step < 0.0:", "if step < -1e99:"),
    ("time of NaN is fine", "        if not isfinite(t):", "        if False:"),
    ("creeping clock is fine", "if step < 0.1 * dt:", "if step <= 0.0:"),
    (
        "the last reason wins",
        "        if self._state != HOLD:\n            self._state, self._reason = HOLD",
        "        if True:\n            self._state, self._reason = HOLD",
    ),
    ("fault without hold", "self._state, self._reason = HOLD, reason", "self._reason = reason"),
    ("hold brakes at half", "left = abs(v) - self.limits.a_max", "left = abs(v) - 0.5 * self.limits.a_max"),
    ("hold lets go at once", "velocity.append(self._braked(old, period))", "velocity.append(0.0)"),
    ("re-arm in motion", "if measured > self.limits.rest_m_per_s or fastest", "if False and fastest"),
    ("re-arm with a fault", "return problem or self._begin(obs)", "return self._begin(obs) and ''"),
    ("re-arm keeps the ledger", "self._at, self._v, self._force = list(position)", "self._at, self._v, self._force = [0.0] * d"),
    ("comply without damping", "self._asked = [f / b for", "self._asked = [f for"),
    ("comply pushes back", "self._asked = [f / b for", "self._asked = [-f / b for"),
    ("fade up at once", "period / self.limits.fade_s)", "1.0)"),
    ("doubt of NaN is trust", "if isfinite(trust) else 0.0", "if isfinite(trust) else 1.0"),
    (
        "shape of a command unchecked",
        'if np.shape(array) != (self._d,):\n                return f"{name} has shape {np.shape(array)}',
        'if False:\n                return f"{name} has shape {np.shape(array)}',
    ),
    (
        "NaN of a command unchecked",
        "if not isfinite(value):\n                    return",
        "if False:\n                    return",
    ),
    ("blocked never seen", "if self._blocked_ns > limits.blocked_n * limits.blocked_s:", "if False:"),
    ("blocked by a pull ahead", "against = -dot(self._force", "against = dot(self._force"),
    ("blocked adds up for ever", "if against > limits.blocked_n else 0.0", "if against > limits.blocked_n else self._blocked_ns"),
    ("an impact is a force too high", "if self._impact_s <= 0.0 else limits.impact_n", "if True else 0.0"),
    ("an impact lasts for ever", "self._impact_s -= period", "pass"),
    (
        "after an impact it starts again under any force",
        "self._wrong(f, v, self.limits.force_limit_n)",
        "self._wrong(f, v, self.limits.impact_n)",
    ),
    ("a reading beyond reason is weighed", "f if abs(f) < ABSURD else nan for", "f for"),
    ("an impact of any force", "else limits.impact_n", "else 1e9"),
    ("let go never seen", "if self._alone_s > limits.let_go_s:", "if False:"),
    ("let go of nobody", "if self._held and size", "if size"),
    ("shake never said", "if self._shaking.amplitude > limits.shake_n:", "if False:"),
    ("bias never said", "self._felt if self._rest_s > 2.0 else 0.0", "0.0"),
    ("checker ignored", "        if verdict:\n", "        if False:\n"),
    ("skill stepped on old samples", "        if not fresh:\n            return\n", ""),
    ("sent position unbounded", "min(max(position, low), high) if v", "position if v"),
    ("acceleration unbounded", "min(max(a, -limits.a_max_m_per_s2), limits.a_max_m_per_s2)", "a"),
    (
        "skill's position unbounded",
        "min(max(float(inner.position[i]), self._at[i] - near), self._at[i] + near)",
        "float(inner.position[i])",
    ),
    ("first tick counts as old", "if self._first:", "if False:"),
    ("object never weighed", "if self._weighed < WEIGHED_TICKS:", "if self._weighed < 10**9:"),
    ("weighed at half", "(f - w) / self._weighed for", "0.5 * (f - w) / self._weighed for"),
    ("missing pull of one sample", "self._swing = max(round(SWING_S / dt), 1)", "self._swing = 1"),
    ("a slow pull is letting go", "alone = sudden and (", "alone = ("),
    ("a wall is letting go", "< self._alone_n and (moves or steady)", "< self._alone_n"),
    ("no loss is sudden", "> 0.5 * load else", "> 5.0 * load else"),
    ("let go in a moment", "return self._for_s > self._alone_s", "return self._for_s > 0.0"),
    ("the whole object never noticed", "return self._for_s > self._alone_s", "return False"),
    ("a pull beyond the weight is letting go", "nobody = length(pull) <", "nobody = min(pull) <"),
    (
        "a wall that was felt is letting go",
        "if self._feels_s <= 0.0 and self._let_go.nobody_pulls():",
        "if self._feels_s <= 0.0:",
    ),
    ("what was felt is never a let go", "if self._feels_s <= 0.0 and self._let_go.nobody_pulls():", "if False:"),
    ("a jump is never seen", "abs(size) if SAME[0] < share < SAME[1] else 0.0", "0.0"),
    ("a knock is a jump", "abs(size) if SAME[0] < share < SAME[1] else 0.0", "abs(size)"),
    ("a jump in motion too", "if self._still_s > self._rest_s and change", "if change"),
    ("noise is a jump", "self._least_n + 6.0 * self._usual[i]", "self._least_n + 0.5 * self._usual[i]"),
    ("noise is never learned", "self._usual[i] += share *", "self._usual[i] += 0.0 *"),
    ("shaking is a mean", "self._mean += min(period / 0.5, 1.0) * (abs(", "self._mean += min(period / 0.5, 1.0) * ("),
]


PLUGIN = """from hypothesis import Phase, settings
settings.register_profile("unshrunk", phases=[Phase.explicit, Phase.generate])
settings.load_profile("unshrunk")
"""  # a defect is caught by any failure; the shortest one is of no interest


def noticed(folder: Path) -> bool:
    path = os.pathsep.join([str(folder), str(ROOT / "tests")])
    quick = ["-x", "-q", "-p", "no:cacheprovider", "-p", "unshrunk", "-k", "not living_partners and not C22"]
    command = [sys.executable, "-m", "pytest", *quick, *TESTS]
    environment = {**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1", "COMANIP_KERNELS": "numpy"}
    try:
        return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, timeout=120).returncode != 0
    except subprocess.TimeoutExpired:
        return True


def caught(defect: tuple[str, str, str], folder: Path) -> bool:
    text, old, new = defect
    originals = {folder / "comanip/skills" / name: (ROOT / "src/comanip/skills" / name).read_text() for name in SOURCES}
    where = [file for file, source in originals.items() for _ in range(source.count(old))]
    if len(where) != 1:
        sys.exit(f"{text}: occurs {len(where)} times: {old!r}")
    where[0].write_text(originals[where[0]].replace(old, new))
    try:
        return noticed(folder)
    finally:
        where[0].write_text(originals[where[0]])


def main() -> None:
    survivors = []
    defects = DEFECTS[slice(*([int(n) for n in sys.argv[1:]] + [len(DEFECTS)])[:2])] if sys.argv[1:] else DEFECTS
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "unshrunk.py").write_text(PLUGIN)
        shutil.copytree(ROOT / "src/comanip", folder / "comanip")
        if noticed(folder):
            sys.exit("the tests fail without any defect")
        for defect in defects:
            was = caught(defect, folder)
            print("caught  " if was else "SURVIVES", defect[0], flush=True)
            survivors += [] if was else [defect[0]]
    n = len(defects)
    print(f"{n - len(survivors)} of {n} caught ({100 * (n - len(survivors)) / n:.0f} %); alive: {', '.join(survivors) or 'none'}")


if __name__ == "__main__":
    main()
