"""Reasons of the exported envelope, by number, beside what the Python says: one tells the number apart, the other says it."""

from __future__ import annotations

import re

from .c_file import reasons

# what the Python says begins, or is, so
SAID = {
    "none": r"",
    "not_started": r"not started",
    "policy": r"policy: .*",
    "clock": r"clock",
    "old": r"force -?[\d.einf]+ ms old",
    "late": r"late .* ms",
    "position": r"position not finite",
    "position_jump": r"position jump .* m",
    "force": r"force not finite",
    "too_strong": r"force .* N > .* N",
    "velocity": r"velocity not plausible",
    "stuck": r"force stuck",
    "too_heavy": r"the object weighs .*too heavy to carry",
    "force_jumped": r"force jumped .*",
    "not_following": r"does not follow: .*",
    "gone": r"let go: the hand carries the whole object",
    "sinks": r"let go or loaded: .*",
    "pushed": r"pushed along with .*",
    "blocked": r"blocked",
    "let_go": r"let go",
    "checker_speed": r"checker: speed",
    "checker_acceleration": r"checker: acceleration",
    "checker_room": r"checker: room to stop",
    "outside": r".* outside the workspace: .*",
    "in_motion": r"in motion: .*",
    "pulled": r"pulled with .*",
    "stuck_still": r"force stuck still: sensor\?",
}


def number_of(said: str) -> int:
    """The number of the reason that the Python gives as `said`; -1 for one that is not exported."""
    for n, (name, _) in enumerate(reasons()):
        if re.fullmatch(SAID[name], said, flags=re.DOTALL):
            return n
    return -1
