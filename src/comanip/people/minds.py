"""How people move the hand: what the muscles pull with, beyond the weight, given where the hand is. Joined to a body.

All in d axes; positions are displacements from where the person took hold. Those who lead have a course; those who follow have
none. Sources stand in the table of `kinds`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from math import sqrt, tanh

import numpy as np

from ..errors import check_generator
from .body import Body
from .intent import Course, Intent, Yielding

Floats = Sequence[float]


class Mind:
    """Carries, and no more. `course` is None for somebody who follows; `step_s` [s] lies between two calls of `pull`."""

    wants_tilt = False  # one who does has `see(tilt, rate)`, (d,) [rad], [rad/s], called before each `pull`

    def __init__(self, body: Body, course: Course | None, n_axes: int, step_s: float, rng: np.random.Generator) -> None:
        check_generator(rng)
        self.body, self.d, self.step_s, self.rng = body, n_axes, step_s, rng
        self._still = (0.0,) * n_axes
        self.course = course
        self._along = [] if course is None else [course.along(i) for i in range(n_axes)]
        self.draw()

    def draw(self) -> None:
        """What this person is like, once and for all."""

    def begin(self) -> None:
        """Forgets what was felt."""

    def meant(self, time: float) -> tuple[Floats, Floats, Floats]:
        if self.course is None:
            return self._still, self._still, self._still
        if self.d == 1:
            x, v, a = self._along[0].at(time)
            return (x,), (v,), (a,)
        return tuple(zip(*[one.at(time) for one in self._along], strict=True))  # type: ignore[return-value]

    def pull(self, time: float, x: Floats, v: Floats, felt: Floats) -> Floats:
        """(d,) [N] of hand displacement x [m], velocity v [m/s] and the force felt so far, beyond the weight."""
        return self._still


class Late:
    """What was some time ago: vectors in, vectors out."""

    def __init__(self, delay_s: float, step_s: float, first: tuple[Floats, ...]) -> None:
        n = max(1, round(delay_s / step_s))
        self._past: deque[tuple[Floats, ...]] = deque([first] * n, maxlen=n)

    def __call__(self, *now: Floats) -> tuple[Floats, ...]:
        then = self._past[0]
        self._past.append(now)
        return then


# ------------------------------------------------------------------------------------------------------------- who leads


class Impedance(Mind):
    """Spring and damper about a hand that is meant to move along the course, the own arm and the load's share foreseen."""

    def pull(self, time: float, x: Floats, v: Floats, felt: Floats) -> Floats:
        body, (xe, ve, ae) = self.body, self.meant(time)
        k, b, m = body.stiffness_n_per_m, body.damping_ns_per_m, body.arm_kg + body.load_kg
        if self.d == 1:
            return (k * (xe[0] - x[0]) + b * (ve[0] - v[0]) + m * ae[0],)
        return [k * (xe[i] - x[i]) + b * (ve[i] - v[i]) + m * ae[i] for i in range(self.d)]


class Shares(Mind):
    """Has a plan (or none) and gives way to what it feels beyond it, as `humans.Intent` has it."""

    def begin(self) -> None:
        body = self.body
        y = Yielding(damping_ns_per_m=body.yielding_ns_per_m, delay_s=body.delay_s)
        self._intents = [Intent(None, y, self.step_s) for _ in range(self.d)]

    def pull(self, time: float, x: Floats, v: Floats, felt: Floats) -> Floats:
        body, (xe, ve, ae), out = self.body, self.meant(time), []
        for i, intent in enumerate(self._intents):
            intent.feel(body.load_kg * ae[i] - felt[i], v[i] - ve[i])
            gone, going, _ = intent.step(time)
            off, slip = xe[i] + gone - x[i], ve[i] + going - v[i]
            out.append(body.stiffness_n_per_m * off + body.damping_ns_per_m * slip + (body.load_kg + body.arm_kg) * ae[i])
        return out


class Stiffens(Mind):
    """Three times as stiff while it moves."""

    def begin(self) -> None:
        self._tense = 1.0

    def pull(self, time: float, x: Floats, v: Floats, felt: Floats) -> Floats:
        body, (xe, ve, ae) = self.body, self.meant(time)
        moves = max(map(abs, ve)) > 0.02
        self._tense += self.step_s / 0.3 * ((3.0 if moves else 1.0) - self._tense)
        k, b = self._tense * body.stiffness_n_per_m, sqrt(self._tense) * body.damping_ns_per_m
        return [k * (xe[i] - x[i]) + b * (ve[i] - v[i]) + body.arm_kg * ae[i] for i in range(self.d)]


