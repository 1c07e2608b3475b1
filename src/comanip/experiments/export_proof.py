"""Is the exported C the Python, to the last bit? Living partners, misbehaviour, faults of sensors, arbitrary bit patterns.

    python -m comanip.experiments.export_proof --ticks 1e7 --folder proof [--witness aarch64 --witness wasm32]
    python -m comanip.experiments.export_proof --ticks 1e5 leader.json follower.json

Each run drives the pure Python (no compiled kernels) in closed loop: a person on the exact beam, or a hand that goes where it is
sent with somebody who lifts, holds, lets go, blocks or shakes, or a sensor that lies. What it saw goes to the C, too. Command,
felt force, mode, reason, energy, confidence, phase, blend must be equal: one bit that differs is a failure, even a zero's sign.
Weights of the model are compared to 1e-9. It goes in chunks, each kept in FOLDER as it is done: Ctrl-C loses one chunk, and the
same command goes on from there. A witness is another processor that runs the same C over the same ticks.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache, partial
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .. import kernels
from ..commands.console import table
from ..commands.running import taught
from ..errors import ParameterError
from ..export.c_file import reasons, source
from ..export.controller import Controller, controller
from ..export.loaded import Loaded, cmd_type, compiled, obs_type
from ..export.reasons import number_of
from ..export.witness import WITNESSES, Witness
from ..interfaces import Array, Command, Observation
from ..learned import file as skill_file
from ..learned.skill import LearnedSkill
from ..tasks import named
from .export_worlds import Living, World, spoil

TICKS = 1500  # of one run
RUNS = 20  # of one chunk
KINDS = ("well", "faults", "bits")
LIVING = ("people", "people, faults", "people, bits")  # the same, of people on the exact beam, of whom three in ten misbehave
MIX = ("people", "well", "faults", "bits", "people, faults", "faults", "well", "bits", "people, bits", "faults")
TASKS = {"two-shelves": 0.01, "round-the-corner": 0.01, "pick-carry-place": 0.004, "lift": 0.002}  # task -> period [s]
ROLES = ("leader", "follower", "auto")
ACTS = ("follows", "offers to lead", "leads", "complies only")


class Told(NamedTuple):
    """What differs first in a run: tick, what, what the Python and the C say."""

    run: int
    tick: int
    what: str
    python: str
    c: str


class Taken(NamedTuple):
    """What the Python saw and said in one run, and at which ticks it was asked to run again, with its answer."""

    obs: np.ndarray
    cmd: np.ndarray
    said: tuple[str, ...]
    rearmed: dict[int, str]
    weights: Array


def python_run(made: Controller, rng: np.random.Generator, kind: str, ticks: int = TICKS, task: str = "lift") -> Taken:
    d, skill, inner = len(made.axes), made.skill, made.skill.skill
    world: Any = Living(rng, made, task) if kind in LIVING else World(rng, made, _path(made))
    obs, command = Observation(d), Command(d)
    seen, done, said, rearmed = np.zeros(ticks, obs_type(d)), np.zeros(ticks, cmd_type(d)), [], {}
    with np.errstate(all="ignore"):
        for n in range(ticks):
            world.sees(obs)
            if kind not in ("well", "people") and rng.random() < (0.02 if n else 0.1):
                spoil(rng, obs, made.dt, kind.endswith("bits"))
            seen[n] = (obs.time, obs.force_time, obs.position, obs.velocity, obs.sensor_force)
            if n == 0:
                made.estimator.reset()
            made.estimator.step(obs)
            if n == 0:
                skill.reset(obs)
            skill.step(obs, command)
            _keep(done, n, made, obs, command)
            said.append(skill.reason)
            world.goes(command)
            if skill.mode != "RUN" and rng.random() < 0.03:
                world.changes()
                rearmed[n] = skill.rearm(obs)
    return Taken(seen, done, tuple(said), rearmed, inner.diagnostics["weights"].copy())


def _path(made: Controller) -> Array:
    inner: Any = made.skill.skill
    return np.asarray(inner._pace.references[0].position)


def _keep(done: np.ndarray, n: int, made: Controller, obs: Observation, command: Command) -> None:
    skill: Any = made.skill
    inner = skill.skill
    shown = skill.diagnostics
    row = done[n]
    row["position"], row["velocity"], row["acceleration"] = command.position, command.velocity, command.acceleration
    row["force"], row["tank_j"], row["confidence"] = obs.force, shown["tank"][0], shown["confidence"][0]
    row["phase_s"], row["clock_rate"] = shown["phase"][0], shown["clock_rate"][0]
    row["mode"], row["passes"] = int(shown["mode"][0]), skill.passes
    row["reason"] = _number(skill.reason)
    if inner._complies_only:
        row["acts"] = 3
    else:
        row["acts"] = ACTS.index(inner._state) if hasattr(inner, "_state") else 2 * (inner.role == "leader")
    row["blend"] = inner._blend[0] if hasattr(inner, "_blend") else float(row["acts"] == 2)


@cache
def _number(said: str) -> int:
    return number_of(said)


def c_run(loaded: Loaded, taken: Taken) -> tuple[np.ndarray, list[int]]:
    """The same observations to the C, asked to run again at the same ticks."""
    loaded.init()
    out, answers, at = np.zeros(len(taken.obs), cmd_type(loaded.d)), [], 0
    for n in [*taken.rearmed, len(taken.obs) - 1]:
        if n + 1 > at:
            out[at : n + 1] = loaded.run(taken.obs[at : n + 1])
        at = n + 1
        if n in taken.rearmed:
            answers.append(loaded.rearm())
    return out, answers[: len(taken.rearmed)]


def differs(run: int, taken: Taken, found: np.ndarray, answers: Sequence[int]) -> Told | None:
    """The first difference, any NaN being equal to any; None: all is equal."""
    first = len(found), ""
    for name in found.dtype.names or ():
        if name == "reason_value":
            continue
        same = _same(taken.cmd[name].reshape(len(found), -1), found[name].reshape(len(found), -1))
        if not same.all() and (n := int(np.argmin(same))) < first[0]:
            first = n, name
    if first[1]:
        n, name = first
        return Told(run, n, name, f"{taken.cmd[name][n]} {taken.said[n]}", f"{found[name][n]}")
    for (n, said), answer in zip(taken.rearmed.items(), answers, strict=True):
        if _number(said) != answer:
            return Told(run, n, "re-arming", said, str(answer))
    return None


def _same(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(ticks,) whether all bits of a row are the same, those of what is not a number left out."""
    whole = np.dtype(f"i{a.dtype.itemsize}")
    equal = np.ascontiguousarray(a).view(whole) == np.ascontiguousarray(b).view(whole)
    if a.dtype.kind == "f":
        equal |= np.isnan(a) & np.isnan(b)
    return np.asarray(equal.all(axis=1))


