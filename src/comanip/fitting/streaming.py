"""Learning from more data than memory holds: EM whose sums are taken shard by shard, wherever the shards are read.

A shard is one file; `read(path)` yields its pieces, lists of whole sequences (T, D). One pass over all shards maps the E-step and
adds the sums IN THE ORDER OF THE SHARDS, so the bits do not depend on how many workers there are, here or on a cluster
(`comanip.backend`). Passes: a survey (mean, spread), a first guess by time bins, stepwise EM if wished, then EM.

What `fit_hmm` does on data in memory and this does not: the search for outliers (it needs a median), for repeated demonstrations
and for collinear channels.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..errors import ParameterError, SkillFileError, TrainingError
from ..interfaces import Array
from ..models.gaussian import channel_names
from ..models.hmm import Hmm
from ..models.moments import moments_about
from ..parallel import each
from ..whole_file import digest, write_whole
from . import cycles
from .baum_welch import Chain, Statistics, allowed_transitions, expect, from_counts, label_counts, maximise
from .climb import Fit, climb
from .coordinates import Coordinates, Lessons, Notes, checked, stated_spread
from .guesses import say_nothing_repeats, time_bins
from .hmm import finished, weights_of
from .m_step import gaussians_of_moments

Read = Callable[[str], Iterable[list[Array]]]
Progress = Callable[[str, int, int], None]
FORMAT, VERSION = "comanip.stream", 1
FORGETTING = 0.7  # step (n + 2)^−0.7 of stepwise EM: between 0.5 and 1 it converges, and Liang & Klein found 0.7 good


class Source(NamedTuple):
    """What a worker needs to make lessons of a shard: it pickles."""

    read: Read
    channels: tuple[str, ...]
    least: int
    offset: Array | None = None
    scale: Array | None = None

    def pieces(self, path: str) -> Iterator[tuple[list[Array], int]]:
        """Sequences that are checked and long enough, and how many were too short."""
        for piece in self.read(path):
            try:
                arrays = [checked(x, s, self.channels) for s, x in enumerate(piece)]
            except TrainingError as error:
                raise TrainingError(f"{path}: {error}") from None
            kept = [a for a in arrays if len(a) >= self.least]
            yield kept, len(arrays) - len(kept)

    def lessons(self, path: str) -> Iterator[Lessons]:
        """In z; only after the survey."""
        assert self.offset is not None
        assert self.scale is not None
        for kept, _ in self.pieces(path):
            if kept:
                z = np.concatenate(kept)
                z -= self.offset
                z /= self.scale
                yield Lessons(z, np.array([len(a) for a in kept]), self.offset, self.scale, self.channels)


@dataclass(frozen=True, eq=False)
class Survey(Coordinates):
    """All data in a few numbers: the Coordinates to learn in."""

    offset: Array
    scale: Array
    channels: tuple[str, ...]
    frames: int
    sequences: int
    notes: Notes = field(default_factory=Notes)

    @property
    def n_frames(self) -> int:
        return self.frames


def fit_stream(
    shards: Sequence[str | Path],
    n_states: int,
    *,
    channels: Iterable[str],
    read: Read,
    topology: str = "left-right",
    stepwise_passes: int = 0,
    batch: int = 8,
    covariance_floor: float = 1e-4,
    transition_floor: float = 0.0,
    max_iterations: int = 200,
    tolerance: float = 1e-5,
    allow_constant: float | Mapping[str, float] | None = None,
    n_jobs: int = 1,
    checkpoint: str | Path | None = None,
    checkpoint_every: int = 64,
    progress: Progress | None = None,
) -> Fit[Hmm]:
    """As `fit_hmm` from the guess "time", over shards that are read again in every pass: the same model to rounding.

    read              path -> pieces, lists of sequences (T, D) in the order of `channels`; see `comanip.lessons.shards`. It must
                      pickle when other processes are to call it, and give the same at every call
    stepwise_passes   passes of stepwise EM (Cappé & Moulines 2009; Liang & Klein 2009) before EM: the model moves after every
                      `batch` shards, drawn in an order that is the same each time. Where one pass costs minutes it saves several
    n_jobs            processes; inside `comanip.backend("dask", ...)` the cluster reads and computes
    checkpoint        a file in which progress is kept, every `checkpoint_every` shards and after every pass. If it exists the
                      work goes on from there, to the same last bit as without the interruption
    progress          called with (pass, shards done, shards)

    Raises TrainingError that names shard, sequence, frame and value; SkillFileError for a checkpoint that is damaged or belongs
    to other shards or settings.
    """
    names = channel_names(channels)
    paths = [str(p) for p in shards]
    if not paths:
        raise TrainingError("no shard was given; one file is the least")
    for name, value, least in (("n_states", n_states, 1), ("batch", batch, 1), ("checkpoint_every", checkpoint_every, 1),
                               ("stepwise_passes", stepwise_passes, 0)):  # fmt: skip
        if int(value) != value or value < least:
            raise ParameterError(f"{name} must be a whole number of at least {least}; got {value!r}")
    if not 0.0 < covariance_floor < 1.0:
        raise ParameterError(f"covariance_floor is a ratio of variances between 0 and 1; got {covariance_floor!r}")
    if topology not in ("left-right", "cyclic", "free"):
        raise ParameterError(f"topology must be 'left-right', 'cyclic' or 'free'; got {topology!r}")
    if not 0.0 <= transition_floor * n_states < 1.0:
        raise ParameterError(f"transition_floor must be below 1 / n_states; got {transition_floor!r}")
    allowed = allowed_transitions(topology, n_states)
    task = {
        "shards": [[p, Path(p).stat().st_size if Path(p).exists() else None] for p in paths],
        "channels": list(names), "n_states": n_states, "topology": topology, "stepwise": [stepwise_passes, batch],
        "floors": [covariance_floor, transition_floor], "constant": repr(allow_constant), "read": repr(read),
    }  # fmt: skip
    run = _Run(paths, n_jobs, None if checkpoint is None else Path(checkpoint), checkpoint_every, digest(task), progress)
    source = Source(read, names, n_states + 1)
    survey = _surveyed(run, source, n_states, covariance_floor, allow_constant)
    source = source._replace(offset=survey.offset, scale=survey.scale)
    if run.chain is None:
        run.keep(chain=_first_guess(run, source, n_states, allowed, covariance_floor, topology, survey.notes))
    _stepwise(run, source, survey, stepwise_passes, batch, covariance_floor, transition_floor)
    last: list[Statistics] = []

    def scored(p: Chain, stage: str = "") -> tuple[float, Statistics]:
        total, *sums = run.fold(stage or f"EM pass {len(run.trace) + 1}", _expect, (source, p))
        last[:] = [Statistics(sums[0], np.zeros(len(names)), sums[1], sums[2])]
        return float(total), last[0]

    def moved(e: Statistics, p: Chain) -> Chain:
        new = maximise(e, p, covariance_floor, transition_floor)
        run.keep(chain=new)
        return new

    assert run.chain is not None
    found = climb(run.chain, scored, moved, max_iterations=max_iterations, rise=tolerance * survey.frames, trace=run.trace)
    return finished(
        *found, ground=survey, topology=topology, allowed=allowed, occupancy=last[0].moments[:, -1, -1],
        time=lambda: run.fold("order of states", _times, (source, found[0]))[0], score=lambda p: scored(p, "last score")[0],
    )  # fmt: skip


# ------------------------------------------------------------------------------------- what a worker does with a shard


def _count(path: str, source: Source) -> tuple[Any, ...]:
    """(frames, mean, squares about it, lowest, highest, sequences, sequences too short) of a shard."""
    found: tuple[Any, ...] | None = None
    short = 0
    for kept, too_short in source.pieces(path):
        short += too_short
        if kept:
            x = np.concatenate(kept)
            mean = x.mean(axis=0)
            part = (float(len(x)), mean, ((x - mean) ** 2).sum(axis=0), x.min(axis=0), x.max(axis=0), float(len(kept)), 0.0)
            found = part if found is None else _merged(found, part)
    if found is None:
        d = len(source.channels)
        found = (0.0, np.zeros(d), np.zeros(d), np.full(d, 1e300), np.full(d, -1e300), 0.0, 0.0)
    return (*found[:6], float(short))


def _merged(a: Sequence[Any], b: Sequence[Any]) -> tuple[Any, ...]:
    """Chan's rule: mean and squares of two sets of frames together, without the cancellation of Σx² − (Σx)²/n."""
    n = a[0] + b[0]
    apart = b[1] - a[1]
    share = b[0] / max(n, 1.0)
    squares = a[2] + b[2] + apart**2 * a[0] * share
    return (n, a[1] + apart * share, squares, np.minimum(a[3], b[3]), np.maximum(a[4], b[4]), a[5] + b[5], a[6] + b[6])


