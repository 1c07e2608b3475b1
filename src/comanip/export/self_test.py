"""A thousand ticks and what the Python answers to them, as C behind the controller: compile with -DCOMANIP_SELF_TEST and run it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..interfaces import Array, Command, Observation
from .c_file import array, filled
from .controller import Controller
from .reasons import number_of

TICKS = 1000
LIFTS, SHAKES, MISSES, REARMS, PUSHES = 60, 520, 640, 700, 820  # ticks at which something begins
DIGITS = 6  # of what is measured: short numbers in the file
STIFFNESS_N_PER_M, DAMPING_NS_PER_M = 150.0, 15.0


class Recorded(NamedTuple):
    """What was measured (T, 3 d), and answered: velocity and force (T, 2 d), mode and reason (T, 2)."""

    seen: Array
    answers: Array
    modes: Array


def recorded(controller: Controller) -> Recorded:
    """A hand that goes where it is sent, and a partner who lifts, shakes, is not felt for a moment, and pushes; re-armed once."""
    d, felt, skill = len(controller.axes), controller.estimator, controller.skill
    inner: Any = skill.skill
    path = inner._pace.references[0].position
    obs, command = Observation(d), Command(d)
    weight = felt._share * float(felt._stated) * np.array(felt._gravity)
    hand, velocity = path[0].copy(), np.zeros(d)
    seen, answers, modes = np.zeros((TICKS, 3 * d)), np.zeros((TICKS, 2 * d)), np.zeros((TICKS, 2))
    for n in range(TICKS):
        s = min(max((n - LIFTS) / 300.0, 0.0), 1.0)
        place = path[0] + (path[-1] - path[0]) * (s * s * s * (10.0 + s * (-15.0 + 6.0 * s)))
        force = STIFFNESS_N_PER_M * (place - hand) - DAMPING_NS_PER_M * velocity + 0.02 * np.sin(1.7 * n)
        force += 8.0 * np.sin(0.35 * n) * (SHAKES <= n < SHAKES + 60) + 30.0 * (PUSHES <= n < PUSHES + 40)
        obs.time, obs.force_time = n * controller.dt, np.nan
        obs.position[:], obs.velocity[:] = np.round(hand, DIGITS), np.round(velocity, DIGITS)
        obs.sensor_force[:] = np.round(weight + force, DIGITS)
        if MISSES <= n < MISSES + 10:
            obs.sensor_force[:] = np.nan
        seen[n] = np.concatenate([obs.position, obs.velocity, obs.sensor_force])
        if n == 0:
            felt.reset()
        felt.step(obs)
        if n == 0:
            skill.reset(obs)
        skill.step(obs, command)
        answers[n] = np.concatenate([command.velocity, obs.force])
        modes[n] = skill.diagnostics["mode"][0], number_of(skill.reason)
        velocity = command.velocity.copy()
        hand = hand + controller.dt * velocity
        if n == REARMS:
            skill.rearm(obs)
    return Recorded(seen, answers, modes)


def self_test(controller: Controller, name: str) -> str:
    """C for the end of the file. `controller` must never have run, and is of no use afterwards."""
    found = recorded(controller)
    tables = array("SEEN", found.seen) + array("ANSWERS", found.answers) + array("MODES", found.modes)
    return filled(TEXT, {"NAME": name, "AXES": len(controller.axes), "TICKS": TICKS, "REARMS": REARMS, "TABLES": tables})


TEXT = """
#ifdef COMANIP_SELF_TEST
/* What the Python answered to @TICKS@ ticks: cc -std=c99 -O2 -DCOMANIP_SELF_TEST @NAME@.c -lm && ./a.out */
#include <stdio.h>
#include <time.h>

@TABLES@
static @NAME@_state robot;

static void observe(int n, @NAME@_obs *obs) {
    const double *row = SEEN + n * 3 * D;
    obs->time = n * @NAME@_DT, obs->force_time = NAN;
    copy(obs->position, row, D);
    copy(obs->velocity, row + D, D);
    copy(obs->sensor_force, row + 2 * D, D);
}

static double off_by(double a, double b) { return a == b || (a != a && b != b) ? 0.0 : a != a || b != b ? INFINITY : fabs(a - b); }

int main(void) {
    double furthest = 0.0;
    int differ = 0, otherwise = 0;
    @NAME@_obs obs;
    @NAME@_cmd cmd;
    @NAME@_init(&robot);
    const clock_t began = clock();
    for (int n = 0; n < @TICKS@; n++) {
        double off = 0.0;
        observe(n, &obs);
        @NAME@_step(&robot, &obs, &cmd);
        for (int i = 0; i < D; i++) {
            off = most(off, off_by(cmd.velocity[i], ANSWERS[n * 2 * D + i]));
            off = most(off, off_by(cmd.force[i], ANSWERS[n * 2 * D + D + i]));
        }
        differ += off != 0.0;
        otherwise += cmd.mode != (int)MODES[2 * n] || cmd.reason != (int)MODES[2 * n + 1];
        furthest = most(furthest, off);
        if (n == @REARMS@) (void)@NAME@_rearm(&robot);
    }
    const double us = 1e6 * (double)(clock() - began) / CLOCKS_PER_SEC / @TICKS@;
    printf("%s: state %lu bytes, %.2f us a tick\\n", "@NAME@", (unsigned long)sizeof robot, us);
    if (!differ && !otherwise) printf("@TICKS@ of @TICKS@ ticks equal to the last bit\\n");
    else printf("%d of @TICKS@ ticks differ, by %g at most; %d in mode or reason\\n", differ, furthest, otherwise);
    /* another exp or log may round a last digit otherwise; more than that is a fault */
    return otherwise || !(furthest < 1e-9);
}
#endif
"""