@contextmanager
def readable() -> Iterator[None]:
    """What is made in here has no compiled part: the twins that can be read."""
    native = kernels.native
    kernels.native = None
    try:
        yield
    finally:
        kernels.native = native


class Prover:
    """One controller and its C, compiled once; `chunk` is so many runs of one kind, and gives what there is to say about them.

    make   a controller that has never run: one that has remembers where in the task it was
    """

    def __init__(
        self, make: Callable[[], Controller], folder: Path, *, flags: Sequence[str] = ("-O2",), task: str = "lift",
        witnesses: Sequence[str] = (),
    ) -> None:  # fmt: skip
        self._make, self._task = make, task
        self.made = make()
        self.text = source(self.made)
        self._loaded = Loaded(compiled(self.text, folder, flags=flags), self.text.h)
        self._witnesses = {name: Witness(name, self.text, folder) for name in witnesses}

    def _controller(self, pure: bool) -> Controller:
        if not pure:
            return self._make()
        with readable():
            return self._make()

    def chunk(self, kind: str, runs: Iterable[int], seed: int, ticks: int = TICKS, *, pure: bool = True) -> dict[str, Any]:
        began, spent, worst, counts = time.process_time(), 0.0, 0.0, Counter[str]()
        found, all_taken, answered = [], [], []
        for run in runs:
            taken = python_run(self._controller(pure), np.random.default_rng((seed, run)), kind, ticks, self._task)
            at = time.perf_counter()
            cmd, answers = c_run(self._loaded, taken)
            spent += time.perf_counter() - at
            if one := differs(run, taken, cmd, answers):
                found.append(one._asdict())
            worst = max(worst, float(np.abs(self._loaded.weights(len(taken.weights)) - taken.weights).max()))
            counts.update(_counted(taken))
            all_taken.append(taken)
            answered.append((cmd, answers))
        total = sum(len(taken.obs) for taken in all_taken)
        apart = {name: self._by_witness(one, all_taken) for name, one in self._witnesses.items()}
        return {
            "ticks": total, "runs": len(all_taken), "differences": found, "weights_apart": worst,
            "us_c": 1e6 * spent / max(total, 1),
            "us_all": 1e6 * (time.process_time() - began) / max(total, 1), "counts": dict(counts), "witnesses": apart,
        }  # fmt: skip

    def _by_witness(self, witness: Witness, taken: Sequence[Taken]) -> list[dict[str, Any]]:
        answers = witness.answers([(one.obs, list(one.rearmed)) for one in taken])
        told = (differs(n, one, *found) for n, (one, found) in enumerate(zip(taken, answers, strict=True)))
        return [one._asdict() for one in told if one]


