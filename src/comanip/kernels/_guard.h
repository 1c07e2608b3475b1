/* safety/envelope.py, detectors.py, situation.py and bounds.py once more, whole: RUN, COMPLY and HOLD, with every reason.
 *
 * One tick is `guard_senses` before the skill's own, which runs where that says so, and `guard_sends` after it. Python calls these
 * two (safety/compiled_tick.py), and what is exported does.
 */

#define REASONS(X) \
    X(NONE, "") \
    X(NOT_STARTED, "not started") \
    X(POLICY, "policy: its command is not finite") \
    X(CLOCK, "clock") \
    X(OLD, "force too old [ms]") \
    X(LATE, "late [ms]") \
    X(POSITION, "position not finite") \
    X(POSITION_JUMP, "position jump [m]") \
    X(FORCE, "force not finite") \
    X(TOO_STRONG, "force beyond its limit [N]") \
    X(VELOCITY, "velocity not plausible") \
    X(STUCK, "force stuck") \
    X(TOO_HEAVY, "the object weighs too much on this hand [N]: too heavy to carry") \
    X(FORCE_JUMPED, "force jumped at rest [N]: sensor? tare, then re-arm") \
    X(NOT_FOLLOWING, "does not follow [m off]") \
    X(GONE, "let go: the hand carries the whole object") \
    X(SINKS, "let go or loaded: more hangs on the hand than its share") \
    X(PUSHED, "pushed along [N]: sensor, or a weight on it?") \
    X(BLOCKED, "blocked") \
    X(LET_GO, "let go") \
    X(CHECKER_SPEED, "checker: speed") \
    X(CHECKER_ACCELERATION, "checker: acceleration") \
    X(CHECKER_ROOM, "checker: room to stop") \
    X(OUTSIDE, "outside the workspace [m]") \
    X(IN_MOTION, "in motion [m/s]") \
    X(PULLED, "pulled [N]: let the object rest, or tare") \
    X(STUCK_STILL, "force stuck still: sensor?")
#define ITS_REASON(name, text) REASON_##name,
enum { REASONS(ITS_REASON) N_REASONS };

#define MODE_RUN 0
#define MODE_COMPLY 1
#define MODE_HOLD 2

/* as in safety/detectors.py and safety/situation.py */
#define STANDS_M_S 1e-9
#define HANGING 0.12
#define HANGING_N 0.6
#define ANSWER_N 0.7
#define ANSWERS_N 0.9
#define ANSWERS_S 0.2
#define SAME_LOW 0.7
#define SAME_HIGH 1.3
#define LONGEST_WAIT_S 8.0

/* Names of what Python has otherwise begin with a letter. value, passed_value: the number that belongs to the reason; limit_n: what a
 * force was beyond; fresh, late: of this tick; low, high: the walls, around where it began */
#define GUARD(X) \
    X(mode, _state) X(reason, reason) X(value, value) X(passes, _passes) X(passed, passed) X(passed_value, passed_value) \
    X(passed_s, _passed_s) X(wait_s, _wait_s) X(sinks_wait_s, _sinks_wait_s) X(bound, _bound) X(feels_s, _feels_s) X(ran, ran) \
    X(first, _first) X(known, _known) X(ticks, _ticks) X(confidence, confidence) X(mistaken, _let_go.was_mistaken) \
    X(pending, pending) X(jump_count, _jump._count) X(jump_for_s, _jump._for_s) X(fresh, fresh) X(late, late) X(limit_n, limit_n)
#define GUARDED(X) \
    X(cause, _cause) X(pulled, _pulled) X(at_first, _at_first) X(before_jump, before_jump) X(jump, jump) X(jump_sum, jump_sum) \
    X(low, low) X(high, high)
typedef struct {
    GUARD(ONE_NUMBER)
    GUARDED(ITS_AXES)
    Axes wish[3]; /* what the skill commands: position, velocity, acceleration */
    Ledger ledger;
} Guard;

typedef struct { /* one observation; and how fast lessons went where the hand is, as the skill said last */
    double time, force_time;
    const double *position, *velocity, *sensed, *force, *taught;
} Seen;

static inline void fault(Guard *g, int reason, double value) {
    if (g->mode == MODE_HOLD && g->passes == 0.0) return;
    g->mode = MODE_HOLD, g->reason = reason, g->value = value, g->passes = 0.0;
}

