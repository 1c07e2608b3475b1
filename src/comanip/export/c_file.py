"""One C file and its header: the kernels' own headers, with the numbers of one controller as constants."""

from __future__ import annotations

import re
from collections.abc import Iterable
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np

from .. import __version__
from ..errors import ParameterError
from .controller import Controller
from .numbers import Numbers, numbers_of

KERNELS = ("layout", "exponential", "vectors", "path", "foresight", "filter", "law", "enter", "roles", "checker", "envelope",
           "guard", "estimate", "whole")  # fmt: skip
KEYWORDS = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if inline int long register restrict "
    "return short signed sizeof static struct switch typedef union unsigned void volatile while main".split()
)
MOST_STATE_BYTES = 65536


class Source(NamedTuple):
    """The text of NAME.c and NAME.h; `state_bytes` is the size of what one robot remembers."""

    c: str
    h: str
    state_bytes: int


def identifier(stem: str) -> str:
    """The prefix of all names in the file, from the stem of the file's own name."""
    name = re.sub(r"\W", "_", stem, flags=re.ASCII)
    if not name or name[0].isdigit() or name in KEYWORDS:
        name = f"skill_{name}"
    return name


def source(controller: Controller, *, name: str = "skill", self_test: str = "") -> Source:
    """`name` is that of the files, without suffix; what they define begins with it, as far as it is an identifier.

    self_test   C that stands behind the rest under COMANIP_SELF_TEST; see `export.self_test`
    """
    stem, name = name, identifier(name)
    numbers = numbers_of(controller)
    state = _state_doubles(numbers, len(controller.axes))
    if state * 8 > MOST_STATE_BYTES:
        raise ParameterError(
            f"this skill remembers {state * 8} bytes, a controller may {MOST_STATE_BYTES}: learn it with fewer goals or states"
        )
    fields = {**_fields(controller, numbers, name, state), "FILE": stem}
    header = filled(HEADER, fields)
    body = filled(BODY, fields | {"KERNELS": _kernels(), "CONSTANTS": _constants(numbers), "SELF_TEST": self_test})
    return Source(body, header, state * 8)


def _kernels() -> str:
    """The headers as they are, in the order in which the extension includes them."""
    room = files("comanip.kernels")
    return "\n".join((room / f"_{name}.h").read_text(encoding="utf-8").strip() + "\n" for name in KERNELS)


def filled(text: str, fields: dict[str, Any]) -> str:
    """`text` with every @NAME@ replaced by the field of that name."""
    return re.sub(r"@(\w+)@", lambda found: str(fields[found.group(1)]), text)


def _number(value: float) -> str:
    value = float(value)
    if np.isnan(value):
        return "NAN"
    if np.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return repr(value)


def _numbers(values: Iterable[float], width: int = 118) -> str:
    """Comma-separated, in lines of at most `width`."""
    lines, line = [], ""
    for text in map(_number, values):
        if len(line) + len(text) + 2 > width:
            lines.append(line)
            line = ""
        line += f"{text}, "
    return "\n".join(f"    {one.rstrip()}" for one in [*lines, line] if one.strip()).rstrip(",")


def array(name: str, values: Any) -> str:
    """A constant array of C."""
    flat = np.asarray(values, dtype=float).ravel().tolist()
    return f"static const double {name}[{max(len(flat), 1)}] = {{\n{_numbers(flat or [0.0])}\n}};\n"


def _struct(kind: str, name: str, values: Any) -> str:
    return f"static const {kind} {name} = {{\n{_numbers(np.asarray(values, dtype=float).ravel().tolist())}\n}};\n"


def _constants(n: Numbers) -> str:
    path, velocity, force, way, gain, goals = n.tables
    parts = [
        _struct("Numbers", "LEADING", n.laws[0]), _struct("Numbers", "FOLLOWING", n.laws[1]),
        _struct("Policy", "POLICY_", n.policy),
        _struct("Limits", "LIMITS_", n.limits), array("PATH", path), array("PATH_VELOCITY", velocity), array("PATH_FORCE", force),
        array("WAY", way), array("GAIN", gain), array("STATIONS", n.stations), array("FIRSTS", n.firsts),
    ]  # fmt: skip
    plans = dict(zip(("PLAN", "PLAN_WAY", "HEADING", "GRID", "PRIOR"), n.plans or ((),) * 5, strict=True))
    parts += [array(name, values) for name, values in plans.items() if n.plans or name in ("GRID", "PRIOR")]
    names = ("ORIGIN", "FACTORS", "CENTRES", "PEAK", "INITIAL", "CHAIN")
    parts += [array(name, values) for name, values in zip(names, n.filter, strict=True)]
    *scalars, gravity, d, ticks, late, average = n.weighing
    inside = f"{_numbers(scalars)},\n    {{{_numbers(gravity).strip()}}}, {d}, {ticks}, {late}, {average}"
    parts.append(f"static const Weighing WEIGHING = {{\n{inside}\n}};\n")
    return "\n".join(parts) + _tables(goals, n)


