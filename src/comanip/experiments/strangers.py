"""Partners of other kinds: people who are not the model that lessons and trials draw theirs from.

Trials draw impedances around a minimum-jerk equilibrium (people/partners.py), and so do lessons. A law could be good with that
model alone. Here are eight other ways to lead and six to follow, with the same draw of strength, delay, load and sensor:

    comanip trial --role follower --role leader --misbehaving 0 --partners-from experiments/strangers.py
    python -m comanip.experiments.strangers [partners]        a table, kind by kind, beside the best mass-damper

Refuted as a claim of generality by a kind with which the default law succeeds less often than nine times in ten.
"""

from __future__ import annotations

import argparse
from collections import Counter, deque
from math import pi, sin, sqrt, tanh

import numpy as np

from comanip.interfaces import Array
from comanip.trials import Case, draw_case
from comanip.trials.judging import Verdict

STEP_S = 0.001  # a person's force is asked for once a millisecond


class Stranger:
    """Somebody at the other end, with a hand that is never quite still. This one only carries; those below pull, too."""

    def __init__(self, case: Case, rng: np.random.Generator) -> None:
        self.case, self._rng, self._noise = case, rng, 0.0
        self.stiffness, self.damping = case.stiffness_n_per_m, case.damping_ns_per_m

    def reset(self, position: Array) -> None:
        self._origin, self._noise = float(position[0]), 0.0
        self.begin()

    def begin(self) -> None:
        """Forgets what was felt."""

    def pull(self, time: float, height: float, speed: float) -> float:
        """Upward force beyond the weight carried [N]; height above the start [m] and speed [m/s] of the own end, upward."""
        return 0.0

    def force(self, time: float, position: Array, velocity: Array, out: Array) -> None:
        pull = self.pull(time, float(position[0]) - self._origin, float(velocity[0]))
        self._noise += STEP_S / 0.08 * -self._noise + sqrt(2.0 * STEP_S / 0.08) * float(self._rng.standard_normal())
        out[:] = self.case.carried_n + pull + (0.03 * abs(self.case.carried_n + pull) + 0.05) * self._noise


class Late:
    """What was so long ago."""

    def __init__(self, delay_s: float) -> None:
        steps = round(delay_s / STEP_S)
        self._past = deque([(0.0, 0.0)] * steps, maxlen=steps)

    def __call__(self, height: float, speed: float) -> tuple[float, float]:
        then = self._past[0]
        self._past.append((height, speed))
        return then


# ------------------------------------------------------------------------------------------------------------- who leads


class Leads(Stranger):
    """Moves the rest of a spring-damper by a profile in time; those below differ in the profile, or in all else."""

    def profile(self, s: float) -> tuple[float, float]:
        """Way and speed at the share s of the time."""
        return s**3 * (10.0 - 15.0 * s + 6.0 * s * s), 30.0 * s * s * (1.0 - s) ** 2

    def meant(self, time: float) -> tuple[float, float]:
        x = v = 0.0
        for start, duration, far in self.case.legs:
            way, speed = self.profile(min(max((time - start) / duration, 0.0), 1.0))
            x, v = x + far * way, v + far * speed / duration
        return x, v

    def pull(self, time: float, height: float, speed: float) -> float:
        x, v = self.meant(time)
        return self.stiffness * (x - height) + self.damping * (v - speed)


class EvenSpeed(Leads):
    """One speed all the way, with short ramps."""

    def profile(self, s: float) -> tuple[float, float]:
        ramp, top = 0.15, 1.0 / 0.85
        if s < ramp:
            return top * s * s / (2.0 * ramp), top * s / ramp
        if s > 1.0 - ramp:
            return 1.0 - top * (1.0 - s) ** 2 / (2.0 * ramp), top * (1.0 - s) / ramp
        return top * (s - ramp / 2.0), top


class QuickStart(Leads):
    """Fast first, then a long approach: 1.8 times the top speed, in a third of the time."""

    def profile(self, s: float) -> tuple[float, float]:
        way, speed = super().profile(1.0 - (1.0 - s) ** 1.8)
        return way, speed * 1.8 * (1.0 - s) ** 0.8