class Reflexes(Mind):
    """Half of the stiffness at once, half 40 ms late through a muscle of 40 ms that weakens as it shortens."""

    def begin(self) -> None:
        self._feel, self._muscle = Late(0.04, self.step_s, (self._still, self._still)), [0.0] * self.d

    def pull(self, time: float, x: Floats, v: Floats, felt: Floats) -> Floats:
        body, (xe, ve, ae), out = self.body, self.meant(time), []
        k, b = body.stiffness_n_per_m, body.damping_ns_per_m
        off, slip = [p - q for p, q in zip(xe, x, strict=True)], [p - q for p, q in zip(ve, v, strict=True)]
        was_off, was_slip = self._feel(off, slip)
        for i in range(self.d):
            self._muscle[i] += self.step_s / 0.04 * (0.5 * k * was_off[i] + 0.3 * b * was_slip[i] - self._muscle[i])
            pull = self._muscle[i] + 0.5 * k * off[i] + 0.7 * b * slip[i] + body.arm_kg * ae[i]
            out.append(pull - 0.15 * tanh(v[i] / 0.3) * (body.carried_n[i] + pull))
        return out


class PushesByEye(Mind):
    """No stiffness at all: pushes with up to 8 N by what it saw a reaction ago, through a muscle of 60 ms."""

    most_n = 8.0

    def begin(self) -> None:
        self._see, self._muscle = Late(self.body.reaction_s, self.step_s, (self._still, self._still)), [0.0] * self.d

    def pull(self, time: float, x: Floats, v: Floats, felt: Floats) -> Floats:
        xe, ve, _ = self.meant(time - self.body.reaction_s)
        seen, rate = self._see(list(x), list(v))
        wanted = [25.0 * (xe[i] - seen[i]) + 12.0 * (ve[i] - rate[i]) for i in range(self.d)]
        share = min(1.0, self.most_n / max(sqrt(sum(w * w for w in wanted)), 1e-9))
        for i, w in enumerate(wanted):
            self._muscle[i] += self.step_s / 0.06 * (share * w - self._muscle[i])
        return [f - 6.0 * one for f, one in zip(self._muscle, v, strict=True)]


class PushesByWeber(Mind):
    """Pushes for a speed, without stiffness; a push is changed only where the wanted one differs noticeably, by a tenth.

    Seen `reaction_s` late, looked at 20 times a second; less than 0.3 N is never noticed.
    """

    def begin(self) -> None:
        self._see = Late(self.body.reaction_s, self.step_s, (self._still, self._still))
        self._push, self._muscle, self._next = [0.0] * self.d, [0.0] * self.d, 0.0

    def pull(self, time: float, x: Floats, v: Floats, felt: Floats) -> Floats:
        seen, rate = self._see(list(x), list(v))
        if time >= self._next:
            self._next = time + 0.05
            self._decide(time, seen, rate)
        share = self.step_s / 0.05
        for i, push in enumerate(self._push):
            self._muscle[i] += share * (push - self._muscle[i])
        return [f - 5.0 * one for f, one in zip(self._muscle, v, strict=True)]

    def _decide(self, time: float, seen: Floats, rate: Floats) -> None:
        _, ve, _ = self.meant(time)
        was, _, _ = self.meant(time - self.body.reaction_s)
        d = self.body.yielding_ns_per_m
        wanted = [0.6 * d * (ve[i] + 1.2 * (was[i] - seen[i]) - rate[i]) + 0.4 * d * ve[i] for i in range(self.d)]
        change = sqrt(sum((w - p) ** 2 for w, p in zip(wanted, self._push, strict=True)))
        if change > 0.10 * sqrt(sum(p * p for p in self._push)) + 0.3:
            self._push = wanted