def _tables(goals: np.ndarray, n: Numbers) -> str:
    """Each goal's path, as a part of the arrays above."""
    d, at, rows = int(n.tables[0].shape[1]), 0, []
    for g, (count, step_s, *others) in enumerate(goals.tolist()):
        where = [f"PATH + {at * d}", f"PATH_VELOCITY + {at * d}", f"PATH_FORCE + {at * d}", f"WAY + {at}", f"GAIN + {at}"]
        where += [f"PLAN + {3 * at * d}", f"PLAN_WAY + {at}", f"HEADING + {g * d}"] if n.plans else ["0", "0", "0"]
        numbers = [_number(v) for v in (step_s, step_s * (count - 1.0), *others)]
        rows.append("    {" + ", ".join([str(int(count)), *numbers, *where]) + "}")
        at += int(count)
    return "\nstatic const Table TABLES[] = {\n" + ",\n".join(rows) + "\n};\n"


def _state_doubles(n: Numbers, d: int) -> int:
    """As C's Memory: keep the two alike."""
    plans = len(n.plans[4]) if n.plans else 0
    skill = (4 * d + 4) + (3 * d + 10) + (8 * d + 7) + (len(n.stations) + d + 3) + n.n_goals + (4 * d + 8 + 2 * plans)
    watch = 1 + n.heard + len(n.filter[3]) + 5
    role, sample = 12 + 2 * 6, 2 + 5 * 6 - 6
    guard = 22 + 8 * 6 + 3 * 6 + _ledger() + 6  # and the vectors of an Axes
    weighed = 8 + 12 * 6
    kept = (n.sizes[0] + n.sizes[1]) * d + 1 + d * (n.late + 2)
    return skill + watch + role + sample + guard + weighed + kept + 64


def _ledger() -> int:
    from ..kernels.layouts import BLOCKS

    return len(BLOCKS["scalars"]) + 2 + len(BLOCKS["vectors"]) * 6


def _fields(controller: Controller, n: Numbers, name: str, state: int) -> dict[str, Any]:
    felt, inner = controller.estimator, controller.skill.skill
    limits, axes = controller.skill.limits, controller.axes
    walls = controller.skill._walls
    box = "; ".join(f"{axis} {low:.3f} to {high:.3f} m" for axis, (low, high) in zip(axes, walls, strict=True))
    return {
        "NAME": name, "GUARD": f"{name.upper()}_H", "STATE": state, "AXES": len(axes), "DT": _number(controller.dt),
        "AXIS_NAMES": ", ".join(axes), "ROLE": controller.role, "LAW": controller.law, "VERSION": __version__,
        "HASHES": "\n *   ".join(controller.hashes), "GOALS": n.n_goals, "N_STATES": len(n.filter[3]), "HEARD": n.heard,
        "STATIONS_N": len(n.stations), "WIDTH": n.stations.shape[1], "PLANS_N": len(n.plans[4]) if n.plans else 0,
        "ALIKE": n.alike, "KEEP": _number(n.keep), "KIND": "CHANGES" if n.changes else "ALONE", "LEADS": int(n.leads),
        "TOLD": _number(n.told), "MODEL_DT": _number(n.model_dt), "PATIENCE": n.patience, 
        "BESIDE": _number(n.beside), "GATE": _number(n.gate),
        "SHAKE_SHARE": _number(n.shares[0]), "PULL_SHARE": _number(n.shares[1]), "BIAS_SHARE": _number(n.shares[2]),
        "PULLS_N": n.sizes[0], "BEFORE_N": n.sizes[1], "SWING_N": n.sizes[2], "LATE_N": n.late,
        "WALLS": ", ".join(f"{{{_number(low)}, {_number(high)}}}" for low, high in n.walls),
        "RULES": ", ".join(map(_number, n.rules)), "BOX": box, "V_MAX": f"{limits.v_max_m_per_s:.3g}",
        "FORCE_LIMIT": f"{limits.force_limit_n:g}", "ENERGY": f"{limits.energy_j:.3g}", "MASS": f"{felt._stated:g}",
        "SHARE": f"{felt._share:g}", "TARE_S": f"{felt._ticks * controller.dt:g}",
        "GRAVITY": ", ".join(f"{g:g}" for g in felt._gravity),
        "SKILL": type(inner).__name__, "REASONS": _reasons(name),
    }  # fmt: skip