def _guess(path: str, source: Source, n_states: int, cycle: cycles.Cycle | None) -> tuple[Any, ...]:
    """Moments (K, D + 1, D + 1) about 0 of the time bins or phases, transitions between them, bins of first frames."""
    d = len(source.channels)
    sums: tuple[Any, ...] = (np.zeros((n_states, d + 1, d + 1)), np.zeros((n_states, n_states)), np.zeros(n_states))
    for lessons in source.lessons(path):
        labels = time_bins(lessons, n_states) if cycle is None else cycles.phases(lessons.z, lessons.lengths, cycle)
        moments = moments_about(np.zeros(d), lessons.z, np.eye(n_states)[labels])
        sums = _added(sums, (moments, *label_counts(lessons, labels, n_states)))
    return sums


def _expect(path: str, source: Source, p: Chain) -> tuple[Any, ...]:
    """(log-likelihood, moments about 0, transitions, first) of a shard."""
    k, d = p.means.shape
    sums: tuple[Any, ...] = (0.0, np.zeros((k, d + 1, d + 1)), np.zeros((k, k)), np.zeros(k))
    for lessons in source.lessons(path):
        total, e = expect(p, lessons)
        sums = _added(sums, (total, _about_zero(e.moments, e.origin), e.transitions, e.first))
    return sums