static inline void stop_for(Guard *g, int d, int mode, int reason, double value, double bound) {
    g->mode = mode, g->reason = reason, g->value = value, g->passes = 1.0, g->passed_s = 0.0, g->bound = bound;
    copy(g->cause, g->ledger.force, d);
}

/* Envelope._pause and _comply */
static inline void hold_for(Guard *g, int d, int reason, double value, double bound) {
    if (g->mode != MODE_HOLD) stop_for(g, d, MODE_HOLD, reason, value, bound);
}
static inline void comply_for(Guard *g, int d, int reason, double value) {
    if (g->mode == MODE_RUN) stop_for(g, d, MODE_COMPLY, reason, value, INFINITY);
}

static inline double measured_speed(const double *velocity, int d) { /* NaN: nobody measures it */
    double total = 0.0;
    for (int i = 0; i < d; i++)
        if (velocity[i] == velocity[i]) total += velocity[i] * velocity[i];
    return sqrt(total);
}

/* Envelope._wrong; the number that belongs to it into `value` */
static inline int wrong(const Envelope *e, const double *force, const double *velocity, double limit, double *value) {
    for (int i = 0; i < e->d; i++)
        if (!(fabs(force[i]) < ABSURD)) return REASON_FORCE;
    if (length(force, e->d) > limit) {
        *value = length(force, e->d);
        return REASON_TOO_STRONG;
    }
    return measured_speed(velocity, e->d) > 10.0 * e->limits.v_max ? REASON_VELOCITY : REASON_NONE;
}

/* Envelope._problem */
static inline int problem_of(const Envelope *e, const Seen *seen, double *value) {
    *value = NAN;
    if (!is_finite(seen->time)) return REASON_CLOCK;
    for (int i = 0; i < e->d; i++) {
        const double x = seen->position[i];
        if (!(fabs(x) < ABSURD)) return REASON_POSITION;
        if (!(e->low[i] <= x && x <= e->high[i])) {
            *value = most(e->low[i] - x, x - e->high[i]);
            return REASON_OUTSIDE;
        }
    }
    return wrong(e, seen->force, seen->velocity, e->limits.force_limit, value);
}

static inline void start_checker(Guard *g, int d, const double *position) {
    copy(g->ledger.commanded.at, position, d);
    fill(g->ledger.commanded.last, 0.0, d);
}

static inline void forget_sinking(Ledger *l) { l->sunk = l->lack_peak = l->led = 0.0, l->again_s = l->since_up_s = INFINITY; }
static inline void forget_pulls(Ledger *l) { l->n_pulls = l->n_before = l->for_s = 0.0; }
static inline void forget_pushes(Ledger *l) { l->work = l->push_peak = 0.0; }

/* Envelope._restart */
static inline void restart(const Envelope *e, Guard *g, double time, const double *position) {
    static const Ledger NOTHING;
    Ledger *l = &g->ledger;
    const int d = e->d;
    *l = NOTHING;
    g->mode = MODE_RUN, g->reason = REASON_NONE, g->value = NAN;
    g->passes = g->passed = g->passed_s = g->feels_s = g->ticks = g->mistaken = g->pending = 0.0;
    g->first = g->known = g->confidence = 1.0;
    g->wait_s = g->sinks_wait_s = e->limits.passed_s, g->bound = INFINITY;
    fill(g->cause, 0.0, d), fill(g->pulled, 0.0, d), fill(g->at_first, 0.0, d);
    l->time = l->stamp = time, l->energy = e->limits.energy;
    copy(l->x, position, d), copy(l->sent, position, d), copy(l->at, position, d);
    forget_sinking(l);
    l->drag_error = UNTOLD_N;
    fill(l->reading, INFINITY, d), fill(l->smallest, INFINITY, d), fill(l->dead, NAN, d), fill(l->sensed, NAN, d);
    start_checker(g, d, position);
}