def reasons() -> tuple[tuple[str, str], ...]:
    """(name, text) of every reason, in the order of their numbers, from the kernels' own list."""
    text = (files("comanip.kernels") / "_guard.h").read_text(encoding="utf-8")
    found = re.findall(r'^    X\((\w+), "([^"]*)"\)', text, flags=re.MULTILINE)
    return tuple((name.lower(), said) for name, said in found)


def _reasons(name: str) -> str:
    lines = [f"    {name}_reason_{which} = {n}, /* {said or 'none: it runs'} */" for n, (which, said) in enumerate(reasons())]
    return "\n".join(lines)


HEADER = """\
/* @FILE@: made by comanip @VERSION@ from a skill that was learned by demonstration. Do not edit; export again.
 *
 * role @ROLE@, law "@LAW@", axes @AXIS_NAMES@ (task frame), control period @DT@ s
 * SHA-256 of the skill:
 *   @HASHES@
 *
 * Units are SI: m, m/s, m/s^2, N, s. Vectors have one number an axis, in the order above. Forces act on the robot's hand:
 * sensor_force is what the OBJECT does to the hand, weight included; F = F_s + s m (a - g) is what the partner means, positive
 * where the partner pushes along the axis. Gravity is (@GRAVITY@) m/s^2.
 *
 * At the start both hold the object at rest: the first @TARE_S@ s weigh it (stated: @MASS@ kg, share @SHARE@).
 * Limits of the envelope: @V_MAX@ m/s, @FORCE_LIMIT@ N, @ENERGY@ J, walls @BOX@.
 * Good engineering, not a certified safety function; nobody has tried this file on a robot.
 *
 *     @NAME@_state state;
 *     @NAME@_init(&state);
 *     every period: fill obs; @NAME@_step(&state, &obs, &cmd); send cmd.velocity (or position); at HOLD the hand stays stiff
 *     at HOLD, when the cause is gone and the user says so: reason = @NAME@_rearm(&state), 0 where it runs again
 *
 * C99, no allocation, no global state; of <math.h> sqrt and fabs. Compile without -ffast-math.
 */
#ifndef @GUARD@
#define @GUARD@

#ifdef __cplusplus
extern "C" {
#endif

#define @NAME@_AXES @AXES@
#define @NAME@_DT @DT@ /* [s] */
#define @NAME@_STATES @N_STATES@ /* of the model; see @NAME@_weights */

/* What it remembers, @STATE@ * 8 bytes: opaque, may be copied by assignment. One for each robot. */
typedef struct { double opaque[@STATE@]; } @NAME@_state;

/* What is measured in one period. NAN is missing; stamps are of one clock. */
typedef struct {
    double time;                    /* [s] */
    double force_time;              /* [s] when sensor_force was measured; NAN: at `time` */
    double position[@AXES@];             /* [m] of the hand */
    double velocity[@AXES@];             /* [m/s] */
    double sensor_force[@AXES@];         /* [N] F_s; NAN: no new sample */
} @NAME@_obs;

/* What to do until the next. */
typedef struct {
    double position[@AXES@], velocity[@AXES@], acceleration[@AXES@]; /* [m], [m/s], [m/s^2]: follow the velocity */
    double force[@AXES@];                                  /* [N] F, as estimated */
    double tank_j, confidence;                        /* energy that is left [J]; 1: the skill's command passes whole */
    double phase_s, clock_rate;                       /* where in the taught path it is [s], how fast that goes by */
    double blend;                                     /* 0 follows .. 1 leads */
    double reason_value;                              /* the number that belongs to the reason, NAN where it has none */
    int mode;                                         /* 0 RUN, 1 COMPLY: gives way, 2 HOLD: brakes and stays stiff */
    int reason;                                       /* why, of the enum below; 0 in RUN */
    int passes;                                       /* 1: goes on by itself when that has passed; 0: only re-arming ends it */
    int acts;                                         /* 0 follows, 1 offers to lead, 2 leads, 3 complies only: off the path */
} @NAME@_cmd;

/* Reasons; the texts are those of @NAME@_reason_text. */
enum {
@REASONS@
};

void @NAME@_init(@NAME@_state *state);
void @NAME@_step(@NAME@_state *state, const @NAME@_obs *obs, @NAME@_cmd *cmd);
/* From where the arm is at the last step; 0: it runs again, else the reason why it does not. At rest, by the user alone. */
int @NAME@_rearm(@NAME@_state *state);
const char *@NAME@_reason_text(int reason);
/* Which state of the model this is, a probability each; shown, and no command depends on it. */
void @NAME@_weights(const @NAME@_state *state, double weights[@N_STATES@]);

#ifdef __cplusplus
}
#endif
#endif
"""

