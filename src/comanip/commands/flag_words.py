"""Messages of the library in the words of the command line: `drop_bad` is an argument in Python, and here it is --drop-bad."""

from __future__ import annotations

import re

# argument in a message -> what to write here. Longer spellings first: the first that matches is taken
_FLAGS = {
    "payload=Payload(mass_kg=...) or identify it from a window at rest (identify_payload)": "--load-mass-kg",
    "learn without force: position and velocity only": "--no-force learns from position and velocity only",
    "make a demonstration of each piece with split_gaps": "--split-gaps makes a demonstration of each piece",
    "drop such frames with drop_bad": "--drop-bad drops such frames",
    "recover=True reads the rest": "--recover reads the rest",
    "take it off (tare, or force_bias_n)": "take it off: --tare, --force-bias-n, or --tare-auto where that foresees better",
    "integrate_position makes one from the velocity": "--integrate-position makes one from the velocity",
    "widen the range (plausible=...)": "take it as it is with --any-size",
    "allow_constant=<standard deviation>": "--allow-constant (a standard deviation)",
    "learn with topology left-right": "learn with --topology left-right",
    'time="none" and a rate': "--time none --rate-hz (the rate)",
}
# arguments whose flag has their own name, with - for _
NAMED = (
    "allow_constant", "any_size", "cutoff_hz", "drop_bad", "force_bias_n", "force_unit", "integrate_position", "load_mass_kg",
    "load_share", "position_unit", "rate_hz", "recover", "resample_hz", "restarts", "segment_by", "sensor_force", "split_gaps",
    "tare", "tare_auto", "time_unit", "trim_rest_s", "velocity_unit",
)  # fmt: skip
OTHERWISE = {"n_states": "--states", "n_jobs": "--workers", "mass_kg": "--mass-kg", "tare_s": "--tare-s"}
# words that are arguments only where they are given something: time="none" is --time none, and the time is the time
GIVEN = ("axes", "extra", "force", "mapping", "out", "position", "role", "time", "velocity")
_NAMES = "|".join(sorted({*NAMED, *OTHERWISE}, key=len, reverse=True))
_VALUE = r"(?:=('[^']*'|\"[^\"]*\"|[^\s,;:)]+))?"
_ARGUMENT = re.compile(rf"(?<![\w.\-/'\"])({_NAMES}){_VALUE}(?![\w.(])")
_GIVEN = re.compile(rf"(?<![\w.\-/'\"])({'|'.join(GIVEN)})=(?!=)(?:'([^']*)'|\"([^\"]*)\"|([^\s,;:)]*))")
_FRAMES = re.compile(r"frames=\{.*?\} \((--frame [^)]*)\)")  # the same thing said twice, once for each


def in_flags(message: str) -> str:
    """The message with every argument of Python's replaced by the flag that does the same."""
    for spelling, flag in _FLAGS.items():
        message = message.replace(spelling, flag)
    message = _GIVEN.sub(_given, _FRAMES.sub(r"\1", message))
    return _ARGUMENT.sub(_flag, message)


def _given(found: re.Match[str]) -> str:
    value = next((part for part in found.groups()[1:] if part), "")
    return f"--{found[1]} {value}".rstrip()


def _flag(found: re.Match[str]) -> str:
    name, value = found.groups()
    flag = OTHERWISE.get(name, "--" + name.replace("_", "-"))
    return flag if value is None else f"{flag} {value.strip(chr(39) + chr(34))}"
