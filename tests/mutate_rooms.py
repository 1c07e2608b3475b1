"""Plants one fault at a time, of a kind that somebody could write, in a copy of the rooms, and counts how many the tests notice.

    python tests/mutate_rooms.py [PART ...]      parts of the names of files, all where none is given

Each line below is (the text that stands there, what is planted instead). Before anything is planted the tests of a room must
pass. Not collected by pytest: it takes minutes. Where compiled code has a twin, the Python one is tested.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parent.parent
SOURCE = ROOT / "src" / "comanip"
Fault = tuple[str, str]
ROOMS: dict[str, tuple[str, list[Fault]]] = {  # file -> (the tests that are to notice, faults)
    "trials/judging.py": (
        "tests/trials/test_judging.py tests/trials/test_following.py",
        [
            ("case.event_s + case.within_s + NOTICED_S", "case.event_s + case.within_s + 4.0 * NOTICED_S"),
            ('["skill.mode"].values[after][0].max() > 0', '["skill.mode"].values[after].max() > 0'),
            ("np.flatnonzero(after)[0]]).max() > 0.05", "np.flatnonzero(after)[0]]).max() > 0.5"),
            ('half * recording["hand.acceleration"].values - true', "-true"),
            ('recording["partner.force"].values - weight', 'recording["partner.force"].values'),
            ("half = 0.5 * case.beam_mass_kg", "half = case.beam_mass_kg"),
            ("effort_share=effort_share(mine, theirs)", "effort_share=effort_share(theirs, mine)"),
        ],
    ),
    "evaluation/metrics.py": (
        "tests/evaluation/test_metrics.py",
        [
            ("return a / (a + b) if a + b > 0.0 else 0.5", "return b / (a + b) if a + b > 0.0 else 0.5"),
            ("opposed = np.sign(first) != np.sign(second)", "opposed = np.sign(first) == np.sign(second)"),
            ("np.maximum(-(first * second).sum(axis=1) / (a * b), 0.0)", "np.abs((first * second).sum(axis=1) / (a * b))"),
            ("(np.minimum(a, b) * against)", "(np.maximum(a, b) * against)"),
            ("np.abs(power.sum(axis=1) if power.ndim == 2 else power)", "np.abs(power)"),
        ],
    ),
    "skills/reference.py": (
        "tests/skills/test_reference.py tests/skills/test_tracking.py",
        [
            ("felt - np.linspace(felt[0], felt[-1], len(felt))", "felt"),
            ("path += (way / way[-1])[:, None] * (end - path[-1])", "path += end - path[-1]"),
            ("path += (way / way[-1])[:, None] * (end - path[-1])", "path *= end / path[-1]"),
            ("position[: max(moving[0], 1)].mean(axis=0)", "position[-1]"),
            ("gain[n] = 2.0 * known / (1.0 + np.sqrt(1.0 + 4.0 * step_s * known))", "gain[n] = known"),
            ("low = max(int((near_s - reach_s) / self.step_s), 0)", "low = 0"),
        ],
    ),
    "formats/csv_file.py": (
        "tests/formats/test_csv_file.py tests/formats/test_csv_dialects.py",
        [
            (
                "del self._lines[: 2 if units else 1], self._numbers[: 2 if units else 1]",
                "del self._lines[:1], self._numbers[:1]",
            ),
            ("number == self._numbers[0] - 1]", "number >= 0]"),
            ('(self._separator, "", ",", ";")', "(self._separator,)"),
            ("len(row) == width + 1 and not row[-1].strip()", "len(row) == width + 1"),
            ('names = [f"{n} [{u}]" if u else n', "names = [n"),
            ("match is None or match[1] != _digest(first, body)", "match is None"),
        ],
    ),
    "lessons/faults.py": (
        "tests/lessons/test_velocity.py tests/faults/test_data_faults.py",
        [
            ("abs(lag) >= max(LAG_WARNED, 2.0 * dt)", "abs(lag) >= 10.0 * LAG_WARNED"),
            ("1.0 - best**2 < 0.5 * (1.0 - correlation**2)", "True"),
            ("if abs(lag) >= LAG_REFUSED:", "if abs(lag) > 10.0 * LAG_REFUSED:"),
            ("{'late' if lag > 0 else 'early'}", "{'early' if lag > 0 else 'late'}"),
            ("if correlation < -0.5:", "if correlation < -2.0:"),
            ("np.median(np.abs(step - usual)) > JITTERY * usual", "np.median(np.abs(step - usual)) > 10.0 * usual"),
        ],
    ),
    "lessons/stamps.py": (
        "tests/lessons/test_velocity.py tests/faults/test_data_faults.py",
        [
            ("missing = max(0, round(later / dt - 0.15))", "missing = max(0, round(between[k] / dt) - 1)"),
            ("later = np.median(off[k + 1 : k + 41]) - np.median(off[max(0, k - 39) : k + 1])", "later = off[k + 1] - off[k]"),
        ],
    ),
    "lessons/cuts.py": (
        "tests/test_cuts.py",
        [
            ("before < merged[-1][1]", "before < merged[-1][0]"),
            ("max(after, merged[-1][1])", "after"),
            ("frames - max(0, end - keep)", "frames - max(0, end)"),
            ("first, last = max(0, start - keep)", "first, last = max(0, start)"),
            ("(channel.time <= stop)", "(channel.time < stop)"),
        ],
    ),
    "models/clock.py": (
        "tests/models/test_clock.py",
        [
            ("usual = np.median(occupancy, axis=0)", "usual = np.mean(occupancy, axis=0)"),
            ("np.cumsum(h @ (usual / np.maximum(n, 1e-9))) * dt", "np.cumsum(h @ (usual / usual)) * dt"),
        ],
    ),
    "learned/stream.py": (
        "tests/models/test_clock.py tests/models/test_streaming.py",
        [
            ("np.median(occupancy, axis=0)", "np.mean(occupancy, axis=0)"),
            ("np.cumsum(h @ (usual / np.maximum(h.sum(axis=0), 1e-9)))", "np.cumsum(h @ (usual / usual))"),
            ("lessons.z[:, :d].max(axis=0, keepdims=True)", "lessons.z[:, :d].min(axis=0, keepdims=True)"),
            ("(centres + origin) * in_seconds", "centres * in_seconds"),
            ("covariances = floored(covariances / np.outer(scale, scale), covariance_floor) * np.outer(scale, scale)", "pass"),
            ("covariances * np.outer(in_seconds, in_seconds)", "covariances"),
            ("ends=ends[some]", "ends=starts[some]"),
            ("occupancy / occupancy.sum()", "np.full(len(occupancy), 1.0 / len(occupancy))"),
            ("forces = [x[:, d : 2 * d] if x.shape[1] == 3 * d", "forces = [x[:, 2 * d :] if x.shape[1] == 3 * d"),
        ],
    ),
    "models/gmr.py": (
        "tests/laws/test_regression_laws.py",
        [
            ('covariance += np.einsum("...k,...ko,...kp->...op", weights, apart, apart)', "pass"),
            ("apart = lines - mean[..., None, :]", "apart = lines"),
            ("np.log(np.maximum(model.weights, 1e-300))", "0.0"),
            ("spread = sigma_oo - gains @ sigma_io", "spread = sigma_oo"),
            ("sigma_ii = sigma_ii + np.diag(input_noise)", "pass"),
            ("self._input_covariances = self._input_covariances + np.diag(self._noise)", "pass"),
            ("np.where(dead[:, :, None], 0.0, sigma_io)", "sigma_io"),
            (
                "return Regression(self.model, present, self.outputs, input_noise=noise)",
                "return Regression(self.model, present, self.outputs)",
            ),
            ("return regression.shares(x)\n", "return regression.shares(x, np.arange(float(model.n_states)))\n"),
            ("values = np.maximum(values, LEAST_EIGENVALUE * values[:, -1:])", "pass"),
            ("size = np.where(size > 0.0, size, 1.0)", "size = np.ones_like(size)"),
        ],
    ),
    "skills/teleoperation.py": (
        "tests/skills/test_teleoperation_power.py tests/faults/test_teleoperation_faults.py "
        "tests/faults/test_teleoperation_absurd.py",
        [
            ("* power / self._scale**2", "* power / self._scale"),
            ("sqrt(2.0 * a * max(left, 0.0)) - a * self._dt", "sqrt(2.0 * a * max(left, 0.0))"),
            ("any(sample) and now == self._sample_before", "now == self._sample_before"),
            ("share = gain if self._asked_n <= self._most_n else gain * self._most_n / self._asked_n", "share = gain"),
            ("if (allowed < gain and not self._reason) or", "if"),
            ("self._ramp = min(1.0, self._ramp + self._dt / self.limits.ramp_s)", "self._ramp = 1.0"),
            ("wishes = _no_faster(wishes, self.limits.v_max_m_per_s)", "pass"),
            ("self._silent_s, self._met = 0.0, True", "self._met = True"),
            (" and not any(self._velocity):", ":"),
            ("self._released = False  # pressed at the wrong place: once more", "pass"),
            ("[f - rest for f, rest in zip(", "[f for f, rest in zip("),
            ("self._velocity[i] = min(max(allowed, last - step), last + step)", "self._velocity[i] = allowed"),
        ],
    ),
    "formats/ros2.py": (
        "tests/formats/test_bags.py tests/formats/test_mcap_file.py",
        [
            ("self._at += -(self._at - 4) % size", "self._at += -self._at % size"),
            ('"<" if message[1] else ">"', '"<"'),
            ("self._fixed.append((at, self._message[at : at + 4]))", "pass"),
            ('shape.texts.get("child_frame_id")', 'shape.texts.get("header.frame_id")'),
            ("int(length) if length and not bounded else -1", "int(length) if length else -1"),
        ],
    ),
    "devices/link.py": (
        "tests/faults/test_link.py",
        [
            ("elif number > self._newest:", "else:"),
            ("self._energy += power * duration", "self._energy = power * duration"),
            ("self._network.jitter_s * self._rng.random()", "0.0 * self._rng.random()"),
            ("elif self.time - self._heard > SILENCE_S:", "elif False:"),
            (
                "network.loss / (network.loss + network.burst * (1.0 - network.loss))",
                "network.loss / (1.0 - network.loss) / network.burst",
            ),
            ("self.time - packet[1] - self._period", "self.time - packet[1]"),
        ],
    ),
    "evaluation/forecasting.py": (
        "tests/evaluation/test_forecasting.py",
        [
            ("horizon * lesson.velocity[rows])", "0.0 * lesson.velocity[rows])"),
            ("held[-1, -1] = 0.0", "pass"),
            ("if nothing <= costs[best]:", "if False:"),
            ("cost < plain_cost and len(lessons) > 1", "True"),
            ("if take != takes[i]]", "]"),
            ("_solved(total[0] - zz, total[1] - zy, penalty)", "_solved(total[0], total[1], penalty)"),
        ],
    ),
    "robots/preflight.py": (
        "tests/robots/test_over_wire.py",
        [
            ("np.diff(stamps) > 0.0", "np.diff(stamps) >= 0.0"),
            ("ok = speed <= REST_M_PER_S and moved <= REST_M", "ok = speed <= REST_M_PER_S"),
            ("if np.ptp(column) == 0.0]", "if False]"),
            ("force[:half].mean(axis=0) - force[half:].mean(axis=0)", "force[:half].mean(axis=0) - force[:half].mean(axis=0)"),
            ("off = abs(along - settings.mass_kg) * share * g2**0.5", "off = 0.0"),
            ("ok = rate >= least and gap <= stale", "ok = rate >= least"),
            ("ok = most + dt <= allowed and often <= LATE_SHARE", "ok = most + dt <= allowed"),
            ('slow = what == "force" and share > 0.0', "slow = False"),
            ("across = mean - gravity * float(mean @ gravity) / g2", "across = mean"),
            ("if not low <= x <= high:", "if not low <= x:"),
            ("** 0.5 - 0.5 * brake * late", "** 0.5"),
            ("stamps = np.where(np.isfinite(found.force_time), found.force_time, found.time)", "stamps = found.time"),
            ("more = sum(not other.passed for other in lines) - 1", "more = 0"),
        ],
    ),
    "robots/guard.py": (
        "tests/robots/test_guard.py tests/robots/test_over_wire.py",
        [
            ("left = max(0.0, speed - self._a * self._dt)", "left = speed"),
            ("walls.append((max(low, least), min(high, most)))", "walls.append((least, most))"),
            ("share * min(taught.v_max_m_per_s, settings.speed_m_per_s)", "share * settings.speed_m_per_s"),
            ("self.rearmed += not self.answer", "self.rearmed += 1"),
            ("self._why = self._why or why", "self._why = why"),
            ("command.position -= command.velocity * self._dt", "pass"),
            (
                "a_max_m_per_s2=min(taught.a_max_m_per_s2, settings.acceleration_m_per_s2)",
                "a_max_m_per_s2=settings.acceleration_m_per_s2",
            ),
            ("force_limit_n=min(taught.force_limit_n, settings.force_n)", "force_limit_n=settings.force_n"),
            ("drift_m=APART_M if shadow else taught.drift_m", "drift_m=taught.drift_m"),
            ("late_s=settings.late_s,", ""),
            (
                'return self._over or ("" if self._why else self.envelope.stop_reason)',
                "return self._over or self.envelope.stop_reason",
            ),
        ],
    ),
    "skills/collaborate.py": (
        "tests/skills/test_pace.py tests/skills/test_collaborate.py",
        [
            ("rate *= reference.top_speed / speed", "pass"),
            ("return min(1.0, self.reference.top_speed / asked) if asked > 1e-9 else 1.0", "return 1.0"),
            ("self._expected[:] = pace.expected", "pass"),
            ("excess = min(along + law.comfortable_n, 0.0)", "excess = min(along, 0.0)"),
            ("slowest = max(law.slowest_clock, self._in_time(s, faded, led_s))", "slowest = law.slowest_clock"),
            ("self.expected[i] = rate * felt[i]", "self.expected[i] = felt[i]"),
            ("rate *= ease * ease * (3.0 - 2.0 * ease)", "pass"),
            ("left_s = LATEST * (left + gone) - led_s", "left_s = LATEST * left - led_s"),
            ("max(FADES_S, 1.875 * off / (FADES_BELOW * max(reference.top_speed, 1e-9)))", "FADES_S"),
            ("self.until[0] += self.model_dt", "self.until[0] += self._dt"),
            ("resistance += min(self._dt / law.patience_s, 1.0) * (excess - resistance)", "resistance = excess"),
        ],
    ),
}


def noticed(folder: Path, tests: str, twin: bool) -> bool:
    """Whether a test fails with the copy in `folder`; `twin`: with the Python that is otherwise compiled."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests.split()]
    path = os.pathsep.join([str(folder), str(ROOT / "tests")])
    kernels = {"COMANIP_KERNELS": "numpy"} if twin else {}
    environment = {**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1", **kernels}
    try:
        return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, timeout=600).returncode != 0
    except subprocess.TimeoutExpired:
        return True