/* Envelope._clock: the period [s]; `fresh`, `late` */
static inline double clocked(const Envelope *e, Guard *g, double t) {
    Ledger *l = &g->ledger;
    const double dt = e->limits.dt, step = t - l->stamp;
    g->fresh = g->late = 0.0;
    if (!is_finite(t)) {
        fault(g, REASON_CLOCK, NAN);
        return dt;
    }
    if (step < 0.0) {
        fault(g, REASON_CLOCK, NAN);
        l->time = l->stamp = t;
        return dt;
    }
    if (g->first != 0.0) {
        g->first = 0.0, g->fresh = 1.0;
        l->elapsed = step;
        l->time = l->stamp = t;
        return dt;
    }
    if (step < SAME_SAMPLE * dt) {
        l->age += dt;
        l->time += dt;
        if (l->age > e->limits.stale + 1e-9) fault(g, REASON_OLD, 1000.0 * l->age);
        return dt;
    }
    const double period = most(t - l->time, 0.0);
    l->elapsed = step, l->stamp = t, l->time = most(t, l->time), l->age = 0.0;
    g->fresh = 1.0, g->late = period > e->limits.late + 1e-9;
    if (g->late != 0.0) fault(g, REASON_LATE, 1000.0 * period);
    return period;
}

/* LetGo.weigh */
static inline void weigh(const Envelope *e, Ledger *l, const double *sensed, const double *force, int at_rest) {
    Axes pull;
    if (l->weighed < WEIGHED_TICKS) {
        if (!at_rest || !all_finite(sensed, e->d)) return;
        l->weighed += 1.0;
        for (int i = 0; i < e->d; i++) l->weight[i] += (sensed[i] - force[i] - l->weight[i]) / l->weighed;
        return;
    }
    for (int i = 0; i < e->d; i++) pull[i] = force[i] - l->weight[i] * (1.0 + l->rate[i] / GRAVITY);
    remember(e->pulls, &l->n_pulls, e->most_pulls, e->d, pull);
}

/* Jump._confirmed */
static inline double confirmed(const Envelope *e, Guard *g, const double *sensed, double period) {
    Ledger *l = &g->ledger;
    Axes moved;
    const int d = e->d;
    for (int i = 0; i < d; i++) g->jump_sum[i] += sensed[i];
    g->jump_count += 1.0, g->jump_for_s += period;
    if (g->jump_for_s < e->limits.jump_stays_s) return 0.0;
    g->pending = 0.0, l->still_s = 0.0;
    for (int i = 0; i < d; i++) moved[i] = g->jump_sum[i] / g->jump_count - g->before_jump[i];
    const double size = length(g->jump, d), share = dot(moved, g->jump, d) / (size * size);
    return SAME_LOW < share && share < SAME_HIGH ? size : 0.0;
}

/* Jump.step */
static inline double jumped(const Envelope *e, Guard *g, const double *sensed, int at_rest, double period) {
    Ledger *l = &g->ledger;
    const int d = e->d;
    if (!all_finite(sensed, d)) return 0.0;
    if (!all_finite(l->sensed, d)) {
        copy(l->sensed, sensed, d);
        return 0.0;
    }
    if (g->pending != 0.0) {
        copy(l->sensed, sensed, d);
        return confirmed(e, g, sensed, period);
    }
    const double still = l->still_s, change = apart(sensed, l->sensed, d);
    l->still_s = at_rest ? l->still_s + period : 0.0;
    if (change == 0.0) return 0.0;
    l->heard_s = least(l->heard_s + period, most(QUIET_S, period));
    if (still > e->limits.jump_rest_s && change > e->limits.jump_n + 6.0 * l->jump_usual) {
        g->pending = 1.0, g->jump_count = g->jump_for_s = 0.0;
        for (int i = 0; i < d; i++) g->before_jump[i] = l->sensed[i], g->jump[i] = sensed[i] - l->sensed[i], g->jump_sum[i] = 0.0;
    }
    copy(l->sensed, sensed, d);
    l->jump_usual += (period > 0.0 ? period / l->heard_s : 0.0) * (change - l->jump_usual);
    return 0.0;
}