def _counted(taken: Taken) -> Counter[str]:
    """What happened: ticks by reason, by mode and by what it did, and how often it was re-armed."""
    cmd, counts = taken.cmd, Counter[str]()
    for number, n in zip(*np.unique(cmd["reason"], return_counts=True), strict=True):
        counts[f"reason {_REASONS[number]}"] += int(n)
    for number, n in zip(*np.unique(cmd["mode"], return_counts=True), strict=True):
        counts[("RUN", "COMPLY", "HOLD")[number]] += int(n)
    for number, n in zip(*np.unique(cmd["acts"], return_counts=True), strict=True):
        counts[ACTS[number]] += int(n)
    counts["between roles"] += int(((cmd["blend"] > 0.0) & (cmd["blend"] < 1.0)).sum())
    counts["changes of role"] += int((np.diff(cmd["acts"]) != 0).sum())
    counts["re-armed"] += sum(not said for said in taken.rearmed.values())
    counts["re-arming refused"] += sum(bool(said) for said in taken.rearmed.values())
    counts["force missing"] += int(np.isnan(taken.obs["sensor_force"]).any(axis=1).sum())
    return counts


_REASONS = [name for name, _ in reasons()]


def prove(
    make: Callable[[], Controller], ticks: int, *, seed: int = 0, flags: Sequence[str] = ("-O2",), runs_of: int = TICKS,
    folder: Path | None = None, witnesses: Sequence[str] = (), pure: bool = True,
) -> dict[str, Any]:  # fmt: skip
    """Numbers of a proof of one controller over so many ticks; `differences` holds the first of each run that has any."""
    with tempfile.TemporaryDirectory() as temporary:
        prover = Prover(make, folder or Path(temporary), flags=flags, witnesses=witnesses)
        count = -(-ticks // runs_of)
        rows = [prover.chunk(KINDS[run % len(KINDS)], [run], seed, runs_of, pure=pure) for run in range(count)]
    made, counts = prover.made, sum((Counter(row["counts"]) for row in rows), Counter[str]())
    by_reason = {name.removeprefix("reason "): n for name, n in counts.most_common() if name.startswith("reason ")}
    return {
        "role": made.role, "axes": len(made.axes), "dt_s": made.dt, "ticks": sum(row["ticks"] for row in rows),
        "differences": [one for row in rows for one in row["differences"]],
        "witnesses": {name: [one for row in rows for one in row["witnesses"][name]] for name in witnesses},
        "state_bytes": prover.text.state_bytes, "us_a_tick": float(np.mean([row["us_c"] for row in rows])),
        "weights_apart": max(row["weights_apart"] for row in rows), "reasons": by_reason, "counts": dict(counts),
    }  # fmt: skip


class Cell(NamedTuple):
    """What one chunk is of."""

    task: str
    role: str
    dt: float
    kind: str
    number: int
    pure: bool = True  # the twins that can be read; else the Python as it runs, with what is compiled


def cells(roles: Sequence[str] = ROLES, tasks: Sequence[str] = tuple(TASKS), pure: int = 5) -> Iterator[Cell]:
    """Chunk after chunk, all combinations by turns; so many of five against the pure Python."""
    each = len(tasks) * len(roles)
    for n in count():
        role, turn = roles[n // len(tasks) % len(roles)], n // each
        task = tasks[n % len(tasks)]
        yield Cell(task, role, TASKS[task], MIX[turn % len(MIX)], n, (n + turn) % 5 < pure)


class Proof:
    """Chunks kept in `folder`/chunks.jsonl, of skills given, or learned once from simulated lessons and kept there, too."""

    def __init__(self, folder: Path, given: Sequence[LearnedSkill], *, seed: int, witnesses: Sequence[str]) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder, self._given, self._seed, self._witnesses = folder, given, seed, tuple(witnesses)
        self._provers: dict[tuple[str, str, float], Prover] = {}
        self._log = folder / "chunks.jsonl"
        self.rows = _read(self._log)

    def learned(self, task: str, role: str) -> list[LearnedSkill]:
        if self._given:
            return list(self._given)
        return [self._kept(task, one) for one in (("leader", "follower") if role == "auto" else (role,))]

    def _kept(self, task: str, role: str) -> LearnedSkill:
        file = self._folder / f"{task}-{role}.json"
        if not file.exists():
            skill_file.save(taught(role, self._seed, task=task), file)
        return skill_file.load(file)

    def prover(self, cell: Cell) -> Prover:
        key = cell.task, cell.role, cell.dt
        if key not in self._provers:
            make = partial(controller, self.learned(cell.task, cell.role), role=cell.role, dt=cell.dt, force_delay_s=0.013)
            folder = self._folder / f"{cell.task}-{cell.role}-{cell.dt:g}"
            self._provers[key] = Prover(make, folder, task=cell.task, witnesses=self._witnesses)
        return self._provers[key]

    def go_on(self, cell: Cell) -> dict[str, Any] | None:
        """One chunk; None where it was done before, with the same C and the same witnesses."""
        prover = self.prover(cell)
        key = {**cell._asdict(), "seed": self._seed, "c": hashlib.sha256(prover.text.c.encode()).hexdigest()[:16]}
        for row in self.rows:
            if all(row.get(name) == value for name, value in key.items()) and set(self._witnesses) <= set(row["witnesses"]):
                return None
        runs = range(cell.number * RUNS, (cell.number + 1) * RUNS)
        row = {**key, "axes": len(prover.made.axes), **prover.chunk(cell.kind, runs, self._seed, pure=cell.pure)}
        with self._log.open("a", encoding="utf-8") as log:
            log.write(json.dumps(row) + "\n")
        self.rows.append(row)
        return row

    def current(self) -> list[dict[str, Any]]:
        """Rows of the C as it is now."""
        now = {key: hashlib.sha256(one.text.c.encode()).hexdigest()[:16] for key, one in self._provers.items()}
        return [row for row in self.rows if now.get((row["task"], row["role"], row["dt"])) == row["c"]]


def _read(log: Path) -> list[dict[str, Any]]:
    """Whole lines: the last may have been cut."""
    rows = []
    for line in log.read_text(encoding="utf-8").splitlines() if log.exists() else []:
        try:
            rows.append(json.loads(line))
        except ValueError:
            continue
    return rows


def shown(rows: Sequence[Mapping[str, Any]]) -> None:
    """Tables on stdout: by kind and role, and what happened in them."""
    groups: dict[tuple[str, str], list[Mapping[str, Any]]] = defaultdict(list)
    for row in rows:
        groups[row["kind"], row["role"]].append(row)
    lines = [
        (kind, role, ",".join(sorted({str(r["axes"]) for r in some})), *_summed(some))
        for (kind, role), some in sorted(groups.items())
    ]
    lines.append(("all", "", "", *_summed(rows)))
    table("C against Python", ("kind", "role", "axes", "ticks", "pure Python", "runs differ", "witnesses", "us C"), lines)
    happened = sum((Counter(r["counts"]) for r in rows), Counter[str]())
    table("What happened", ("what", "ticks"), [(name, f"{n:,}") for name, n in happened.most_common()])


def _summed(rows: Sequence[Mapping[str, Any]]) -> tuple[str, str, str, str, str]:
    """Ticks, those of pure Python, runs that differ, the same by witness, and time of a tick in C [us]."""
    ticks, pure = sum(r["ticks"] for r in rows), sum(r["ticks"] for r in rows if r["pure"])
    differ = sum(len(r["differences"]) for r in rows)
    return (
        f"{ticks:,}",
        f"{pure:,}",
        str(differ),
        _by_witnesses(rows),
        f"{np.mean([r['us_c'] for r in rows]) if rows else 0.0:.2f}",
    )


def _by_witnesses(rows: Sequence[Mapping[str, Any]]) -> str:
    """For each witness ticks and runs that differ."""
    parts = []
    for name in WITNESSES:
        some = [r for r in rows if name in r["witnesses"]]
        if some:
            parts.append(f"{name} {sum(r['ticks'] for r in some):,}: {sum(len(r['witnesses'][name]) for r in some)}")
    return "; ".join(parts)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("skills", nargs="*", type=Path, help="of a leader, of a follower, of both; default: fresh ones")
    parser.add_argument("--ticks", type=float, default=1e5)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--pure", type=int, default=5, help="so many chunks of five against the pure Python, else as it runs")
    parser.add_argument("--folder", type=Path, help="where chunks are kept, to go on from; default: a temporary one")
    parser.add_argument("--witness", action="append", choices=sorted(WITNESSES), default=[], help="run the C there, too")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        skills = [skill_file.load(path) for path in given.skills]
        proof = Proof(given.folder or Path(temporary), skills, seed=given.seed, witnesses=given.witness)
        sys.exit(_prove(proof, int(given.ticks), _asked(given.skills, given.pure)))


def _asked(skills: Sequence[Path], pure: int) -> Iterator[Cell]:
    """Of skills that were given: their roles, and the people of the task that they name."""
    if not skills:
        return cells(pure=pure)
    known = [skill_file.load(path) for path in skills]
    roles = tuple(one.role for one in known) + (("auto",) if len({one.role for one in known}) > 1 else ())
    task = next((t for t in TASKS if named(t).axes == known[0].axes), None)
    if task is None:
        raise ParameterError(f"no task of the proof has the axes {', '.join(known[0].axes)}: leave the skills out")
    return cells(roles, (task,), pure)


def _prove(proof: Proof, ticks: int, asked: Iterable[Cell]) -> int:
    began, done, now = time.monotonic(), 0, 0
    try:
        for cell in asked:
            if done >= ticks:
                break
            row = proof.go_on(cell)
            done += RUNS * TICKS
            if row is not None:
                now += row["ticks"]
                rate = now / (time.monotonic() - began)
                bad = len(row["differences"]) + sum(map(len, row["witnesses"].values()))
                print(
                    f"{done:>11,} of {ticks:,} ticks  {rate:,.0f} a second  {cell.task} {cell.role} {cell.dt:g} s {cell.kind}"
                    + (f"  {bad} RUNS DIFFER" if bad else ""),
                    file=sys.stderr, flush=True,
                )  # fmt: skip
    except KeyboardInterrupt:
        print("interrupted: the same command goes on from here", file=sys.stderr)
    rows = proof.current()
    shown(rows)
    return int(any(r["differences"] or any(r["witnesses"].values()) for r in rows))


if __name__ == "__main__":
    main()