def _times(path: str, source: Source, p: Chain) -> tuple[Any, ...]:
    """Σ γ × normalised time (K,) of a shard."""
    sums: tuple[Any, ...] = (np.zeros(len(p.initial)),)
    for lessons in source.lessons(path):
        sums = _added(sums, (lessons.normalised_time() @ weights_of(p, lessons),))
    return sums


def _added(a: Sequence[Any], b: Sequence[Any]) -> tuple[Any, ...]:
    return tuple(x + y for x, y in zip(a, b, strict=True))


def _about_zero(moments: Array, origin: Array) -> Array:
    """Moments of (z − origin, 1) become those of (z, 1); stepwise EM mixes passes whose origins differ. z is near 0 anyway."""
    shift = np.eye(len(origin) + 1)
    shift[:-1, -1] = origin
    return np.asarray(shift @ moments @ shift.T)


# ------------------------------------------------------------------------------------------------------ the passes


def _surveyed(
    run: _Run, source: Source, n_states: int, covariance_floor: float, allow_constant: float | Mapping[str, float] | None
) -> Survey:
    if run.survey is None:
        run.keep(survey=run.fold("survey", _count, (source,), _merged))
    assert run.survey is not None
    n, mean, squares, low, high, sequences, short = run.survey
    if not n:
        raise TrainingError(
            f"{n_states} states need >= {source.least} frames in a sequence; none of the {len(run.paths)} shards has that: "
            "give longer sequences or ask for fewer states"
        )
    notes, scale = Notes(), np.sqrt(squares / n)
    stated_spread(scale, low, high, source.channels, int(sequences), covariance_floor, allow_constant, notes)
    if short:
        notes.say(f"skipped {int(short)} sequences too short for {n_states} states (>= {source.least} frames)")
    return Survey(np.array(mean), scale, source.channels, int(n), int(sequences), notes)


def _first_guess(
    run: _Run, source: Source, n_states: int, allowed: np.ndarray, floor: float, topology: str, notes: Notes
) -> Chain:
    cycle = None
    if topology == "cyclic":
        stacked = (lessons for path in run.paths for lessons in source.lessons(path))
        cycle = cycles.first_cycle((z for some in stacked for z in np.split(some.z, some.first_frames()[1:])), n_states)
        if cycle is None:
            say_nothing_repeats(notes)
    moments, counts, first = run.fold("first guess", _guess, (source, n_states, cycle))
    if cycle is not None:  # numbered from where most begin
        order = np.roll(np.arange(n_states), -int(first.argmax()))
        moments, counts, first = moments[order], counts[np.ix_(order, order)], first[order]
    whole = moments.sum(axis=0) / moments[:, -1, -1].sum()
    centre = whole[:-1, -1]
    everything = np.tile(centre, (n_states, 1)), np.tile(whole[:-1, :-1] - np.outer(centre, centre), (n_states, 1, 1))
    means, covariances = gaussians_of_moments(moments, np.zeros(len(centre)), floor, everything)
    return from_counts(counts, first, means, covariances, allowed, topology)


