"""A robot as a value: a model file (MJCF or URDF) and a small TOML file that says what the model cannot.

    name = "..."                     arm = [joints that move the hand]       posture_deg = {joint = degrees}
    model = "file"                   hand = "body beyond the force sensor"   [[servo]] joints, stiffness, damping, torque, speed
    package = "python_package"       sensor, grasp = "site"                  [[site]] name, body, position, xyaxes
    geometry = false                 grasp_m = [x, y, z]                     [[sole]] body, position, half_size

`model` is read next to the TOML file, or inside the installed `package`. Sites and soles are added to a model that lacks them;
with `geometry = false` the model's shapes are left out (meshes that no simulator can open). See docs/physics.md.
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass, field
from importlib.util import find_spec
from math import inf, isfinite
from pathlib import Path
from typing import Any

from ...errors import ParameterError

HERE = Path(__file__).parent
BUILT_IN = {"hrp2-class": HERE / "hrp2_class.toml", "jvrc1": HERE / "jvrc1.toml"}


@dataclass(frozen=True)
class Servo:
    """What drives the joints whose names match `joints` (a regular expression, whole name)."""

    joints: str
    stiffness: float  # [N m/rad]
    damping: float  # [N m s/rad]
    torque: float  # limit [N m]
    speed: float  # limit [rad/s]
    armature: float | None = None  # rotor inertia at the joint [kg m^2]; None: as in the model

    def __post_init__(self) -> None:
        for name in ("stiffness", "damping", "torque", "speed"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < inf:
                raise ParameterError(f"servo {self.joints!r}: {name} must be positive; got {value!r}")
        try:
            re.compile(self.joints)
        except (re.error, TypeError) as problem:
            raise ParameterError(
                f"servo: joints is a regular expression that fits names of joints, {self.joints!r} is none ({problem})"
            ) from None


@dataclass(frozen=True)
class Site:
    """A frame fixed to a body of the robot. `xyaxes`: its x and y axes in the body's frame."""

    name: str
    body: str
    position: tuple[float, ...] = (0.0, 0.0, 0.0)  # [m]
    xyaxes: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


@dataclass(frozen=True)
class Sole:
    """A box under a foot that touches the floor."""

    body: str
    position: tuple[float, ...]  # [m]
    half_size: tuple[float, ...]  # [m]


@dataclass(frozen=True)
class Robot:
    """See the module. Names are checked against the model when a plant is built."""

    name: str
    model: Path
    arm: tuple[str, ...]
    hand: str
    sensor: str
    grasp: str
    grasp_m: tuple[float, ...]
    servos: tuple[Servo, ...]
    posture_deg: dict[str, float] = field(default_factory=dict)
    sites: tuple[Site, ...] = ()
    soles: tuple[Sole, ...] = ()
    geometry: bool = True
    packaged: bool = False  # its model comes with an installed package

    def __post_init__(self) -> None:
        """What a table may hold that is of another kind, found before anything is built."""
        for what, values in (("grasp_m", self.grasp_m), *((f"posture_deg of {j}", (v,)) for j, v in self.posture_deg.items())):
            if not all(isinstance(v, int | float) and isfinite(v) for v in values):
                raise ParameterError(f"robot {self.name!r}: {what} must be finite numbers; got {values}")
        if len(self.grasp_m) != 3:
            raise ParameterError(f"robot {self.name!r}: grasp_m must be x, y, z; got {self.grasp_m}")
        for name in (*self.arm, self.hand, self.sensor, self.grasp):
            if not isinstance(name, str):
                raise ParameterError(f"robot {self.name!r}: joints, bodies and sites are names; got {name!r}")
        places: tuple[Site | Sole, ...] = (*self.sites, *self.soles)
        for place in places:
            for key, values in vars(place).items():
                wanted = 6 if key == "xyaxes" else 3
                if isinstance(values, tuple) and not (
                    len(values) == wanted and all(isinstance(v, int | float) and isfinite(v) for v in values)
                ):
                    raise ParameterError(f"robot {self.name!r}: {key} on {place.body!r} must be {wanted} numbers; got {values}")

    def servo_of(self, joint: str) -> Servo:
        for servo in self.servos:
            if re.fullmatch(servo.joints, joint):
                return servo
        patterns = ", ".join(servo.joints for servo in self.servos)
        raise ParameterError(f"robot {self.name!r}: no servo for joint {joint!r}; patterns are: {patterns}; add a [[servo]]")


def load_robot(robot: str | Path | Robot = "hrp2-class") -> Robot:
    """The robot of that name, of that TOML file, or the given one unchanged."""
    if isinstance(robot, Robot):
        return robot
    path = BUILT_IN.get(str(robot), Path(robot))
    if not path.is_file():
        raise ParameterError(f"robot {str(robot)!r} is unknown; there are: {', '.join(BUILT_IN)}, or the path of a TOML file")
    try:
        return _robot(path, tomllib.loads(path.read_text(encoding="utf-8")))
    except ParameterError as problem:
        raise ParameterError(f"{path.name}: {str(problem).removeprefix(path.name + ': ')}") from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as problem:  # ValueError: not TOML, not UTF-8
        raise ParameterError(f"{path.name} does not describe a robot: {problem}; compare {BUILT_IN['hrp2-class'].name}") from None


def _robot(path: Path, about: dict[str, Any]) -> Robot:
    folder, packaged = path.parent, "package" in about
    if package := about.pop("package", ""):
        try:
            spec = find_spec(package)
        except (ImportError, ValueError, AttributeError):  # a name that no package can have
            spec = None
        if spec is None or spec.origin is None:
            remedy = f"pip install {package.replace('_', '-')}"
            raise ParameterError(
                f"{path.name}: its model comes with the package {package!r}, which is not installed; try: {remedy}"
            )
        folder = Path(spec.origin).parent
    model = folder / about.pop("model")
    if not model.is_file():
        raise ParameterError(f"{path.name}: model file {model.name!r} is not there")
    return Robot(
        model=model,
        packaged=packaged,
        arm=tuple(about.pop("arm")),
        grasp_m=tuple(about.pop("grasp_m")),
        servos=tuple(Servo(**each) for each in about.pop("servo")),
        sites=tuple(Site(**_tuples(each)) for each in about.pop("site", ())),
        soles=tuple(Sole(**_tuples(each)) for each in about.pop("sole", ())),
        **about,
    )


def _tuples(table: dict[str, Any]) -> dict[str, Any]:
    return {name: tuple(value) if isinstance(value, list) else value for name, value in table.items()}
