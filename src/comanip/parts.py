"""What can be chosen by name: one table a kind, name -> "module:object". Nowhere else is such a list.

Command line choices and help are made from these tables, and teaching, trials, `make_skill`, skill files and readers look names
up here: a new part costs its file and one line. Nothing is imported before it is asked for. The kinds of people are a table of
their own, `people.kinds.KINDS`: one line there is a whole kind. A task costs its .toml file in `tasks/` alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from .errors import ParameterError

T = TypeVar("T")


def unknown(what: str, name: object, known: Iterable[str], otherwise: str = "") -> ParameterError:
    """The error for a name that is in no table; it lists those that are. `otherwise`: what else may be given."""
    return ParameterError(f"{what} {str(name)!r} is unknown; there are: {', '.join(known)}{otherwise}")


def known(what: str, name: str, table: Mapping[str, T], otherwise: str = "") -> T:
    """The entry of `table` under `name`. ParameterError for a name that is not there, with those that are."""
    if not isinstance(name, str) or name not in table:
        raise unknown(what, name, table, otherwise)
    return table[name]


def loaded(at: str) -> Any:
    """The object at "module:object"."""
    module, _, name = at.partition(":")
    found = import_module(module)
    for part in name.split("."):
        found = getattr(found, part)
    return found


def wanted(make: Any, offered: Mapping[str, Any]) -> dict[str, Any]:
    """Those of the offered arguments that `make` names."""
    names = signature(make).parameters
    return {name: value for name, value in offered.items() if name in names}


@dataclass(frozen=True)
class Part:
    """at   "module:object" of what makes it"""

    at: str

    @property
    def object(self) -> str:
        """Its name in that module."""
        return self.at.partition(":")[2]

    def load(self) -> Any:
        """What makes it, imported now."""
        return loaded(self.at)


@dataclass(frozen=True)
class Device(Part):
    """What the teacher holds: at(teacher, *, axes, moves) -> HapticDevice; `moves` (n, d) [m] is where the handle will go.

    velocity_scale   s_v of eq. (1) with which a lift fits its workspace
    """

    velocity_scale: float = 1.3


@dataclass(frozen=True)
class Law(Part):
    """at(role, learned, dt, **settings) -> Skill without an envelope; `learned` holds skills by role, and role "auto" is told
    nothing. A maker that names `goal`, `gives_way` or `policy` is told those, too.

    states     K when nobody says another; None: no skill is learned for this law, it is only tried beside others
    settings   "module:class" of the frozen value whose fields are the law's settings; "" has none
    untold     can do without being told a role
    both       needs skills of both roles, whatever it is told
    yields     gives way to the partner, so that the envelope's speed is that of the partner, too
    """

    states: int | None = None
    settings: str = ""
    untold: bool = False
    both: bool = False
    yields: bool = False


@dataclass(frozen=True)
class Model(Part):
    """A frozen value with `channels` and arrays.

    arrays   names of the arrays that are stored in a skill file, and its arguments; () cannot be stored
    runs     the filters of laws run it
    """

    arrays: tuple[str, ...] = ()
    runs: bool = False


@dataclass(frozen=True)
class Target(Part):
    """What a skill is exported as: at(make, out) -> export.targets.Export; `suffix` of `out`, "" where it is a folder."""

    suffix: str = ""


class Format(NamedTuple):
    """One kind of file or folder.

    reads     "module:function" called as f(path, data, columns, recover) -> recordings; `data` is None unless `whole`
    writes    "module:function" called as f(recordings, path); "" for what is only read
    magic     first bytes of such files; "" in a suffix list is any file
    suffixes  extensions, for files without such bytes, and for writing
    marks     glob patterns of what lies in a folder of this format
    limit_mb  the largest file that is read
    whole     read as bytes by `read` (and unpacked, where it is packed), or opened by the reader
    several   one file or folder holds any number of recordings

    A module without a dot is one of `comanip.formats`.
    """

    name: str
    reads: str
    writes: str = ""
    magic: tuple[bytes, ...] = ()
    suffixes: tuple[str, ...] = ()
    marks: tuple[str, ...] = ()
    limit_mb: int = 256
    whole: bool = False
    several: bool = False

    def reader(self) -> Any:
        """The function that reads, imported now."""
        return _of_formats(self.reads)

    def writer(self) -> Any:
        """The function that writes, imported now."""
        return _of_formats(self.writes)


def _of_formats(at: str) -> Any:
    return loaded(at if "." in at.partition(":")[0] else f"comanip.formats.{at}")


# at(partner, *, beam, sensor, dt, start_position, rng, task) -> Plant: see `plants.makers`
PLANTS: dict[str, Part] = {
    "beam": Part("comanip.plants.makers:beam_plant"),
    "humanoid": Part("comanip.plants.makers:humanoid_plant"),
}
DEVICES: dict[str, Device] = {
    "ideal": Device("comanip.devices.makers:ideal"),
    "phantom": Device("comanip.devices.makers:phantom_device", velocity_scale=1.6),
}
# 5 states are the paper's; 10 predict better on every set that was tried (docs/results.md)
LAWS: dict[str, Law] = {
    "default": Law("comanip.reproduction:default_law", 10, "comanip.skills.collaborate:CollaborativeLaw", True, yields=True),
    "lqt": Law("comanip.reproduction:lqt_law", 10, "comanip.skills.collaborate:CollaborativeLaw", True, yields=True),
    "even": Law("comanip.reproduction:even_law", 10, "comanip.skills.collaborate:CollaborativeLaw", True, yields=True),
    "paper": Law("comanip.reproduction:paper_law", 5, "comanip.skills.paper:PaperLaw"),
    "mass-damper": Law("comanip.trials.contestants:mass_damper", untold=True),
    "damping": Law("comanip.trials.contestants:damping", untold=True),
    "variable-damping": Law("comanip.trials.contestants:variable_damping", untold=True),
    "minimum-jerk": Law("comanip.trials.contestants:minimum_jerk"),
    "without-lessons": Law("comanip.trials.contestants:without_lessons", untold=True),
    "rigid": Law("comanip.trials.contestants:rigid", untold=True),
    "homotopy": Law("comanip.trials.contestants:homotopy", untold=True),
    "active-passive": Law("comanip.trials.contestants:active_passive", untold=True, both=True),
}
MODELS: dict[str, Model] = {
    "hmm": Model("comanip.models.hmm:Hmm", ("initial", "transition", "means", "covariances"), runs=True),
    "hsmm": Model("comanip.models.hsmm:Hsmm", ("initial", "transition", "durations", "means", "covariances")),
    "gmm": Model("comanip.models.gmm:Gmm", ("weights", "means", "covariances")),
}
EXPORTS: dict[str, Target] = {
    "c": Target("comanip.export.targets:to_c", ".c"),
    "ctypes": Target("comanip.export.targets:to_ctypes", ".py"),
    "ros2-control": Target("comanip.export.targets:to_ros2_control"),
    "page": Target("comanip.page.export:write_page", ".html"),
}
# A file is read whole and takes several times its size meanwhile: the limits keep that near half a gigabyte.
FORMATS: tuple[Format, ...] = (
    Format("mcap", "mcap_file:open_mcap", "mcap_file:write_one", (b"\x89MCAP0\r\n",), (".mcap",), limit_mb=8192),
    Format("bag", "rosbag2:open_folder", marks=("metadata.yaml",)),
    Format("sqlite bag", "rosbag2:open_file", "", (b"SQLite format 3\0",), (".db3",), limit_mb=8192),
    Format("numpy", "tables:open_numpy", "", (b"\x93NUMPY",), (".npz", ".npy"), whole=True),
    Format("hdf5", "hdf5_file:open_hdf5", "hdf5_file:write_hdf5", (b"\x89HDF\r\n\x1a\n",), (".hdf5", ".h5"), several=True),
    Format("matlab", "tables:open_mat", "", (b"MATLAB ",), (".mat",), whole=True),
    Format("lerobot", "lerobot:open_folder", "lerobot:write_dataset", suffixes=(".lerobot",),
           marks=("meta/info.json", "data/**/*.parquet"), several=True),
    Format("parquet", "parquet_file:open_parquet", "parquet_file:write_parquet", (b"PAR1",), (".parquet", ".pq")),
    Format("csv folder", "topic_folder:open_folder", marks=("*.csv", "*.CSV", "*.tsv", "*.csv.gz")),
    Format("files", "tables:open_each", marks=("*.mcap", "*.db3", "*.parquet", "*.npz", "*.npy", "*.mat", "*.hdf5", "*.h5")),
    Format("csv", "tables:open_text", "tables:write_text", (), (".csv", ""), limit_mb=48, whole=True),
)  # fmt: skip


def _tasks(folder: Path, first: tuple[str, ...]) -> dict[str, Path]:
    """Name -> file, of every .toml in the folder; those in `first` in their order, before the others."""
    found = {file.stem: file for file in sorted(folder.glob("*.toml"))}
    return {name: found[name] for name in (*(n for n in first if n in found), *(n for n in found if n not in first))}


TASKS: dict[str, Path] = _tasks(
    Path(__file__).parent / "tasks",
    ("lift", "lower", "lift-hold-lower", "two-stages", "slide", "round-the-corner", "pick-carry-place", "saw", "crank",
     "two-shelves", "turn", "door"),
)  # fmt: skip


def learned_laws() -> dict[str, Law]:
    """Those that run what was learned, so that a skill can be learned for them."""
    return {name: law for name, law in LAWS.items() if law.states is not None}


def stored_models() -> dict[str, Model]:
    """Those that a skill file can hold."""
    return {name: model for name, model in MODELS.items() if model.arrays}


def written_suffixes() -> tuple[str, ...]:
    """Extensions of all formats that are written."""
    return tuple(suffix for form in FORMATS if form.writes for suffix in form.suffixes if suffix)


def holding_several() -> tuple[str, ...]:
    """Those of them of which one file or folder holds any number of recordings."""
    return tuple(suffix for form in FORMATS if form.writes and form.several for suffix in form.suffixes if suffix)


def check_settings(law: str, settings: Mapping[str, Any]) -> None:
    """ParameterError for a setting that the law does not have, or for a value that it does not take."""
    at = known("law", law, LAWS).settings
    kind = loaded(at) if at else None
    fields = list(kind.__dataclass_fields__) if kind is not None else []
    if stray := sorted(set(settings) - set(fields)):
        raise ParameterError(f"law {law!r} has no setting {stray[0]!r}; it has: {', '.join(fields) or 'none'}")
    if kind is not None:
        kind(**settings)
