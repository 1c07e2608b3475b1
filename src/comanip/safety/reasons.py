"""Reasons of the envelope by number, as C has them, and as the Python says them: with the number that belongs to one."""

from __future__ import annotations

import re
from functools import lru_cache
from math import isnan

from ..kernels import layouts
from .limits import Limits

NAMES = layouts.BLOCKS["reasons"]
SAID = {  # what the Python says is so
    "NONE": r"",
    "NOT_STARTED": r"not started",
    "POLICY": r"policy: .*",
    "CLOCK": r"clock",
    "OLD": r"force -?[\d.einf]+ ms old",
    "LATE": r"late .* ms",
    "POSITION": r"position not finite",
    "POSITION_JUMP": r"position jump .* m",
    "FORCE": r"force not finite",
    "TOO_STRONG": r"force .* N > .* N",
    "VELOCITY": r"velocity not plausible",
    "STUCK": r"force stuck",
    "TOO_HEAVY": r"the object weighs .*too heavy to carry",
    "FORCE_JUMPED": r"force jumped .*",
    "NOT_FOLLOWING": r"does not follow: .*",
    "GONE": r"let go: the hand carries the whole object",
    "SINKS": r"let go or loaded: .*",
    "PUSHED": r"pushed along with .*",
    "BLOCKED": r"blocked",
    "LET_GO": r"let go",
    "CHECKER_SPEED": r"checker: speed",
    "CHECKER_ACCELERATION": r"checker: acceleration",
    "CHECKER_ROOM": r"checker: room to stop",
    "OUTSIDE": r".* outside the workspace: .*",
    "IN_MOTION": r"in motion: .*",
    "PULLED": r"pulled with .*",
    "STUCK_STILL": r"force stuck still: sensor\?",
}
WHOLE = {  # those without a number, as they are said
    "NONE": "", "CLOCK": "clock", "POSITION": "position not finite", "FORCE": "force not finite",
    "VELOCITY": "velocity not plausible", "STUCK": "force stuck", "GONE": "let go: the hand carries the whole object",
    "SINKS": "let go or loaded: more hangs on the hand than its share", "BLOCKED": "blocked", "LET_GO": "let go",
    "CHECKER_SPEED": "checker: speed", "CHECKER_ACCELERATION": "checker: acceleration", "CHECKER_ROOM": "checker: room to stop",
}  # fmt: skip


@lru_cache(maxsize=4096)
def number_of(said: str) -> int:
    """The number of the reason that the Python gives as `said`; -1 for one that C does not have."""
    for n, name in enumerate(NAMES):
        if re.fullmatch(SAID[name], said, flags=re.DOTALL):
            return n
    return -1


def said_of(number: int, value: float, limit_n: float, limits: Limits) -> str:
    """What the Python says for a reason of C, its `value` and the force that was allowed [N]."""
    name = NAMES[number]
    if name in WHOLE:
        return WHOLE[name]
    texts = {
        "OLD": f"force {value:.0f} ms old",
        "LATE": f"late {value:.0f} ms",
        "POSITION_JUMP": f"position jump {value:.2g} m",
        "TOO_STRONG": f"force {value:.0f} N > {limit_n:g} N",
        "TOO_HEAVY": f"the object weighs {value:.0f} N on this hand > {limits.load_n:g} N: too heavy to carry",
        "FORCE_JUMPED": f"force jumped {value:.1f} N at rest: sensor? tare, then re-arm",
        "NOT_FOLLOWING": f"does not follow: {value:.2g} m off",
        "PUSHED": f"pushed along with {value:.0f} N: sensor, or a weight on it?",
    }
    return texts[name]


def same(number: int, value: float, other_number: int, other_value: float) -> bool:
    """Whether two are one reason, with one number or none."""
    return number == other_number and (value == other_value or (isnan(value) and isnan(other_value)))