/* Envelope._sense */
static inline void sensing(const Envelope *e, Guard *g, const Seen *seen, double period) {
    const Limits *limits = &e->limits;
    Ledger *l = &g->ledger;
    Axes raw;
    const int d = e->d;
    int placed = 1;
    double value = NAN;
    g->known = 0.0;
    for (int i = 0; i < d; i++) {
        raw[i] = fabs(seen->sensed[i]) < ABSURD ? seen->sensed[i] : NAN;
        placed &= fabs(seen->position[i]) < ABSURD;
    }
    if (placed) {
        const double jump = apart(seen->position, l->at, d);
        if (jump > limits->position_jump + 2.0 * limits->v_max * l->elapsed) fault(g, REASON_POSITION_JUMP, jump);
        copy(l->at, seen->position, d);
    } else fault(g, REASON_POSITION, NAN);
    const double limit_n = l->impact_s <= 0.0 ? limits->force_limit : limits->impact_n;
    int problem = wrong(e, seen->force, seen->velocity, limit_n, &value);
    if (!problem && seen->time - seen->force_time > limits->stale + 1e-9)
        problem = REASON_OLD, value = 1000.0 * (seen->time - seen->force_time);
    if (problem && (g->mode != MODE_HOLD || g->passes != 0.0)) g->limit_n = limit_n;
    if (problem) fault(g, problem, value);
    if (stands_still(e, l, raw, seen->force, length(l->v, d), period)) fault(g, REASON_STUCK, NAN);
    if (problem) return;
    g->known = 1.0;
    copy(l->force, seen->force, d);
    const int at_rest = length(l->v, d) < limits->moving;
    weigh(e, l, raw, l->force, at_rest && length(l->force, d) < limits->tare_n);
    if (load_of(l, d) > limits->load_n) fault(g, REASON_TOO_HEAVY, load_of(l, d));
    const double size = jumped(e, g, raw, at_rest, period);
    if (size != 0.0) hold_for(g, d, REASON_FORCE_JUMPED, size, 0.5 * size);
}

/* Envelope._book */
static inline void book(const Envelope *e, Guard *g, double period) {
    const Limits *limits = &e->limits;
    Ledger *l = &g->ledger;
    const int d = e->d;
    const double speed = length(l->v, d);
    Axes way;
    for (int i = 0; i < d; i++) way[i] = l->v[i] * period;
    if (g->late != 0.0 && speed > 0.0) {
        const double braking = least(period - limits->dt, speed / limits->a_max);
        const double far = speed * (limits->dt + braking) - 0.5 * limits->a_max * braking * braking;
        for (int i = 0; i < d; i++) way[i] = l->v[i] / speed * far;
    }
    for (int i = 0; i < d; i++) l->x[i] += way[i];
    const double gain = g->known != 0.0 && g->late == 0.0 ? dot(l->force, way, d) : -limits->force_limit * length(way, d);
    l->energy = least(limits->energy, most(0.0, l->energy + gain));
    const double off = apart(l->x, l->at, d);
    if (off > limits->drift && g->mode != MODE_HOLD) fault(g, REASON_NOT_FOLLOWING, off);
}

/* The mean of the last `rows` of `n`, detectors._mean */
static inline void mean_of_last(const double *all, int n, int rows, int d, double *out) {
    const int first = n > rows ? n - rows : 0;
    for (int i = 0; i < d; i++) {
        double sum = 0.0;
        for (int row = first; row < n; row++) sum += all[row * d + i];
        out[i] = sum / (n - first);
    }
}

/* LetGo.dragged */
static inline int is_dragged(const Guard *g, const Ledger *l, int d) { return g->mistaken > 0.0 && explains(l, load_of(l, d)); }

/* LetGo.step */
static inline int carries_alone(const Envelope *e, Guard *g, double speed, double period) {
    const Limits *limits = &e->limits;
    Ledger *l = &g->ledger;
    const int d = e->d, n = (int)l->n_pulls;
    const double load = load_of(l, d);
    int alone = 0;
    if (load > HANGS_N && n == e->most_pulls) {
        Axes pull, slow;
        mean_of_last(e->pulls, n, e->swing, d, pull);
        mean_of_last(e->pulls, n, n, d, slow);
        remember(e->before, &l->n_before, e->most_before, d, pull);
        const double near = least(limits->alone_n, ALONE_SHARE * load);
        const int moves = speed > limits->stands, still = apart(e->before, pull, d) < STILL_S * limits->steady_n_s;
        alone = (length(pull, d) < near && still) || (length(slow, d) < near && moves && still);
    }
    l->for_s = alone && !is_dragged(g, l, d) ? l->for_s + period : 0.0;
    return l->for_s > AGAIN_AS_LONG[(int)least(g->mistaken, 2.0)] * limits->alone_s;
}

/* Envelope._sink */
static inline void sink(const Envelope *e, Guard *g, const double *taught, double period) {
    if (sinks(e, &g->ledger, taught, period)) hold_for(g, e->d, REASON_SINKS, NAN, INFINITY);
}