def _stepwise(
    run: _Run, source: Source, survey: Survey, passes: int, batch: int, covariance_floor: float, transition_floor: float
) -> None:
    """Sums a frame, s ← (1 − η) s + η ŝ after each batch of shards, and a step of M from s."""
    per_pass = -(-len(run.paths) // batch)
    for step in range(run.steps, passes * per_pass):
        order = np.random.default_rng(step // per_pass).permutation(len(run.paths))
        chosen = order[step % per_pass * batch :][:batch]
        assert run.chain is not None
        stage = f"stepwise pass {step // per_pass + 1}, batch {step % per_pass + 1} of {per_pass}"
        _, *sums = run.fold(stage, _expect, (source, run.chain), paths=[run.paths[i] for i in chosen])
        n = float(sums[0][:, -1, -1].sum())
        if n == 0.0:
            continue  # shards without a sequence that is long enough
        share = (step + 2) ** -FORGETTING if run.running else 1.0
        running = [(1.0 - share) * old + share * s / n for old, s in zip(run.running or sums, sums, strict=True)]
        e = Statistics(survey.frames * running[0], np.zeros(len(survey.offset)), *(survey.frames * s for s in running[1:]))
        run.keep(running=running, steps=step + 1, chain=maximise(e, run.chain, covariance_floor, transition_floor))


class _Run:
    """Folds over shards, and what a checkpoint holds of them: where each pass is, and every float to the last bit."""

    def __init__(
        self, paths: list[str], n_jobs: int, file: Path | None, every: int, task: str, progress: Progress | None
    ) -> None:
        self.paths, self.n_jobs, self.file, self.every, self.task, self.progress = paths, n_jobs, file, every, task, progress
        self.survey: Sequence[Any] | None = None
        self.chain: Chain | None = None
        self.running: list[Array] | None = None
        self.steps = 0
        self.trace: list[float] = []
        self._stage, self._at, self._sums = "", 0, None  # type: tuple[str, int, Sequence[Any] | None]
        if file is not None and file.exists():
            self._load(file)

    def keep(self, **found: Any) -> None:
        """Takes the outcome of a pass, and stores it."""
        for name, value in found.items():
            setattr(self, name, value)
        self._stage = ""
        self._save()

    def fold(
        self,
        stage: str,
        function: Callable[..., tuple[Any, ...]],
        arguments: tuple[Any, ...],
        add: Callable[[Sequence[Any], Sequence[Any]], tuple[Any, ...]] = _added,
        paths: list[str] | None = None,
    ) -> Sequence[Any]:
        """function(path, *arguments) of all shards, added from left to right; goes on where a checkpoint stopped."""
        paths = self.paths if paths is None else paths
        if self._stage != stage:
            self._stage, self._at, self._sums = stage, 0, None
        for part in each(function, ((path, *arguments) for path in paths[self._at :]), n_jobs=self.n_jobs):
            self._sums = part if self._sums is None else add(self._sums, part)
            self._at += 1
            if self.progress is not None:
                self.progress(stage, self._at, len(paths))
            if self._at % self.every == 0 or self._at == len(paths):
                self._save()
        assert self._sums is not None
        return self._sums

    def _save(self) -> None:
        if self.file is None:
            return
        content: dict[str, Any] = {
            "format": FORMAT, "version": VERSION, "task": self.task, "survey": _plain(self.survey), "chain": _plain(self.chain),
            "running": _plain(self.running), "steps": self.steps, "trace": self.trace, "stage": self._stage,
            "at": self._at if self._stage else 0, "sums": _plain(self._sums) if self._stage else None,
        }  # fmt: skip
        content["sha256"] = digest(content)
        write_whole(self.file, json.dumps(content, allow_nan=False) + "\n")

    def _load(self, file: Path) -> None:
        try:
            content = json.loads(file.read_text(encoding="utf-8"))
            whole = content["format"] == FORMAT and content["version"] == VERSION and content["sha256"] == digest(content)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise SkillFileError(f"{file}: not a checkpoint that can be read ({error}); delete it to begin anew") from None
        if not whole:
            raise SkillFileError(f"{file}: does not match its sha256, or another version wrote it; delete it to begin anew")
        if content["task"] != self.task:
            raise SkillFileError(
                f"{file}: a checkpoint of other shards, channels or settings; delete it to begin anew, or name another file"
            )
        self.survey, self.running = _arrays(content["survey"]), _arrays(content["running"])
        self.chain = None if content["chain"] is None else Chain(*_arrays(content["chain"]) or ())
        self.steps, self.trace = int(content["steps"]), [float(v) for v in content["trace"]]
        self._stage, self._at, self._sums = content["stage"], int(content["at"]), _arrays(content["sums"])


def _plain(values: Sequence[Any] | None) -> list[Any] | None:
    return None if values is None else [np.asarray(v).tolist() for v in values]


def _arrays(values: list[Any] | None) -> list[Any] | None:
    return None if values is None else [np.array(v) if isinstance(v, list) else v for v in values]
