"""A LearnedSkill from more lessons than memory holds: `learned.learn.learn`, with every sum taken shard by shard."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ChannelError
from ..fitting.baum_welch import Chain
from ..fitting.hmm import weights_of
from ..fitting.streaming import Progress, Read, Source, fit_stream
from ..interfaces import Array
from ..lessons.shards import Checked, check_file, checked
from ..models.clock import PHASE
from ..models.gaussian import floored
from ..models.gmm import Gmm
from ..models.hmm import Hmm
from ..models.moments import moments_about
from ..models.taught_path import TaughtPath, taught_paths
from ..parallel import each
from ..recording import check_role
from .learn import NO_PATHS, assembled, in_order, states_of, workspace_around
from .skill import LearnedSkill

UNITS = {"position": "m", "force": "N", "velocity": "m/s"}


def learn_stream(
    shards: Sequence[str | Path],
    *,
    read: Read,
    channels: Sequence[str],
    dt: float,
    role: str = "",
    law: str = "default",
    n_states: int | None = None,
    topology: str = "left-right",
    covariance_floor: float = 1e-4,
    settings: Mapping[str, Any] | None = None,
    n_jobs: int = 1,
    progress: Progress | None = None,
    check: bool = True,
    **options: Any,
) -> LearnedSkill:
    """A skill from shards of lessons of one role, in SI units; `options` go to `fit_stream` (checkpoint, stepwise_passes ...).

    read      path -> pieces, lists of (T, D) in the order of `channels`: position.*, force.* (or none), velocity.*
    dt        period of all lessons [s]; held against the stamps that the shards have
    check     every episode is held against what a lesson in memory is, once, by the reader's own `check` (see `lessons.shards`);
              about 10 us a frame. False leaves that out
    """
    check_role(role)
    n_states = states_of(law, n_states, settings or {})
    axes = tuple(c.split(".")[1] for c in channels if c.startswith("position."))
    groups = list(dict.fromkeys(c.split(".")[0] for c in channels))
    if groups not in (["position", "force", "velocity"], ["position", "velocity"]):
        raise ChannelError(f"channels of a skill are position.*, force.* (or none), velocity.*; got {', '.join(channels)}")
    paths = [str(p) for p in shards]
    said: list[str] = []
    if check and hasattr(read, "check"):
        looked = each(check_file, ((read, p, dt, role) for p in paths), n_jobs=n_jobs)
        read, said = checked(read, paths, counted(looked, len(paths), progress), dt, role)
    fit = fit_stream(
        shards, n_states, channels=channels, read=read, topology=topology,
        covariance_floor=covariance_floor, n_jobs=n_jobs, progress=progress, **options,
    )  # fmt: skip
    source = Source(read, tuple(channels), fit.model.n_states + 1)
    found = [part for shard in each(_occupancies, ((p, source, fit.model) for p in paths), n_jobs=n_jobs) for part in shard]
    occupancy, starts, ends, low, high = (np.concatenate(column) for column in zip(*found, strict=True))
    ordered, some = in_order(fit.model, topology), slice(None, None, max(1, len(ends) // MOST_ENDS))
    return assembled(
        fit,
        law=law,
        settings=settings or {},
        role=role,
        axes=axes,
        dt=dt,
        topology=topology,
        clock=_clock(paths, source, fit.model, np.median(occupancy, axis=0), dt, covariance_floor, n_jobs) if ordered else None,
        taught=_paths(paths, source, len(axes), dt) if ordered else NO_PATHS,
        starts=starts[some],
        ends=ends[some],
        workspace=workspace_around([low, high]),
        units={g: UNITS[g] for g in groups},
        lessons=[{"name": Path(p).name, "source": p} for p in paths],
        notes=said,
    )


def counted(results: Iterator[Checked], total: int, progress: Progress | None) -> Iterator[Checked]:
    for done, result in enumerate(results, start=1):
        yield result
        if progress is not None:
            progress("checks", done, total)


MOST_PATHS = 50  # lessons that the path is the mean of: more change it by less than a sensor's noise, and warping takes memory
MOST_ENDS = 1000  # a skill file is to be read by people: of a million lessons it keeps the ends of every thousandth


def _paths(paths: Sequence[str], source: Source, d: int, dt: float) -> tuple[tuple[TaughtPath, ...], Array]:
    """The path to each goal from MOST_PATHS lessons, as many of each of the first shards."""
    some = paths[:: max(1, len(paths) // MOST_PATHS)][:MOST_PATHS]
    each_of, lessons = -(-MOST_PATHS // len(some)), []
    for path in some:
        found = (x for piece in source.read(path) for x in piece)
        lessons += [np.asarray(x, dtype=float) for x, _ in zip(found, range(each_of), strict=False)]
    positions = [x[:, :d] for x in lessons]
    forces = [x[:, d : 2 * d] if x.shape[1] == 3 * d else np.zeros_like(x[:, :d]) for x in lessons]
    return taught_paths(positions, forces, dt)


def _pieces(path: str, source: Source, model: Hmm) -> Any:
    """Sequences of each piece with their posteriors."""
    p = Chain(model.initial, model.transition, model.means, model.covariances)
    d = len(source.channels)
    for lessons in source._replace(offset=np.zeros(d), scale=np.ones(d)).lessons(path):
        cuts = np.cumsum(lessons.lengths)[:-1]
        yield lessons, np.split(lessons.z, cuts), np.split(weights_of(p, lessons), cuts)


def _occupancies(path: str, source: Source, model: Hmm) -> list[tuple[Array, ...]]:
    """Of each piece: frames in each state (S, K), starts and ends (S, d), lowest and highest positions (1, d)."""
    d = sum(c.startswith("position.") for c in source.channels)
    return [
        (
            np.array([h.sum(axis=0) for h in weights]),
            np.array([x[0, :d] for x in frames]),
            np.array([x[-1, :d] for x in frames]),
            lessons.z[:, :d].min(axis=0, keepdims=True),
            lessons.z[:, :d].max(axis=0, keepdims=True),
        )
        for lessons, frames, weights in _pieces(path, source, model)
    ]


def _phase_moments(path: str, source: Source, model: Hmm, usual: Array, origin: Array) -> Array:
    """Moments (K, D + 2, D + 2) of (phase in frames, x) about `origin`, as in models/clock.py."""
    sums = np.zeros((model.n_states, len(origin) + 1, len(origin) + 1))
    for lessons, _, weights in _pieces(path, source, model):
        phase = np.concatenate([np.cumsum(h @ (usual / np.maximum(h.sum(axis=0), 1e-9))) for h in weights])
        sums += moments_about(origin, np.column_stack([phase, lessons.z]), np.concatenate(weights))
    return sums


def _clock(
    paths: Sequence[str], source: Source, model: Hmm, usual: Array, dt: float, covariance_floor: float, n_jobs: int
) -> Gmm:
    """Joint density of phase and the model's channels: `models.clock.learn_clock` in one pass of sums."""
    origin = np.concatenate([[0.5 * usual.sum()], model.means.mean(axis=0)])  # near the data: nothing cancels
    work = ((p, source, model, usual, origin) for p in paths)
    moments = np.zeros((model.n_states, len(origin) + 1, len(origin) + 1))
    for part in each(_phase_moments, work, n_jobs=n_jobs):
        moments += part
    occupancy = np.maximum(moments[:, -1, -1], 1e-9)
    shares, whole = moments / occupancy[:, None, None], moments.sum(axis=0) / moments[:, -1, -1].sum()
    centres = shares[:, :-1, -1]
    covariances = shares[:, :-1, :-1] - centres[:, :, None] * centres[:, None, :]
    scale = np.sqrt(np.maximum(np.diag(whole)[:-1] - whole[:-1, -1] ** 2, 1e-24))
    covariances = floored(covariances / np.outer(scale, scale), covariance_floor) * np.outer(scale, scale)
    in_seconds = np.concatenate([[dt], np.ones(len(origin) - 1)])
    return Gmm(
        occupancy / occupancy.sum(),
        (centres + origin) * in_seconds,
        covariances * np.outer(in_seconds, in_seconds),
        (PHASE, *model.channels),
    )