/* Envelope._press */
static inline void press(const Envelope *e, Guard *g, double speed, double period) {
    const Limits *limits = &e->limits;
    Ledger *l = &g->ledger;
    const double against = -dot(l->force, l->v, e->d) / most(speed, 1e-6);
    l->blocked_ns = against > limits->blocked_n ? l->blocked_ns + against * period : 0.0;
    if (l->blocked_ns > limits->blocked_n * limits->blocked_s) {
        comply_for(g, e->d, REASON_BLOCKED, NAN);
        l->impact_s = limits->impact_s;
    }
    const double most_n = g->mistaken != 0.0 ? 1.2 * load_of(l, e->d) : limits->offer_n;
    const double opposes = is_dragged(g, l, e->d) ? 0.0 : -dot(l->force, g->wish[1], e->d);
    if ((int)g->passed == REASON_BLOCKED &&
        opposes > most(most_n, limits->offer_n) * length(g->wish[1], e->d)) {
        g->wait_s = least(2.0 * g->wait_s, LONGEST_WAIT_S);
        comply_for(g, e->d, REASON_BLOCKED, NAN);
    }
}

/* Envelope._miss */
static inline void miss(const Envelope *e, Guard *g, const Seen *seen, double speed, double period) {
    Axes sensed;
    for (int i = 0; i < e->d; i++) sensed[i] = fabs(seen->sensed[i]) < ABSURD ? seen->sensed[i] : NAN;
    if (missed(e, &g->ledger, sensed, speed, period)) comply_for(g, e->d, REASON_LET_GO, NAN);
}

/* Envelope._look */
static inline void look(const Envelope *e, Guard *g, const Seen *seen, double period) {
    Ledger *l = &g->ledger;
    const int d = e->d;
    const double speed = length(l->v, d), size = length(l->force, d);
    dragging(l, d, period);
    if (carries_alone(e, g, speed, period)) {
        comply_for(g, d, REASON_GONE, NAN);
        g->feels_s = e->limits.feel_s;
        mean_of_last(e->pulls, (int)l->n_pulls, e->swing, d, g->pulled);
    }
    sink(e, g, seen->taught, period);
    pushing(e, l, period);
    if (l->work > e->limits.pushed_j) {
        comply_for(g, d, REASON_PUSHED, size);
        forget_pushes(l);
    }
    press(e, g, speed, period);
    if (load_of(l, d) <= LIGHT_N) miss(e, g, seen, speed, period);
    shaken(e, l, period);
    if (g->ticks < 5.0) {
        g->ticks += 1.0;
        for (int i = 0; i < d; i++) g->at_first[i] += (l->force[i] - g->at_first[i]) / g->ticks;
    }
    l->rest_s = speed < 0.05 ? l->rest_s + period : 0.0;
    for (int i = 0; i < d; i++) l->felt[i] += least(period, 1.0) * (l->force[i] - l->felt[i]);
}

/* Envelope._goes_on */
static inline void goes_on(Guard *g, int d, double reason) {
    g->passed = reason, g->passed_value = reason == g->reason ? g->value : NAN;
    g->mode = MODE_RUN, g->reason = REASON_NONE, g->value = NAN, g->passes = 0.0, g->confidence = 0.0;
    forget_pushes(&g->ledger);
    g->ledger.sinks_s = g->ledger.blocked_ns = 0.0;
    fill(g->ledger.wanted, 0.0, d);
}

/* Envelope._feel */
static inline void feel(const Envelope *e, Guard *g, const Seen *seen, double period) {
    Ledger *l = &g->ledger;
    const int d = e->d;
    Axes pull;
    shaken(e, l, period);
    if ((int)g->reason == REASON_LET_GO) miss(e, g, seen, length(l->v, d), period);
    sink(e, g, seen->taught, period);
    pushing(e, l, period);
    if (l->work > e->limits.pushed_j && (int)g->reason != REASON_BLOCKED) hold_for(g, d, REASON_PUSHED, length(l->force, d), INFINITY);
    if (g->feels_s <= 0.0) {
        if (carries_alone(e, g, length(l->v, d), period)) hold_for(g, d, REASON_GONE, NAN, INFINITY);
        return;
    }
    g->feels_s -= period;
    if (g->feels_s > 0.0) return;
    mean_of_last(e->pulls, (int)l->n_pulls, e->swing, d, pull);
    const double near = least(e->limits.alone_n, ALONE_SHARE * load_of(l, d)), now = length(pull, d);
    if (now < near && (apart(pull, g->pulled, d) < ANSWER_N || now < length(g->pulled, d))) {
        hold_for(g, d, REASON_GONE, NAN, INFINITY);
    } else if (length(l->force, d) < 0.5 * load_of(l, d)) {
        g->reason = REASON_BLOCKED, g->value = NAN, g->mistaken += 1.0;
    } else {
        forget_pulls(l);
        g->mistaken += 1.0;
        goes_on(g, d, REASON_GONE);
    }
}

