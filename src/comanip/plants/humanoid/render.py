"""Pictures and films of runs: the robot as recorded, its partner at the other end, on request the teacher at the haptic device.

    render.film(recording, "lift.gif")            .gif needs nothing more; .mp4 needs imageio with ffmpeg
    render.picture(recording, at_s=1.8, teacher=True)

Needs OpenGL. Without a display it draws off screen with OSMesa or EGL (`apt-get install libosmesa6`); MUJOCO_GL chooses.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import ParameterError
from ...interfaces import Array
from ...recording import Recording
from .people import CLAY, SEA, Shape, desk, draw, person
from .robot import Robot, load_robot
from .scene import build
from .simulator import mujoco

Image = NDArray[np.uint8]  # (H, W, 3)

FIELD_OF_VIEW_DEG = 24.0
WITH_TEACHER = {"distance": 5.4, "look_at": (0.38, 0.0, 0.80)}  # the camera steps back
PARTNER_STANDS_M = 0.40  # behind the far handle
TEACHER_AT = np.array([-1.12, 0.32])  # [m]
DESK_AT = np.array([-0.62, 0.32, 0.80])
STYLUS_AT = np.array([-0.68, 0.24, 1.00])  # while the hand is at its start; it moves with the hand, scaled down
TEACHING_SCALE = 1.3


class View:
    """A place to draw one robot from. Use as a context manager; it holds OpenGL memory.

    size     (width, height) [px]
    azimuth, elevation [deg], distance [m] and look_at (3,) [m] of the camera
    """

    def __init__(
        self,
        robot: str | Path | Robot = "hrp2-class",
        *,
        size: tuple[int, int] = (960, 540),
        length_m: float = 0.8,
        azimuth: float = 101.0,
        elevation: float = -8.0,
        distance: float = 4.9,
        look_at: tuple[float, float, float] = (0.72, -0.05, 0.82),
    ) -> None:
        self._mj = mj = mujoco()
        self.robot = load_robot(robot)
        self.scene = build(self.robot, load_mass_kg=2.0, length_m=length_m)
        picture = self.scene.model.vis.global_
        picture.offwidth, picture.offheight = size
        picture.fovy = FIELD_OF_VIEW_DEG
        self.scene.model.vis.quality.shadowsize = 4 * max(size)  # [px]; more is slower and looks the same
        self._data = mj.MjData(self.scene.model)
        self._gl, self._context = _off_screen(self.scene.model, size)
        self._drawing = mj.MjvScene(self.scene.model, maxgeom=2000)
        self._drawing.flags[mj.mjtRndFlag.mjRND_HAZE] = True
        self._camera = mj.MjvCamera()
        self._camera.azimuth, self._camera.elevation, self._camera.distance = azimuth, elevation, distance
        self._camera.lookat[:] = look_at
        self._options = mj.MjvOption()
        self._options.sitegroup[:] = 0
        self._frame = mj.MjrRect(0, 0, *size)
        self._image = np.zeros((size[1], size[0], 3), dtype=np.uint8)
        self._start: Array | None = None

    def __enter__(self) -> View:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        self._context.free()
        self._gl.free()

    def frame(self, joints: Array, base: Array, *, partner: bool = True, teacher: bool = False) -> Image:
        """The robot at `joints` (J,) [rad] and `base` (7,) position and quaternion, with people around it."""
        mj, scene, data = self._mj, self.scene, self._data
        data.qpos[scene.position_at] = joints
        if scene.free_base:
            data.qpos[:7] = base
        mj.mj_kinematics(scene.model, data)
        mj.mj_camlight(scene.model, data)
        category = mj.mjtCatBit.mjCAT_ALL
        mj.mjv_updateScene(scene.model, data, self._options, None, self._camera, category, self._drawing)
        draw(mj, self._drawing, self._people(partner, teacher))
        mj.mjr_render(self._frame, self._drawing, self._context)
        mj.mjr_readPixels(self._image, None, self._frame, self._context)
        return self._image[::-1].copy()

    def _people(self, partner: bool, teacher: bool) -> list[Shape]:
        data, shapes = self._data, []
        hand, far = data.site_xpos[self.scene.grasp_site], data.xpos[self.scene.far_body]
        if self._start is None:
            self._start = hand.copy()
        if partner:
            grips = far + np.array([[0.01, 0.040, 0.0], [0.01, -0.040, 0.0]])
            stands = np.array([self._start[0] + np.linalg.norm(far - hand) + PARTNER_STANDS_M, self._start[1]])
            shapes += person(grips, at=stands, facing=-1.0, shirt=CLAY)
        if teacher:
            stylus = STYLUS_AT + (hand - self._start) / TEACHING_SCALE
            rest = DESK_AT + np.array([-0.16, 0.22, 0.045])
            shapes += desk(DESK_AT, stylus)
            shapes += person(np.array([stylus + np.array([-0.05, 0.0, 0.07]), rest]), at=TEACHER_AT, facing=1.0, shirt=SEA)
        return shapes


def picture(recording: Recording, *, at_s: float, teacher: bool = False, **view: Any) -> Image:
    """(H, W, 3) the moment `at_s` after the start of a run on the humanoid. `view`: see `View`."""
    joints, base = _poses(recording, np.array([0.0, at_s]))
    with _view_of(recording, teacher, view) as stage:
        stage.frame(joints[0], base[0], teacher=teacher)  # the start says where people stand
        return stage.frame(joints[1], base[1], teacher=teacher)


def frames(recording: Recording, *, rate_hz: float = 25.0, teacher: bool = False, **view: Any) -> Iterator[Image]:
    """(H, W, 3) at `rate_hz`, from the start to the end of a run on the humanoid."""
    times = np.arange(0.0, recording.duration_s, 1.0 / rate_hz)
    joints, base = _poses(recording, times)
    with _view_of(recording, teacher, view) as stage:
        for q, b in zip(joints, base, strict=True):
            yield stage.frame(q, b, teacher=teacher)


def film(recording: Recording, path: str | Path, *, rate_hz: float = 25.0, **settings: Any) -> Path:
    """Writes the run as .gif (pillow) or .mp4 (imageio with ffmpeg) and returns the path. `settings`: see `frames`."""
    path = Path(path)
    if path.suffix == ".gif":
        _write_gif(path, frames(recording, rate_hz=rate_hz, **settings), rate_hz)
    elif path.suffix == ".mp4":
        _write_mp4(path, frames(recording, rate_hz=rate_hz, **settings), rate_hz)
    else:
        raise ParameterError(f"a film cannot be written as {path.suffix or 'a file without a suffix'}; try .gif or .mp4")
    return path


def save(image: Image, path: str | Path) -> Path:
    """Writes a picture as .png or .jpg."""
    _pillow().fromarray(image).save(path, optimize=True)
    return Path(path)


def _poses(recording: Recording, times: Array) -> tuple[Array, Array]:
    """Joints (T, J) and base (T, 7) at `times` since the start, from the nearest tick."""
    joints, base = recording["robot.joints"], recording["robot.base"]
    rows = np.searchsorted(joints.time - joints.time[0], times).clip(0, len(joints.time) - 1)
    return joints.values[rows], base.values[rows]


def _view_of(recording: Recording, teacher: bool, view: dict[str, Any]) -> View:
    view = {**(WITH_TEACHER if teacher else {}), **view}
    robot = load_robot(view.pop("robot", "hrp2-class"))
    known = set(recording["robot.joints"].axes)
    if missing := [joint for joint in robot.arm if joint not in known]:
        raise ParameterError(f"the recording is not of {robot.name!r}: it has no joint {missing[0]!r}; pass robot=...")
    return View(robot, **view)


def _pillow() -> Any:
    try:
        return import_module("PIL.Image")
    except ImportError:
        raise ParameterError("pictures need pillow; try: pip install comanip[humanoid]") from None


def _write_gif(path: Path, images: Iterator[Image], rate_hz: float) -> None:
    pillow = _pillow()
    pictures = map(pillow.fromarray, images)
    first = next(pictures).quantize(256, dither=pillow.Dither.NONE)
    others = [picture.quantize(palette=first, dither=pillow.Dither.NONE) for picture in pictures]  # what is still stays still
    first.save(path, save_all=True, append_images=others, duration=round(1000.0 / rate_hz), loop=0)


def _write_mp4(path: Path, images: Iterator[Image], rate_hz: float) -> None:
    try:
        imageio = import_module("imageio.v2")
        writer = imageio.get_writer(path, fps=rate_hz, macro_block_size=2)
    except (ImportError, ValueError) as problem:
        remedy = "pip install imageio imageio-ffmpeg, or write a .gif"
        raise ParameterError(f"{path.name}: an .mp4 needs imageio with ffmpeg ({problem}); try: {remedy}") from None
    with writer:
        for image in images:
            writer.append_data(image)


def _off_screen(model: Any, size: tuple[int, int]) -> tuple[Any, Any]:
    """An OpenGL context and the simulator's rendering context in it, from the first backend that works."""
    mj, problems = mujoco(), []
    for name in _backends():
        try:
            gl = import_module(f"mujoco.{name}").GLContext(*size)
            gl.make_current()
            context = mj.MjrContext(model, mj.mjtFontScale.mjFONTSCALE_100.value)
            mj.mjr_setBuffer(mj.mjtFramebuffer.mjFB_OFFSCREEN.value, context)
            return gl, context
        except Exception as problem:  # each backend fails in its own way
            problems.append(f"{name}: {type(problem).__name__}")
    raise ParameterError(
        f"no OpenGL to draw with ({', '.join(problems)}); try: apt-get install libosmesa6, then MUJOCO_GL=osmesa"
    )


def _backends() -> tuple[str, ...]:
    if chosen := os.environ.get("MUJOCO_GL", "").lower():
        return (chosen,)
    if not sys.platform.startswith("linux") or os.environ.get("DISPLAY"):
        return ("glfw", "egl", "osmesa")
    return ("osmesa", "egl")
