"""Pre-flight, then the loop, and whatever happens the hand is braked and the take is kept."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from ..interaction import Payload
from ..interfaces import Plant, Tap
from ..learned.skill import LearnedSkill
from ..loop import run
from ..recording import Recording
from ..reproduction import make_auto, make_skill
from ..safety.envelope import Envelope
from . import preflight
from .guard import Guarded, Shadow, limits_of
from .preflight import Check
from .robot import Robot


def guarded(
    robot: Robot,
    learned: Mapping[str, LearnedSkill],
    role: str,
    *,
    law: str | None = None,
    share: float = 1.0,
    shadow: bool = False,
    goal: Any = None,
) -> Guarded:
    """The skill of this role, or of both for "auto", in its envelope, with the limits of this arm."""
    skills, dt, axes = list(learned.values()), robot.plant.dt, tuple(robot.plant.axes)
    one = learned.get(role) or skills[0]
    yields = (law or one.law) == "default"
    _same_axes(robot, skills)
    limits = limits_of(robot.settings, axes, skills, share=share, yields=yields, shadow=shadow)
    if role == "auto":
        skill = make_auto(learned, axes=axes, dt=dt, law=law, envelope=limits, goal=goal)
    else:
        skill = make_skill(one, axes=axes, dt=dt, law=law, role=role, envelope=limits, goal=goal)
    assert isinstance(skill, Envelope)
    return Guarded(skill, dt=dt, a_max_m_per_s2=limits.a_max_m_per_s2)


def _same_axes(robot: Robot, skills: Sequence[LearnedSkill]) -> None:
    from ..learned.skill import check_fits

    for one in skills:
        check_fits(one, axes=tuple(robot.plant.axes), dt=robot.plant.dt)


def fly(
    robot: Robot,
    guard: Guarded,
    learned: Mapping[str, LearnedSkill],
    *,
    seconds: float,
    realtime: bool = False,
    commands: bool = True,
) -> tuple[list[Check], Payload, float]:
    """The pre-flight: every check, what the object weighs, and how often the force comes [Hz]."""
    found = preflight.measured(robot.at_rest, seconds, robot.clock(realtime))
    lines, payload = preflight.checks(
        found,
        settings=robot.settings,
        axes=robot.plant.axes,
        gravity=robot.gravity,
        dt=robot.plant.dt,
        limits=guard.envelope.limits,
        learned=list(learned.values()),
    )
    if commands:
        deaf = robot.listener()
        lines.append(Check("commands", not deaf, deaf or "somebody listens, or nobody can know"))
    heard = found.rates.get("wrench", (float("inf"), 0.0))[0]
    return lines, payload, heard


def drive(
    robot: Robot,
    guard: Guarded,
    payload: Payload,
    *,
    duration_s: float,
    wrench_hz: float = float("inf"),
    realtime: bool = False,
    shadow: bool = False,
    taps: Sequence[Tap] = (),
    metadata: Mapping[str, Any] | None = None,
) -> Recording:
    """One run. Control-C brakes to rest first; a second one ends at once, and the plant is halted still."""
    plant: Plant = Shadow(robot.plant) if shadow else robot.plant
    estimator = preflight.estimator(
        payload, settings=robot.settings, gravity=robot.gravity, dt=plant.dt, delay_s=robot.delay_s, wrench_hz=wrench_hz
    )
    about = {"robot": robot.settings.name, "load_mass_kg": payload.mass_kg, "force_bias_n": list(payload.force_bias_n)}
    with interrupts(guard.ask_stop):
        return run(
            plant,
            guard,
            duration_s=duration_s,
            estimator=estimator,
            clock=robot.clock(realtime),
            taps=taps,
            metadata={**about, "shadow": shadow, **(metadata or {})},
        )


@contextmanager
def interrupts(ask: Callable[[], None]) -> Iterator[None]:
    """The first Control-C asks; the second is one."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    asked = False

    def heard(number: int, frame: Any) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True
        ask()

    before = signal.signal(signal.SIGINT, heard)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