BODY = """\
/* @FILE@.c: see @FILE@.h. Made by comanip @VERSION@; do not edit. */
#include "@FILE@.h"

#include <math.h>

#if defined(__FAST_MATH__)
#error "compile without -ffast-math: what is not a number must stay so"
#endif
#if defined(__FLT_EVAL_METHOD__) && __FLT_EVAL_METHOD__ != 0
#error "numbers are computed with more digits than double has: on 32-bit x86 compile with -msse2 -mfpmath=sse"
#endif
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=off")
#endif

#define TICK(law, filter, xi) filter_tick(filter, xi)

/* ------------------------------------------------------------------------------------- kernels of comanip, as they are */

@KERNELS@
/* ------------------------------------------------------------------------------------------------- numbers of this skill */

@CONSTANTS@
static const double WALLS_[@AXES@][2] = {@WALLS@};
static const double RULES_[3] = {@RULES@};

/* ------------------------------------------------------------------------------------------------------------------ ticks */

enum { D = @AXES@, GOALS = @GOALS@, K = @N_STATES@, HEARD = @HEARD@, N_STATIONS = @STATIONS_N@, N_PLANS = @PLANS_N@ };
enum { N_PULLS = @PULLS_N@, N_BEFORE = @BEFORE_N@, PAST = @LATE_N@ + 2 };

typedef struct {
    double begun, refused_value; /* 0: the next step is the first */
    double compliance[4 * D + 4], pace[3 * D + CLOCKS], skill[8 * D + 7], where[N_STATIONS + D + 3], goals[GOALS];
    double foresight[4 * D + TOLD + 2 * N_PLANS];
    double until, seen[HEARD], weights[K], filter[FILTER_STATE];
    double pulls[N_PULLS * D], before[N_BEFORE * D], tank, past[D * PAST];
    Role role;
    Guard guard;
    Weighed weighed;
    Sample sample;
} Memory;

typedef char it_fits[sizeof(Memory) <= sizeof(@NAME@_state) ? 1 : -1];

typedef struct { /* for one tick */
    Whole whole;
    Tick filter;
    double entries[GOALS], moved[N_STATIONS], said[N_STATIONS], log_b[K], h[K];
} Room;

static void lay_out(Room *room, Memory *m) {
    static const Room NO_ROOM_;
    Whole *w = &room->whole;
    Law *l = &w->law;
    Envelope *e = &w->envelope;
    *room = NO_ROOM_;
    w->kind = @KIND@, w->leads = @LEADS@, w->entries = room->entries;
    w->role = &m->role, w->guard = &m->guard, w->weighing = &WEIGHING, w->weighed = &m->weighed, w->past = m->past;
    l->d = D, l->n_goals = GOALS, l->heard = HEARD, l->dt = @DT@, l->model_dt = @MODEL_DT@;
    l->keep_shake = @SHAKE_SHARE@, l->pull_share = @PULL_SHARE@, l->bias_share = @BIAS_SHARE@;
    l->law = LEADING, l->following = FOLLOWING, l->policy = POLICY_, l->tables = TABLES;
    l->where.stations = N_STATIONS, l->where.width = @WIDTH@, l->where.rows = STATIONS, l->where.first = FIRSTS;
    l->where.goals = m->goals, l->where.moved = room->moved, l->where.said = room->said;
    lay_where(&l->where, D, m->where);
    lay_law(l, m->compliance, m->pace, m->skill);
    l->foresight.plans = N_PLANS, l->foresight.alike = @ALIKE@, l->foresight.keep = @KEEP@;
    l->foresight.sizes = GRID, l->foresight.paces = GRID + N_PLANS, l->foresight.late = GRID + 2 * N_PLANS;
    l->foresight.prior = PRIOR;
    lay_foresight(&l->foresight, D, m->foresight);
    l->until = &m->until, l->seen = m->seen, l->filter = &room->filter;
    room->filter.D = HEARD, room->filter.K = K, room->filter.patience = @PATIENCE@, room->filter.gate = @GATE@;
    room->filter.origin = ORIGIN, room->filter.factors = FACTORS, room->filter.centres = CENTRES, room->filter.peak = PEAK;
    room->filter.initial = INITIAL, room->filter.chain = CHAIN, room->filter.weights = m->weights, room->filter.state = m->filter;
    room->filter.log_b = room->log_b, room->filter.h = room->h;
    e->d = D, e->most_pulls = N_PULLS, e->most_before = N_BEFORE, e->swing = @SWING_N@, e->limits = LIMITS_;
    e->rules.v_max = RULES_[0], e->rules.a_max = RULES_[1], e->rules.dt = RULES_[2];
    for (int i = 0; i < D; i++) w->low[i] = WALLS_[i][0], w->high[i] = WALLS_[i][1];
    w->beside = @BESIDE@;
    wall_in(e, &m->guard);
    e->now = &m->guard.ledger, e->pulls = m->pulls, e->before = m->before, e->tank = &m->tank;
}

static Memory *memory_of(@NAME@_state *state) { return (Memory *)(void *)state->opaque; }

static void show(const Whole *w, @NAME@_cmd *cmd) {
    const Guard *g = w->guard;
    copy(cmd->force, w->guard->ledger.force, 0);
    cmd->tank_j = *w->envelope.tank, cmd->confidence = g->confidence;
    cmd->phase_s = w->law.shown_clock[PHASE], cmd->clock_rate = w->law.shown_clock[RATE], cmd->blend = w->role->blend;
    cmd->mode = (int)g->mode, cmd->reason = (int)g->reason, cmd->reason_value = g->mode != MODE_RUN ? g->value : NAN;
    cmd->passes = g->mode != MODE_RUN && g->passes != 0.0;
    cmd->acts = w->role->complies_only != 0.0 ? 3 : (int)w->role->acts;
}

void @NAME@_init(@NAME@_state *state) {
    static const @NAME@_state NOTHING_YET;
    Memory *m = memory_of(state);
    *state = NOTHING_YET;
    Room room;
    lay_out(&room, m);
    filter_reset(&room.filter);
    m->skill[8 * D + 6] = @TOLD@;
    copy(m->guard.low, room.whole.low, D), copy(m->guard.high, room.whole.high, D);
    m->guard.mode = MODE_HOLD, m->guard.reason = REASON_NOT_STARTED;
}

void @NAME@_step(@NAME@_state *state, const @NAME@_obs *obs, @NAME@_cmd *cmd) {
    Memory *m = memory_of(state);
    double *const out[3] = {cmd->position, cmd->velocity, cmd->acceleration};
    const int first = m->begun == 0.0;
    Room room;
    lay_out(&room, m);
    m->begun = 1.0;
    m->sample.time = obs->time, m->sample.force_time = obs->force_time;
    copy(m->sample.position, obs->position, D);
    copy(m->sample.velocity, obs->velocity, D);
    copy(m->sample.sensed, obs->sensor_force, D);
    step_whole(&room.whole, &m->sample, first, out);
    copy(cmd->force, m->sample.force, D);
    show(&room.whole, cmd);
}

int @NAME@_rearm(@NAME@_state *state) {
    Memory *m = memory_of(state);
    double value;
    Room room;
    if (m->begun == 0.0) return REASON_NOT_STARTED;
    lay_out(&room, m);
    return rearm_whole(&room.whole, &m->sample, &value);
}

const char *@NAME@_reason_text(int reason) {
#define ITS_TEXT(name, text) text,
    static const char *const TEXTS[] = {REASONS(ITS_TEXT)};
    return reason >= 0 && reason < N_REASONS ? TEXTS[reason] : "";
}

void @NAME@_weights(const @NAME@_state *state, double weights[@N_STATES@]) {
    const Memory *m = (const Memory *)(const void *)state->opaque;
    copy(weights, m->weights, K);
}
@SELF_TEST@"""
