"""The module that `--to ctypes` writes beside the C: the standard library alone."""

MODULE = '''\
"""@STEM@: a skill for a robot's own loop in Python. Made by comanip; do not edit. Needs no comanip, only a C compiler, once.

    robot = Controller()
    every @DT@ s: command = robot.step(time, position, velocity, sensor_force)    # axes @AXIS_NAMES@, SI; see @STEM@.h
    command.velocity[:], command.mode, robot.reason(command.reason); at HOLD: robot.rearm()
"""

import ctypes
import hashlib
import math
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

AXES, DT = @AXES@, @DT@
MODES = ("RUN", "COMPLY", "HOLD")
_HERE = Path(__file__).resolve().parent
_Vector = ctypes.c_double * AXES


class Observation(ctypes.Structure):
    """What is measured in one period; NaN is missing."""

    _fields_ = [("time", ctypes.c_double), ("force_time", ctypes.c_double),
                *[(name, _Vector) for name in ("position", "velocity", "sensor_force")]]


class Command(ctypes.Structure):
    """What to do until the next; see @STEM@.h."""

    _fields_ = [*[(name, _Vector) for name in ("position", "velocity", "acceleration", "force")],
                *[(name, ctypes.c_double) for name in ("tank_j", "confidence", "phase_s", "clock_rate", "blend", "reason_value")],
                *[(name, ctypes.c_int) for name in ("mode", "reason", "passes", "acts")]]


def _library():
    """The compiled @STEM@.c: beside it where that can be written, else in the temporary folder; made once for each text of it."""
    text = (_HERE / "@STEM@.c").read_bytes() + (_HERE / "@STEM@.h").read_bytes()
    name = "lib@STEM@-" + hashlib.sha256(text).hexdigest()[:12] + ".so"
    for folder in (_HERE, Path(tempfile.gettempdir())):
        if (folder / name).exists():
            return ctypes.CDLL(str(folder / name))
    compiler = next((found for cc in ("cc", "gcc", "clang") if (found := shutil.which(cc))), None)
    if compiler is None:
        raise OSError("@STEM@: no C compiler here (cc, gcc or clang) and no " + name + " beside it: compile it with "
                      "cc -std=c99 -O2 -fPIC -shared @STEM@.c -o " + name + " -lm")
    folder = _HERE if os.access(_HERE, os.W_OK) else Path(tempfile.gettempdir())
    part = folder / (name + "." + str(os.getpid()))
    subprocess.run([compiler, "-std=c99", "-O2", "-fPIC", "-shared", str(_HERE / "@STEM@.c"), "-o", str(part), "-lm"], check=True)
    os.replace(part, folder / name)
    return ctypes.CDLL(str(folder / name))


class Controller:
    """One robot: its state, and the tick."""

    def __init__(self):
        self._c = _library()
        self._c.@NAME@_reason_text.restype = ctypes.c_char_p
        self._state = (ctypes.c_double * @DOUBLES@)()
        self._seen, self._does = Observation(), Command()
        self.reset()

    def reset(self):
        """The next step is the first: at rest, both holding."""
        self._c.@NAME@_init(ctypes.byref(self._state))

    def step(self, time, position, velocity, sensor_force, force_time=math.nan):
        """The command for the next period: the same object at each call. Sequences have @AXES@ number(s), @AXIS_NAMES@."""
        seen = self._seen
        seen.time, seen.force_time = time, force_time
        seen.position[:], seen.velocity[:], seen.sensor_force[:] = position, velocity, sensor_force
        self._c.@NAME@_step(ctypes.byref(self._state), ctypes.byref(seen), ctypes.byref(self._does))
        return self._does

    def rearm(self):
        """Runs again from where the arm is; the reason why it does not, empty where it does. At rest, by the user alone."""
        return self.reason(self._c.@NAME@_rearm(ctypes.byref(self._state)))

    def reason(self, number):
        return self._c.@NAME@_reason_text(number).decode()
'''
