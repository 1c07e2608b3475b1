"""Flags that several commands share, as values."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from ..parts import learned_laws

_Columns = Annotated[str | None, Parameter()]
if TYPE_CHECKING:
    LearnedLaw = str
else:
    LearnedLaw = Literal[tuple(learned_laws())]


@dataclass(frozen=True)
class DataFlags:
    """How files are read and prepared."""

    position: Annotated[str | None, Parameter(help="Column(s) of the hand's position, e.g. z or x,y,z; see docs/data.md.")] = None
    velocity: Annotated[str | None, Parameter(help="Column(s) of its velocity; derived from position when not given.")] = None
    force: Annotated[str | None, Parameter(help="Column(s) of the interaction force F: partner on hand, up positive.")] = None
    sensor_force: Annotated[str | None, Parameter(help="Column(s) of the raw F_s (object on hand); eq. (3) is applied.")] = None
    time: Annotated[
        str | None, Parameter(help="Column of time stamps; found by itself when called t or time; 'none' ignores it.")
    ] = None
    rate_hz: Annotated[float | None, Parameter(help="Rate of frames without stamps; with stamps, the rate to resample to.")] = (
        None
    )
    resample_hz: Annotated[float | None, Parameter(help="Rate to work at, when it is not the recordings' own.")] = None
    role: Annotated[
        Literal["leader", "follower", "natural"] | None,
        Parameter(help="What the robot did in recordings that do not say it; natural: nobody was told a role."),
    ] = None
    axes: Annotated[str | None, Parameter(help="Names of the axes, e.g. z or x,y,z.")] = None
    segment_by: Annotated[
        str | None,
        Parameter(help="Column(s) of labels at whose changes a file is cut into recordings, e.g. trial or task=1,target."),
    ] = None
    extra: Annotated[list[str] | None, Parameter(help="Another channel: name=column,column; may be repeated.")] = None
    position_unit: Annotated[str | None, Parameter(help="Unit in the file when it is not m: mm, cm, deg ...")] = None
    velocity_unit: Annotated[str | None, Parameter(help="Unit in the file when it is not m/s.")] = None
    force_unit: Annotated[str | None, Parameter(help="Unit in the file when it is not N: gf, kgf, mN ...")] = None
    time_unit: Annotated[str | None, Parameter(help="Unit in the file when it is not s: ms, us, ns.")] = None
    frame: Annotated[
        list[str] | None,
        Parameter(help="How a bag's frame lies in the position's: NAME=same, NAME=hand or NAME=w,x,y,z; may be repeated."),
    ] = None
    mapping: Annotated[Path | None, Parameter(help="A TOML file with any of these names of columns; flags go before it.")] = None
    load_mass_kg: Annotated[float | None, Parameter(help="Mass of the object, for eq. (3) on --sensor-force.")] = None
    load_share: Annotated[float, Parameter(help="Share of it that this hand carries.")] = 0.5
    cutoff_hz: Annotated[float, Parameter(help="Zero-phase low-pass for derivatives and eq. (3).")] = 10.0
    trim_rest_s: Annotated[float | None, Parameter(help="Keep at most this much rest at start and end.")] = None
    drop_bad: Annotated[bool, Parameter(negative="", help="Drop frames that are not finite instead of refusing the file.")] = (
        False
    )
    integrate_position: Annotated[
        bool, Parameter(negative="", help="Make up a missing position from the velocity, from 0 on.")
    ] = False
    any_size: Annotated[
        bool, Parameter(negative="", help="Take sizes and speeds as they are, also those that look like another unit.")
    ] = False
    force_bias_n: Annotated[
        str | None, Parameter(help="What the force sensor reads when nothing touches it [N], one number an axis: 4.0 or 0,0,4.0.")
    ] = None
    tare: Annotated[
        bool,
        Parameter(negative="", help="Take the mean force of the rest at the start off each recording."),
    ] = False
    tare_auto: Annotated[
        bool, Parameter(negative="", help="Do that where lessons left out are foreseen better by it, and say so.")
    ] = False
    split_gaps: Annotated[bool, Parameter(negative="", help="Cut a recording at gaps instead of refusing it.")] = False
    recover: Annotated[bool, Parameter(negative="", help="Read what a damaged .mcap still holds.")] = False


@dataclass(frozen=True)
class LearnFlags:
    """How a skill is learned."""

    states: Annotated[str, Parameter(help="Number of states K; 'auto' chooses by lessons left out; default 10 (paper: 5).")] = ""
    law: Annotated[LearnedLaw, Parameter(help="The law that will run the skill.")] = "default"
    topology: Annotated[Literal["left-right", "cyclic", "free"], Parameter(help="Which transitions exist.")] = "left-right"
    restarts: Annotated[int, Parameter(help="Attempts from different first guesses; the most likely model wins.")] = 1
    seed: Annotated[int, Parameter(help="Of the random first guesses.")] = 0
    stream: Annotated[
        bool,
        Parameter(negative="", help="Read the files again in every pass instead of keeping them in memory; Parquet always is."),
    ] = False
    checkpoint: Annotated[Path | None, Parameter(help="With --stream: keep progress here, and go on from it if it exists.")] = (
        None
    )
    stepwise: Annotated[int, Parameter(help="With --stream: passes of stepwise EM first; saves passes over very large data.")] = 0
    workers: Annotated[int, Parameter(help="With --stream: processes; 0 is one a core.")] = 0
    allow_constant: Annotated[
        float | None,
        Parameter(help="Keep channels that never change, with this standard deviation in their own unit; they are refused else."),
    ] = None
    no_force: Annotated[bool, Parameter(negative="", help="Position and velocity only.")] = False


@dataclass(frozen=True)
class BackendFlags:
    """Where independent work runs."""

    backend: Annotated[
        Literal["processes", "dask"], Parameter(help="Where many runs or fits are shared out: here, or on a Dask cluster.")
    ] = "processes"
    address: Annotated[str | None, Parameter(help="The Dask scheduler's, e.g. tcp://10.0.0.5:8786.")] = None