/* Envelope._recover; 1 where the skill is to begin again from where the arm is */
static inline int recovers(const Envelope *e, Guard *g, const Seen *seen, double period) {
    const Limits *limits = &e->limits;
    Ledger *l = &g->ledger;
    const int d = e->d, reason = (int)g->reason;
    const double load = load_of(l, d), still = dot(l->force, g->cause, d) / most(length(g->cause, d), 1e-9);
    const int weighs_something = load > (reason == REASON_GONE || reason == REASON_SINKS ? LIGHT_N : HANGS_N);
    int over = still < least(least(limits->pull_n, g->bound), weighs_something ? 0.5 * load : limits->pull_n);
    double value;
    if (reason == REASON_LET_GO) over = length(l->pull, d) > ANSWERS_N;
    double wait_s = reason == REASON_BLOCKED ? g->wait_s : reason == REASON_LET_GO && l->leads >= 1.0 ? ANSWERS_S : limits->passed_s;
    if ((reason == REASON_SINKS || reason == REASON_GONE) && !over) {
        const double off = fabs(dot(l->force, l->weight, d) / load - load);
        over = off > most(HANGING * load, HANGING_N), wait_s = g->sinks_wait_s;
    }
    g->passed_s = over && g->known != 0.0 && g->feels_s <= 0.0 ? g->passed_s + period : 0.0;
    if (g->passed_s <= wait_s) return 0;
    return !((g->mode == MODE_HOLD && length(l->v, d) > 0.0) || problem_of(e, seen, &value));
}

/* What follows once it has begun again */
static inline void recovered(const Envelope *e, Guard *g) {
    Ledger *l = &g->ledger;
    if (g->mode == MODE_HOLD) {
        copy(l->x, l->at, e->d), copy(l->sent, l->at, e->d);
        start_checker(g, e->d, l->at);
    }
    if ((int)g->reason == REASON_GONE || (int)g->reason == REASON_SINKS) g->sinks_wait_s = least(2.0 * g->sinks_wait_s, LONGEST_WAIT_S);
    if ((int)g->reason == REASON_LET_GO) l->held = l->met = l->missed_s = 0.0, l->mistakes += 1.0;
    forget_pulls(l);
    forget_sinking(l);
    goes_on(g, e->d, g->reason);
}

enum { SKILL_RESTS, SKILL_RESUMES }; /* what `guard_senses` says of the skill: nothing, or to begin again from here */

/* Envelope._step up to what its skill thinks; whether it thinks at all is `thinks`. The period [s] into `period`. */
static inline int guard_senses(const Envelope *e, Guard *g, const Seen *seen, double *period) {
    *period = clocked(e, g, seen->time);
    g->ledger.impact_s -= *period;
    if (g->fresh != 0.0) sensing(e, g, seen, *period);
    g->known = g->fresh != 0.0 && g->known != 0.0;
    book(e, g, *period);
    if (g->fresh == 0.0) return SKILL_RESTS;
    if (g->mode == MODE_RUN) look(e, g, seen, *period);
    else if (g->mode == MODE_COMPLY) feel(e, g, seen, *period);
    return g->mode != MODE_RUN && g->passes != 0.0 && recovers(e, g, seen, *period) ? SKILL_RESUMES : SKILL_RESTS;
}

/* Envelope._think, before the skill; 0 where it is not asked */
static inline int thinks(const Envelope *e, Guard *g, double period) {
    if (g->mode != MODE_RUN || g->fresh == 0.0) return 0;
    const double over = (int)g->passed == REASON_BLOCKED ? e->limits.offer_s : e->limits.fade_s;
    g->confidence = least(1.0, g->confidence + period / over);
    if (g->confidence >= 1.0 && g->passed != 0.0) g->passed = 0.0, g->wait_s = e->limits.passed_s;
    return 1;
}