class Corrects(Mind):
    """Falls short, sees it a reaction later, and corrects by sub-movements that overlap."""

    def begin(self) -> None:
        assert self.course is not None
        self._moves: list[tuple[float, float, list[float]]] = []
        self._see, self._next = Late(self.body.reaction_s, self.step_s, (self._still,)), self.course.start_s

    def pull(self, time: float, x: Floats, v: Floats, felt: Floats) -> Floats:
        (seen,), body = self._see(list(x)), self.body
        if time >= self._next:
            self._correct(time, seen)
        xe, ve = [0.0] * self.d, [0.0] * self.d
        for start, duration, far in self._moves:
            s = min((time - start) / duration, 1.0)
            way, speed = s**3 * (10.0 - 15.0 * s + 6.0 * s * s), 30.0 * s * s * (1.0 - s) ** 2 / duration
            for i, one in enumerate(far):
                xe[i] += one * way
                ve[i] += one * speed
        return [body.stiffness_n_per_m * (xe[i] - x[i]) + body.damping_ns_per_m * (ve[i] - v[i]) for i in range(self.d)]

    def _correct(self, time: float, seen: Floats) -> None:
        """Toward where the course will be when this sub-movement ends: all at once on a short one, by and by on a long one."""
        assert self.course is not None
        first, course = not self._moves, self.course
        lasts = min(0.75 * (course.stop_s - course.start_s), 2.5) if first else 0.7
        goal, _, _ = self.meant(time + lasts / 0.75 if first else time + lasts)
        meant = [sum(far[i] for _, _, far in self._moves) for i in range(self.d)]
        missing = [g - (m if first else 0.5 * (m + s)) for g, m, s in zip(goal, meant, seen, strict=True)]
        if sqrt(sum(one * one for one in missing)) > 0.008:
            share = 0.9 + 0.08 * float(self.rng.standard_normal())
            self._moves.append((time, lasts, [share * one for one in missing]))
        self._next = time + (0.9 * lasts if first else 0.45)


class SpringsByMuscle(Mind):
    """A pair of Hill-type muscles on each axis, driven by the threshold of the stretch reflex, which the course shifts.

    Each is active by how far it is stretched beyond its threshold, 30 ms late, through an activation of 30 ms; its force falls as
    it shortens (Hill's hyperbola) and grows by up to 1.4 as it is stretched. Both are always a little active.
    """

    def draw(self) -> None:
        self._cocontraction_m = float(self.rng.uniform(0.02, 0.05))
        self._fastest = float(self.rng.uniform(1.2, 2.0))  # [m/s] at the hand: there a muscle pulls no more

    def begin(self) -> None:
        self._feel = Late(0.03, self.step_s, (self._still, self._still))
        self._active = [[self._cocontraction_m, self._cocontraction_m] for _ in range(self.d)]

    def pull(self, time: float, x: Floats, v: Floats, felt: Floats) -> Floats:
        body, (xe, ve, _), out = self.body, self.meant(time), []
        k, c, keep = 0.6 * body.stiffness_n_per_m, self._cocontraction_m, self.step_s / 0.03
        mu = 0.8 * body.damping_ns_per_m / body.stiffness_n_per_m
        was, rate = self._feel([p - q for p, q in zip(xe, x, strict=True)], [p - q for p, q in zip(ve, v, strict=True)])
        for i, active in enumerate(self._active):
            off = was[i] + mu * rate[i]
            active[0] += keep * (max(c + off, 0.0) - active[0])
            active[1] += keep * (max(c - off, 0.0) - active[1])
            own = body.carried_n[i]  # carried by whichever muscle holds it
            up = (k * active[0] + max(own, 0.0)) * self._hill(v[i])
            down = (k * active[1] + max(-own, 0.0)) * self._hill(-v[i])
            out.append(
                up - down - own + 0.4 * body.stiffness_n_per_m * (xe[i] - x[i]) + 0.3 * body.damping_ns_per_m * (ve[i] - v[i])
            )
        return out

    def _hill(self, shortening: float) -> float:
        """Force-velocity, 1 at rest."""
        s = min(max(shortening / self._fastest, -1.0), 1.0)
        return (1.0 - s) / (1.0 + 4.0 * s) if s >= 0.0 else (1.4 - (1.0 + s) * 0.4 / (1.0 - 10.0 * s))


# ----------------------------------------------------------------------------------------------------------- who follows


class Resists(Mind):
    """A damper, and nothing else."""

    def pull(self, time: float, x: Floats, v: Floats, felt: Floats) -> Floats:
        return [-0.5 * self.body.yielding_ns_per_m * one for one in v]


