"""Arms in this process: franky (Cartesian velocities) and panda-py (Cartesian impedance), which drive a Franka without ROS.

The functions used are those of franky-control 2.0 and panda-python 1.1 as their type stubs state them; tried against fakes of
exactly these, NOT on an arm. Both packages are Linux on x86-64, and one is made for one system version of the arm: install it
yourself.
"""

from __future__ import annotations

import time as _time
from collections.abc import Callable
from importlib import import_module
from math import isfinite
from typing import Any

from ..errors import ParameterError
from .arm import Sensed
from .settings import Settings
from .stamps import Arrivals
from .turns import Quaternion, Vector

HELD_MS = 50  # a Cartesian velocity is held so long after it is reached; the next command comes long before


class _Franka:
    """What both say alike: a state with the pose as it is measured and the estimated force, stamped by the arm."""

    joints: tuple[str, ...] = tuple(f"joint{i}" for i in range(1, 8))

    def __init__(self, settings: Settings, now: Callable[[], float] = _time.monotonic) -> None:
        self._settings, self._now, self._arrivals = settings, now, Arrivals()
        self.problem = self.notice = ""

    def _state(self) -> Any:
        raise NotImplementedError

    def _pose(self, state: Any) -> tuple[Vector, Quaternion]:
        raise NotImplementedError

    def missing(self) -> str:
        sensed = Sensed()
        self.sense(sensed)
        return self.problem or ("" if all(map(isfinite, sensed.position)) else "the arm says no pose")

    def sense(self, out: Sensed) -> None:
        try:
            state = self._state()
            out.position, out.orientation = self._pose(state)
            sign = self._settings.sign
            x, y, z = (sign * float(f) for f in list(state.O_F_ext_hat_K)[:3])
            out.force = (x, y, z)
            made = self._arrivals.time(float(state.time.to_sec()), self._now())
            if made is not None:  # else the same state again
                out.time = out.force_time = made
            out.joints = dict(zip(self.joints, map(float, state.q), strict=False))
        except Exception as error:  # the driver's own; the stamp stands still then, and the envelope holds
            self.problem = f"the arm: {error}"

    def listener(self) -> str:
        return ""


class FrankyArm(_Franka):
    """franky: `Robot(host)`, `robot.state`, `robot.move(CartesianVelocityMotion(Twist(v), Duration(ms)), asynchronous=True)`."""

    def __init__(self, settings: Settings, now: Callable[[], float] = _time.monotonic, *, library: Any = None) -> None:
        super().__init__(settings, now)
        _takes(settings, "twist")
        self._lib = library or _library("franky", "franky-control")
        self._robot = self._lib.Robot(settings.host)

    def _state(self) -> Any:
        return self._robot.state

    def _pose(self, state: Any) -> tuple[Vector, Quaternion]:
        x, y, z = map(float, state.O_T_EE.translation)
        a, b, c, w = map(float, state.O_T_EE.quaternion)
        return (x, y, z), (w, a, b, c)

    def send(self, velocity: Vector, target: Vector, orientation: Quaternion, measured: Vector) -> None:
        twist = self._lib.Twist(list(velocity), [0.0, 0.0, 0.0])
        try:
            self._robot.move(self._lib.CartesianVelocityMotion(twist, self._lib.Duration(HELD_MS)), asynchronous=True)
        except Exception as error:
            self.problem = f"the arm: {error}"

    def close(self) -> None:
        try:
            self._robot.join_motion()
        except Exception as error:
            self.problem = f"the arm: {error}"


class PandaPyArm(_Franka):
    """panda-py: `Panda(host)`, `panda.get_state()`, `CartesianImpedance().set_control(position, orientation)`."""

    def __init__(self, settings: Settings, now: Callable[[], float] = _time.monotonic, *, library: Any = None) -> None:
        super().__init__(settings, now)
        _takes(settings, "pose")
        lib = library or _library("panda_py", "panda-python")
        self._panda = lib.Panda(settings.host)
        self._make = lib.controllers.CartesianImpedance
        self._controller: Any = None

    def _state(self) -> Any:
        return self._panda.get_state()

    def _pose(self, state: Any) -> tuple[Vector, Quaternion]:
        m = list(map(float, state.O_T_EE))  # column major
        return (m[12], m[13], m[14]), _quaternion(m)

    def send(self, velocity: Vector, target: Vector, orientation: Quaternion, measured: Vector) -> None:
        w, x, y, z = orientation
        try:
            if self._controller is None:  # only now: before, nothing is commanded
                self._controller = self._make()
                self._controller.set_control(list(target), [x, y, z, w])
                self._panda.start_controller(self._controller)
            self._controller.set_control(list(target), [x, y, z, w])
        except Exception as error:
            self.problem = f"the arm: {error}"

    def close(self) -> None:
        if self._controller is not None:
            self._panda.stop_controller()


def _takes(settings: Settings, kind: str) -> None:
    if settings.command.kind != kind:
        raise ParameterError(
            f"{settings.source}: command.kind is {settings.command.kind!r}; adapter {settings.adapter!r} takes {kind!r}"
        )


def _library(module: str, package: str) -> Any:
    try:
        lib = import_module(module)
        if module == "panda_py":
            import_module("panda_py.controllers")
    except ImportError as error:
        raise ParameterError(f"adapter needs {module} ({error}): pip install {package}, as made for your arm's version") from None
    return lib


def _quaternion(m: list[float]) -> Quaternion:
    """(w, x, y, z) of a homogeneous transform, 16 numbers by columns; the branch with the largest divisor."""
    r = [[m[4 * column + row] for column in range(3)] for row in range(3)]
    squares = [
        1.0 + r[0][0] + r[1][1] + r[2][2], 1.0 + r[0][0] - r[1][1] - r[2][2], 1.0 - r[0][0] + r[1][1] - r[2][2],
        1.0 - r[0][0] - r[1][1] + r[2][2],
    ]  # fmt: skip
    best = squares.index(max(squares))
    s = 2.0 * squares[best] ** 0.5
    wx, wy, wz = r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]
    xy, xz, yz = r[0][1] + r[1][0], r[0][2] + r[2][0], r[1][2] + r[2][1]
    rows = [(s * s / 4, wx, wy, wz), (wx, s * s / 4, xy, xz), (wy, xy, s * s / 4, yz), (wz, xz, yz, s * s / 4)]
    w, x, y, z = (one / s for one in rows[best])
    return (w, x, y, z)