/* Envelope._heed, of what the skill has put into `wish` */
static inline void heed(const Envelope *e, Guard *g) {
    Ledger *l = &g->ledger;
    const int d = e->d;
    const double share = g->confidence, b = e->limits.comply_damping;
    if (!all_finite(g->wish[1], d) || !all_finite(g->wish[0], d) || !all_finite(g->wish[2], d)) {
        for (int n = 0; n < 3; n++) fill(g->wish[n], 0.0, d);
        fault(g, REASON_POLICY, NAN);
        return;
    }
    for (int i = 0; i < d; i++)
        l->wanted[i] = share < 1.0 ? share * g->wish[1][i] + (1.0 - share) * l->force[i] / b : g->wish[1][i];
}

/* Envelope._clip */
static inline void clip(const Envelope *e, Guard *g, double period, double *velocity) {
    Ledger *l = &g->ledger;
    const int d = e->d;
    copy(l->asked, l->wanted, d);
    l->period = period;
    if (g->mode == MODE_COMPLY) {
        const double b = e->limits.comply_damping * most(l->amplitude / e->limits.shake_n, 1.0);
        for (int i = 0; i < d; i++) l->asked[i] = l->force[i] / b;
    }
    if (g->mode != MODE_HOLD && clipped(e, l, l->asked, velocity)) return;
    const double speed = length(l->v, d), left = speed - e->limits.a_max * period;
    for (int i = 0; i < d; i++) velocity[i] = left > STANDS_M_S ? l->v[i] * (left / speed) : 0.0;
}

/* Envelope._write */
static inline void write_command(const Envelope *e, Guard *g, const double *velocity, int passed, double *const out[3]) {
    const Limits *limits = &e->limits;
    Ledger *l = &g->ledger;
    const double near = limits->v_max * limits->late;
    for (int i = 0; i < e->d; i++) {
        const double v = velocity[i], at = l->at[i];
        double position = l->sent[i] + v * limits->dt;
        if (g->mode != MODE_HOLD) position = passed ? least(most(g->wish[0][i], at - near), at + near) : at + v * limits->dt;
        l->sent[i] = v != 0.0 || g->mode != MODE_HOLD ? within(position, e->low[i], e->high[i]) : position;
        out[0][i] = l->sent[i];
        out[1][i] = v;
        out[2][i] = within(passed ? g->wish[2][i] : 0.0, -limits->a_max, limits->a_max);
    }
    *e->tank = l->energy;
}

/* Envelope._send: the command into `out`, position, velocity and acceleration */
static inline void guard_sends(const Envelope *e, Guard *g, double period, double *const out[3]) {
    static const int RULES[] = {REASON_NONE, REASON_CHECKER_SPEED, REASON_CHECKER_ACCELERATION, REASON_CHECKER_ROOM};
    Ledger *l = &g->ledger;
    const int d = e->d;
    Axes velocity;
    clip(e, g, period, velocity);
    const int verdict = judge(&e->rules, &l->commanded, d, period, velocity, g->late != 0.0);
    if (verdict) fault(g, RULES[verdict], NAN);
    int passed = g->mode == MODE_RUN && g->fresh != 0.0;
    for (int i = 0; i < d; i++) passed &= velocity[i] == g->wish[1][i];
    for (int i = 0; i < d && period > 0.0; i++) l->rate[i] = (velocity[i] - l->v[i]) / period;
    copy(l->v, velocity, d);
    write_command(e, g, velocity, passed, out);
}

/* Envelope.rearm, but for the skill; 0: it may begin, else why not */
static inline int rearms(const Envelope *e, Guard *g, const Seen *seen, double *value) {
    Ledger *l = &g->ledger;
    const int d = e->d;
    int problem = problem_of(e, seen, value), still = (int)g->reason == REASON_STUCK;
    const double measured = problem ? 0.0 : measured_speed(seen->velocity, d), fastest = length(l->v, d);
    if (measured > e->limits.rest || fastest > (g->mode == MODE_RUN ? e->limits.moving : 0.0)) {
        *value = most(measured, fastest);
        return REASON_IN_MOTION;
    }
    if (problem) return problem;
    if (length(seen->force, d) > e->limits.pull_n) {
        *value = length(seen->force, d);
        return REASON_PULLED;
    }
    for (int i = 0; i < d; i++) still &= l->reading[i] == seen->sensed[i];
    return still ? REASON_STUCK_STILL : REASON_NONE;
}
