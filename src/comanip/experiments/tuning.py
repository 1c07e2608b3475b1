"""Where numbers of the laws are chosen: one setting beside the defaults, on the kinds of people for tuning and on no other.

    python -m comanip.experiments.tuning follower virtual_mass_kg=4.5 [moving_damping_ns_per_m=6 ...] [--partners 15]
    python -m comanip.experiments.tuning leader            the defaults alone

A table, kind by kind: successes, median vibration, effort and time. A number that is to become a default must help the kinds
that shake without costing the usual partners: the last row says what it does to those, without an arm and with one.

Refuted as a choice by a judging kind that it makes worse: those are run once, after it (`comanip trial --people judging`).
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from comanip.errors import ParameterError
from comanip.interfaces import Skill
from comanip.learned.skill import LearnedSkill
from comanip.parallel import each
from comanip.people.kinds import for_tuning
from comanip.trials.cases import Case
from comanip.trials.people import USUAL, Met, draw_people, meet

Settings = Mapping[str, Any]


def with_settings(role: str, learned: Mapping[str, LearnedSkill], dt: float, settings: Settings) -> Skill:
    """The default law of a role with other numbers, within the envelope."""
    from comanip.reproduction import make_skill

    one = learned[role]
    return make_skill(one, axes=one.axes, dt=dt, law="default", role=role, **settings)


def met(case: Case, learned: Mapping[str, LearnedSkill], settings: Settings) -> Met:
    """What came of one partner under these settings."""
    made = partial(with_settings, case.role, learned, 0.01, settings)
    return meet(case, learned, "default", skill=made())[1]


def numbers(
    role: str, settings: Settings, partners: int, *, seed: int = 900, people: Sequence[str] | None = None, workers: int = 1
) -> dict[str, tuple[list[Met], list[Met]]]:
    """Kind -> what came of the same partners under the defaults, and under the settings."""
    from comanip.commands.running import taught

    kinds = [USUAL, *for_tuning(people or "tuning")]
    learned = {one: taught(one, seed=0) for one in ("leader", "follower")}
    found = {}
    for kind in kinds:
        cases = draw_people(role, kind, partners, seed)
        both = [list(each(met, [(case, learned, s) for case in cases], n_jobs=workers)) for s in ({}, settings)]
        if cases:
            found[kind] = (both[0], both[1])
            print(line(kind, both[0]), "   ", line("", both[1]) if settings else "", flush=True)
    return found


def line(kind: str, runs: Sequence[Met]) -> str:
    """Successes, vibration, effort, time."""
    effort, shakes = np.median([m.verdict.effort_n2s for m in runs]), np.median([m.vibration_n for m in runs])
    took = np.median([m.time_s for m in runs])
    good = sum(m.success for m in runs)
    return f"{kind:22} {good:3} of {len(runs)}   {shakes:5.2f} N   {effort:6.2f} N2s   {took:5.2f} s"


def said(words: Sequence[str]) -> dict[str, float]:
    """Settings as they stand on the command line."""
    settings = {}
    for word in words:
        name, _, value = word.partition("=")
        try:
            settings[name] = float(value)
        except ValueError:
            raise ParameterError(f"{word!r} is no setting; write NAME=NUMBER, for example virtual_mass_kg=4.5") from None
    return settings


if __name__ == "__main__":
    about = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    about.add_argument("role", choices=("follower", "leader"))
    about.add_argument("settings", nargs="*")
    about.add_argument("--partners", type=int, default=15, help="of each kind (default: 15)")
    about.add_argument("--people", nargs="*", help="kinds for tuning (default: all of them)")
    about.add_argument("--seed", type=int, default=900)
    about.add_argument("--workers", type=int, default=1)
    given: Any = about.parse_args()
    numbers(given.role, said(given.settings), given.partners, seed=given.seed, people=given.people, workers=given.workers)