def tried(folder: Path, name: str, tests: str, faults: list[Fault]) -> list[str]:
    """Which faults of one file nobody noticed."""
    twin = name.startswith(("skills/", "models/"))
    if noticed(folder, tests, twin):
        sys.exit(f"{name}: {tests} fail with nothing planted")
    source, copy, alive = (SOURCE / name).read_text(), folder / "comanip" / name, []
    for old, new in faults:
        if old not in source:
            sys.exit(f"{name}: {old!r} does not stand there")
        copy.write_text(source.replace(old, new, 1))
        seen = noticed(folder, tests, twin)
        copy.write_text(source)
        print("caught  " if seen else "SURVIVES", f"{name}: {new}", flush=True)
        alive += [] if seen else [f"{name}: {old} -> {new}"]
    return alive


def main() -> None:
    chosen = {name: room for name, room in ROOMS.items() if not sys.argv[1:] or any(part in name for part in sys.argv[1:])}
    with tempfile.TemporaryDirectory() as temporary:
        shutil.copytree(SOURCE, Path(temporary) / "comanip")
        alive = [one for name, room in chosen.items() for one in tried(Path(temporary), name, *room)]
    total = sum(len(faults) for _, faults in chosen.values())
    print(f"{total - len(alive)} of {total} caught; alive: {'; '.join(alive) or 'none'}")
    sys.exit(bool(alive))


if __name__ == "__main__":
    main()