class Corrects(Leads):
    """Falls short, sees it 0.2 s later, and corrects by sub-movements that overlap."""

    def begin(self) -> None:
        self._moves: list[tuple[float, float, float]] = []
        self._see, self._next = Late(0.2), self.case.onset_s

    def pull(self, time: float, height: float, speed: float) -> float:
        seen, _ = self._see(height, speed)
        if time >= self._next:
            meant, first = sum(far for _, _, far in self._moves), not self._moves
            missing = self.case.lift_m - (meant if first else 0.5 * (meant + seen))
            if abs(missing) > 0.008:
                far = missing * (0.9 + 0.08 * float(self._rng.standard_normal()))
                self._moves.append((time, (0.75 * self.case.duration_s if first else 0.7), far))
            self._next = time + (0.7 * self.case.duration_s if first else 0.45)
        x = v = 0.0
        for start, duration, far in self._moves:
            way, rate = self.profile(min((time - start) / duration, 1.0))
            x, v = x + far * way, v + far * rate / duration
        return self.stiffness * (x - height) + self.damping * (v - speed)


class PushesByEye(Leads):
    """No stiffness at all: pushes with up to 8 N by what was seen 0.15 s ago, through a muscle of 60 ms."""

    def begin(self) -> None:
        self._see, self._muscle = Late(0.15), 0.0

    def pull(self, time: float, height: float, speed: float) -> float:
        (x, v), (seen, seen_speed) = self.meant(time - 0.15), self._see(height, speed)
        wanted = 25.0 * (x - seen) + 12.0 * (v - seen_speed)
        self._muscle += STEP_S / 0.06 * (min(max(wanted, -8.0), 8.0) - self._muscle)
        return self._muscle - 6.0 * speed


class Stiffens(Leads):
    """Three times as stiff in motion."""

    def begin(self) -> None:
        self._tense = 1.0

    def pull(self, time: float, height: float, speed: float) -> float:
        x, v = self.meant(time)
        self._tense += STEP_S / 0.3 * ((3.0 if abs(v) > 0.02 else 1.0) - self._tense)
        return self._tense * self.stiffness * (x - height) + sqrt(self._tense) * self.damping * (v - speed)


class Reflexes(Leads):
    """Half of the stiffness at once, half 40 ms late through a muscle of 40 ms that weakens as it shortens."""

    def begin(self) -> None:
        self._feel, self._muscle = Late(0.04), 0.0

    def pull(self, time: float, height: float, speed: float) -> float:
        x, v = self.meant(time)
        off, slip = self._feel(x - height, v - speed)
        self._muscle += STEP_S / 0.04 * (0.5 * self.stiffness * off + 0.3 * self.damping * slip - self._muscle)
        pull = self._muscle + 0.5 * self.stiffness * (x - height) + 0.7 * self.damping * (v - speed)
        return pull - 0.15 * tanh(speed / 0.3) * (self.case.carried_n + pull)


class Trembles(Leads):
    """A tremor of 0.6 N at 5 Hz, as an old hand has."""

    def pull(self, time: float, height: float, speed: float) -> float:
        return super().pull(time, height, speed) + 0.6 * sin(2.0 * pi * 5.0 * time)


class Arm:
    """1.5 kg of arm on a grip of 4 kN/m."""

    def __init__(self) -> None:
        self.height = self.speed = 0.0

    def grip(self, height: float, speed: float) -> float:
        return 4000.0 * (self.height - height) + 60.0 * (self.speed - speed)

    def move(self, force: float) -> None:
        self.speed += STEP_S * force / 1.5
        self.height += STEP_S * self.speed


class HeavyArm(Leads):
    """The own arm goes along: the spring pulls on it, and it on the beam."""

    def begin(self) -> None:
        self._arm = Arm()

    def pull(self, time: float, height: float, speed: float) -> float:
        grip = self._arm.grip(height, speed)
        self._arm.move(super().pull(time, self._arm.height, self._arm.speed) - grip)
        return grip


# ----------------------------------------------------------------------------------------------------------- who follows


class Resists(Stranger):
    """A damper, and nothing else."""

    def pull(self, time: float, height: float, speed: float) -> float:
        return -0.5 * self.case.yielding_ns_per_m * speed


class Relaxes(Stranger):
    """A spring whose rest comes after the hand within 0.25 s."""

    def begin(self) -> None:
        self._rest = 0.0

    def pull(self, time: float, height: float, speed: float) -> float:
        self._rest += STEP_S / 0.25 * (height - self._rest)
        return 0.6 * self.stiffness * (self._rest - height) - 5.0 * speed