class StiffShoulder(Mind):
    """2 N of friction and a damper of 45-60 N s/m: a shoulder that does not like to be moved."""

    friction_n, damping = 2.0, (45.0, 60.0)

    def draw(self) -> None:
        self._damping = float(self.rng.uniform(*self.damping))

    def pull(self, time: float, x: Floats, v: Floats, felt: Floats) -> Floats:
        speed = sqrt(sum(one * one for one in v))
        rub = self.friction_n * tanh(speed / 0.01) / speed if speed > 1e-9 else self.friction_n / 0.01
        return [-(rub + self._damping) * one for one in v]


class Sticks(StiffShoulder):
    """3 N of friction, then a light damper: more than a robot that was told nothing may ask with."""

    friction_n, damping = 3.0, (9.0, 11.0)


class Relaxes(Mind):
    """A spring whose rest comes after the hand within 0.25 s."""

    def begin(self) -> None:
        self._rest = [0.0] * self.d

    def pull(self, time: float, x: Floats, v: Floats, felt: Floats) -> Floats:
        rest, k = self._rest, 0.6 * self.body.stiffness_n_per_m
        for i, one in enumerate(x):
            rest[i] += self.step_s / 0.25 * (one - rest[i])
        return [k * (rest[i] - x[i]) - 5.0 * v[i] for i in range(self.d)]


class Trails(Mind):
    """A soft posture that comes after the hand within 0.3 s: the arm is what is felt."""

    def begin(self) -> None:
        self._rest = [0.0] * self.d

    def pull(self, time: float, x: Floats, v: Floats, felt: Floats) -> Floats:
        rest = self._rest
        for i, one in enumerate(x):
            rest[i] += self.step_s / 0.3 * (one - rest[i])
        return [60.0 * (rest[i] - x[i]) - 8.0 * v[i] for i in range(self.d)]


class StepsAfter(Mind):
    """Notices three times a second that it is pulled, and goes where the object is."""

    def begin(self) -> None:
        self._rest, self._goal, self._next = [0.0] * self.d, [0.0] * self.d, 0.3

    def pull(self, time: float, x: Floats, v: Floats, felt: Floats) -> Floats:
        k, d = min(self.body.stiffness_n_per_m, 150.0), self.d
        if time >= self._next:
            self._next = time + 0.3
            if k * sqrt(sum((x[i] - self._rest[i]) ** 2 for i in range(d))) > 1.0:
                self._goal = [x[i] + 0.15 * v[i] for i in range(d)]
        for i in range(d):
            self._rest[i] += self.step_s / 0.12 * (self._goal[i] - self._rest[i])
        return [k * (self._rest[i] - x[i]) - 15.0 * v[i] for i in range(d)]


class Foresees(Mind):
    """Sees the object a reaction late and goes on as fast as it was seen to go."""

    def begin(self) -> None:
        self._see = Late(self.body.reaction_s, self.step_s, (self._still, self._still))

    def pull(self, time: float, x: Floats, v: Floats, felt: Floats) -> Floats:
        seen, rate = self._see(list(x), list(v))
        late = self.body.reaction_s
        return [80.0 * (seen[i] + late * rate[i] - x[i]) + 10.0 * (rate[i] - v[i]) for i in range(self.d)]


class Levels(Mind):
    """Goes where the object is level, by eye: moves at 40-90 m/s for a radian that it saw a reaction ago, if it saw any.

    Tilt is positive where the person's end is too far along the axis. The eye sees from 0.3 mrad on (0.2 mm of 0.8 m).
    """

    wants_tilt = True
    least_rad = 3e-4

    def draw(self) -> None:
        self._gain = float(self.rng.uniform(40.0, 90.0))

    def begin(self) -> None:
        self._late, self._tilt = Late(self.body.reaction_s, self.step_s, (self._still,)), list(self._still)
        self._rest, self._speed = [0.0] * self.d, [0.0] * self.d

    def see(self, tilt: Floats, rate: Floats) -> None:
        self._tilt = [float(one) for one in tilt]

    def pull(self, time: float, x: Floats, v: Floats, felt: Floats) -> Floats:
        (seen,), body, out = self._late(self._tilt), self.body, []
        for i, tilt in enumerate(seen):
            beyond = max(abs(tilt) - self.least_rad, 0.0)
            wanted = -self._gain * (beyond if tilt > 0.0 else -beyond)
            self._speed[i] += self.step_s / 0.1 * (min(max(wanted, -0.4), 0.4) - self._speed[i])
            self._rest[i] += self.step_s * self._speed[i]
            out.append(body.stiffness_n_per_m * (self._rest[i] - x[i]) + body.damping_ns_per_m * (self._speed[i] - v[i]))
        return out
