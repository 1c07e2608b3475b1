"""A person with an arm: a mind moves the hand, the hand has mass, and a soft grip joins it to the object.

    m dv_h/dt = f_muscle - f_grip          f_grip = k_g (x_h - x) + b_g (v_h - v)          the object feels f_grip

The grip is stiff beside a sub-step (4 kN/m on 0.5 kg turns at 14 Hz, its damper forgets within 5 ms), so the hand on its grip is
solved exactly for an object at constant velocity, and the object gets the mean force of the step: just the momentum that the
hand loses. With the arm's mass to 0 and a rigid grip the object feels the muscles themselves, as in `partners`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..interfaces import Array
from ..signals.second_order import Step, second_order_step
from .body import Body
from .habits import Habit
from .intent import Course, Noise, Unsteadiness
from .minds import Mind
from .robot import stated

GRIPS = 64  # how many grips there are between open and closed: each has its own exact step
OPEN = Step(1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


class Hand:
    """Arm and grip of d axes: where the hand is, and what the object feels. Displacements are from where it took hold."""

    def __init__(self, body: Body, n_axes: int, step_s: float) -> None:
        self.body, self.step_s, self._d = body, step_s, n_axes
        self._steps: dict[int, Step] = {0: OPEN}
        self.reset()

    def reset(self) -> None:
        body = self.body
        self.position, self.velocity = [0.0] * self._d, [0.0] * self._d
        # the hand is drawn where it is before it carries: the grip yields by so much under the weight
        self._sag = [c / body.grip_n_per_m for c in body.carried_n]
        self.felt = list(body.carried_n)

    def step(self, muscles: Sequence[float], position: Sequence[float], velocity: Sequence[float], hold: float = 1.0) -> None:
        """One sub-step; then `felt` (d,) [N] is its mean force on the object at `position` [m], moving at `velocity` [m/s].

        muscles   (d,) [N]; hold, the share of the grip that holds: 0 has let go
        """
        grip = round(GRIPS * hold)
        if grip == 0:
            self._keep_near(position, velocity)
            return
        one, h, m = self._steps.get(grip) or self._solved(grip), self.step_s, self.body.arm_kg
        for i, (x, v, f) in enumerate(zip(position, velocity, muscles, strict=True)):
            r, w, u = self.position[i] - x + self._sag[i], self.velocity[i] - v, f / m
            turned = one.vy * r + one.vv * w + one.vu * u
            self.position[i] = x + v * h + one.yy * r + one.yv * w + one.yu * u - self._sag[i]
            self.velocity[i] = v + turned
            self.felt[i] = f - m * (turned - w) / h

    def _keep_near(self, position: Sequence[float], velocity: Sequence[float]) -> None:
        """An empty hand goes along, to take hold again where the object then is, with nothing on it yet."""
        for i, (x, v) in enumerate(zip(position, velocity, strict=True)):
            self.position[i], self.velocity[i], self.felt[i] = x - self._sag[i], v, 0.0

    def _solved(self, grip: int) -> Step:
        body, share = self.body, grip / GRIPS
        k, c = share * body.grip_n_per_m / body.arm_kg, share * body.grip_ns_per_m / body.arm_kg
        self._steps[grip] = second_order_step(k, c, self.step_s)
        return self._steps[grip]


class Person:
    """The Partner made of a body, a mind and habits.

    goal (d,), onset_s, stop_s   what somebody who leads means: from where it took hold [m], [s]; None for one who follows
    see(tilt, rate)              only where the mind asks for it: see `interfaces.Partner`
    """

    def __init__(
        self,
        body: Body,
        mind: Mind,
        habits: Sequence[Habit] = (),
        *,
        n_axes: int,
        substep_s: float = 0.001,
        rng: np.random.Generator,
    ) -> None:
        self.body, self.mind, self.habits, self._d = body, mind, tuple(habits), n_axes
        self.hand = Hand(body, n_axes, substep_s)
        kind = Unsteadiness(relative=body.relative, tremor_n=body.tremor_n, tremor_hz=body.tremor_hz)
        self._noise = [Noise(kind, substep_s, rng) for _ in range(n_axes)]
        self._origin = [0.0] * n_axes
        if mind.wants_tilt:
            self.see = mind.see  # type: ignore[attr-defined]

    @property
    def course(self) -> Course | None:
        return self.mind.course

    @property
    def goal(self) -> Array | None:
        return None if self.course is None else self.course.end

    @property
    def goal_m(self) -> float | Array | None:
        """The same as a judge takes it: along the only axis a number."""
        return stated(self.goal)

    @property
    def onset_s(self) -> float | None:
        return None if self.course is None else self.course.start_s

    @property
    def stop_s(self) -> float | None:
        return None if self.course is None else self.course.stop_s

    def reset(self, position: Array) -> None:
        self._origin = [float(p) for p in position]
        self.hand.reset()
        for noise in self._noise:
            noise.reset()
        for habit in self.habits:
            habit.reset()
        self.mind.begin()

    def force(self, time: float, position: Array, velocity: Array, out: Array) -> None:
        if self._d == 1 and not self.habits:
            self._force_along_one(time, float(position[0]), float(velocity[0]), out)
        else:
            self._force(time, position, velocity, out)

    def _force_along_one(self, time: float, position: float, velocity: float, out: Array) -> None:
        """The same as `_force` without lists, for the commonest people: one axis, and no habits."""
        hand, (carried,), most = self.hand, self.body.carried_n, self.body.force_limit_n
        (pull,) = self.mind.pull(time, hand.position, hand.velocity, (hand.felt[0] - carried,))
        f = carried + pull
        f += self._noise[0].sample(f)
        hand.step((f if -most < f < most else most if f > 0.0 else -most,), (position - self._origin[0],), (velocity,))
        out[0] = hand.felt[0]

    def _force(self, time: float, position: Array, velocity: Array, out: Array) -> None:
        v, hand, body = velocity.tolist(), self.hand, self.body
        x = [p - o for p, o in zip(position.tolist(), self._origin, strict=True)]
        felt = [f - c for f, c in zip(hand.felt, body.carried_n, strict=True)]
        at, going, hold, strength, push = hand.position, hand.velocity, 1.0, 1.0, None
        for habit in self.habits:
            habit.step(time, x, v)
            hold, strength = hold * habit.hold, strength * habit.strength
            push = _sum(push, habit.push)
            if habit.moved is not None and habit.moving is not None:
                at = [p - m for p, m in zip(at, habit.moved, strict=True)]
                going = [p - m for p, m in zip(going, habit.moving, strict=True)]
        muscles, most = [], body.force_limit_n
        for i, pull in enumerate(self.mind.pull(time, at, going, felt)):
            f = hold * (body.carried_n[i] + strength * pull)
            f += self._noise[i].sample(f)
            if push is not None:
                f += push[i]
            muscles.append(f if -most < f < most else most if f > 0.0 else -most)
        hand.step(muscles, x, v, hold)
        out[:] = hand.felt
        for habit in self.habits:
            if habit.against is not None:
                out += habit.against


def _sum(one: Sequence[float] | None, other: Sequence[float] | None) -> Sequence[float] | None:
    if one is None or other is None:
        return other if one is None else one
    return [a + b for a, b in zip(one, other, strict=True)]


class Together:
    """Several people at the same end, each with a hand of their own; what the first means counts."""

    def __init__(self, people: Sequence[Person]) -> None:
        self.people = tuple(people)
        self.goal, self.goal_m, self.onset_s = people[0].goal, people[0].goal_m, people[0].onset_s
        stops = [one.stop_s for one in people if one.stop_s is not None]
        self.stop_s = max(stops) if stops else None

    def reset(self, position: Array) -> None:
        for one in self.people:
            one.reset(position)
        self._one = np.zeros(len(position))

    def force(self, time: float, position: Array, velocity: Array, out: Array) -> None:
        self.people[0].force(time, position, velocity, out)
        for one in self.people[1:]:
            one.force(time, position, velocity, self._one)
            out += self._one