class StepsAfter(Stranger):
    """Notices three times a second the pull, and goes where the beam is."""

    def begin(self) -> None:
        self._rest = self._goal = 0.0
        self._next = 0.3

    def pull(self, time: float, height: float, speed: float) -> float:
        stiffness = min(self.stiffness, 150.0)
        if time >= self._next:
            self._next = time + 0.3
            if stiffness * abs(height - self._rest) > 1.0:
                self._goal = height + 0.15 * speed
        self._rest += STEP_S / 0.12 * (self._goal - self._rest)
        return stiffness * (self._rest - height) - 15.0 * speed


class Foresees(Stranger):
    """Sees the beam 0.15 s late and goes on as fast as it was seen to go."""

    def begin(self) -> None:
        self._see = Late(0.15)

    def pull(self, time: float, height: float, speed: float) -> float:
        seen, rate = self._see(height, speed)
        return 80.0 * (seen + 0.15 * rate - height) + 10.0 * (rate - speed)


class Sticks(Stranger):
    """3 N of friction, then a damper: more than a robot that was told nothing may ask with (1.8 N)."""

    def pull(self, time: float, height: float, speed: float) -> float:
        return -3.0 * tanh(speed / 0.01) - 10.0 * speed


class HeavyFollower(Stranger):
    """The own arm goes along, and its posture after it."""

    def begin(self) -> None:
        self._arm, self._rest = Arm(), 0.0

    def pull(self, time: float, height: float, speed: float) -> float:
        grip, arm = self._arm.grip(height, speed), self._arm
        self._rest += STEP_S / 0.3 * (arm.height - self._rest)
        arm.move(60.0 * (self._rest - arm.height) - 8.0 * arm.speed - grip)
        return grip


LEADING = (EvenSpeed, QuickStart, Corrects, PushesByEye, Stiffens, Reflexes, Trembles, HeavyArm)
FOLLOWING = (Resists, Relaxes, StepsAfter, Foresees, Sticks, HeavyFollower)


def partner(case: Case, rng: np.random.Generator) -> Stranger:
    """For `--partners-from`: the kinds take turns by the draw."""
    kinds = LEADING if case.leads else FOLLOWING
    return kinds[case.seed % len(kinds)](case, rng)


def numbers(partners: int, seed: int = 900) -> dict[tuple[str, str, str], list[Verdict]]:
    """(role of the robot, law, kind) -> one verdict a partner; every kind meets the robot with the same draws."""
    from comanip.commands.running import taught
    from comanip.trials.running import one_run

    learned = {role: taught(role, seed=0) for role in ("leader", "follower", "natural")}
    found: dict[tuple[str, str, str], list[Verdict]] = {}
    for role, laws in (("follower", ("default", "mass-damper")), ("leader", ("default", "minimum-jerk")), ("auto", ("default",))):
        rng = np.random.default_rng([seed, len(role)])
        drawn = [draw_case(role, rng) for _ in range(2 * partners)]
        for kind in (*LEADING, *FOLLOWING):
            cases = [case for case in drawn if case.leads == (kind in LEADING)][:partners]
            for law in laws if cases else ():
                runs = [one_run(case, learned, law, partner=kind)[1] for case in cases]
                found[role, law, kind.__name__] = runs
                print(line(role, law, kind.__name__, runs), flush=True)
    return found


def line(role: str, law: str, kind: str, runs: list[Verdict]) -> str:
    """One row: successes, median effort, highest |F|, reasons of failures."""
    good, why = sum(v.success for v in runs), Counter(reason for v in runs for reason in v.failures)
    effort, peak = np.median([v.effort_n2s for v in runs]), max(v.peak_force_n for v in runs)
    said = ", ".join(f"{reason} {n}" for reason, n in why.items())
    return f"{role:8} {law:12} {kind:13} {good:3} of {len(runs)}   effort {effort:5.1f} N2s   peak {peak:4.1f} N   {said}"


if __name__ == "__main__":
    about = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    about.add_argument("partners", nargs="?", type=int, default=40, help="of each kind (default: 40)")
    numbers(about.parse_args().partners)
