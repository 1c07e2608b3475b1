/* The ordinary tick of safety/envelope.py, as the gym's many runs take it: in RUN, on a fresh, timely and plausible sample, with nothing
 * to say about it. Two steps, around the skill's own. Each does all that _guard.h does there, in the same order and to the same bits,
 * or gives 0 and leaves everything untouched. In doubt a tick is not ordinary.
 */

/* Nothing is under way that only _guard.h knows. */
static inline int nothing_is_up(const Guard *g) {
    return g->mode == MODE_RUN && g->confidence >= 1.0 && g->passed == 0.0 && g->first == 0.0 && g->ticks >= 5.0 && g->pending == 0.0 &&
           g->mistaken == 0.0;
}

/* Envelope._clock */
static inline int timely(const Envelope *e, Ledger *l, double t) {
    const double step = t - l->stamp, period = most(t - l->time, 0.0);
    if (!is_finite(t) || step < SAME_SAMPLE * e->limits.dt || period > e->limits.late + 1e-9) return 0;
    l->elapsed = step;
    l->time = most(t, l->time);
    l->stamp = t;
    l->age = 0.0;
    l->period = period;
    l->impact_s -= period;
    return l->impact_s <= 0.0;
}

/* Envelope._sense, but for what it watches */
static inline int plausible(const Envelope *e, Ledger *l, const double *x, const double *f, const double *velocity) {
    const Limits *limits = &e->limits;
    double speed = 0.0;
    for (int i = 0; i < e->d; i++) {
        if (!(fabs(x[i]) < ABSURD) || !(fabs(f[i]) < ABSURD)) return 0;
        if (velocity[i] == velocity[i]) speed += velocity[i] * velocity[i]; /* NaN is a velocity nobody measures */
    }
    if (apart(x, l->at, e->d) > limits->position_jump + 2.0 * limits->v_max * l->elapsed) return 0;
    if (length(f, e->d) > limits->force_limit || sqrt(speed) > 10.0 * limits->v_max) return 0;
    copy(l->at, x, e->d);
    copy(l->force, f, e->d);
    return 1;
}

/* Jump.step, while none is pending */
static inline int steady_zero(const Envelope *e, Ledger *l, const double *sensed, int at_rest) {
    if (!all_finite(sensed, e->d)) return 1;
    if (!all_finite(l->sensed, e->d)) {
        copy(l->sensed, sensed, e->d);
        return 1;
    }
    const double still = l->still_s, change = apart(sensed, l->sensed, e->d);
    l->still_s = at_rest ? l->still_s + l->period : 0.0;
    if (change == 0.0) return 1;
    copy(l->sensed, sensed, e->d);
    l->heard_s = least(l->heard_s + l->period, most(QUIET_S, l->period));
    if (still > e->limits.jump_rest_s && change > e->limits.jump_n + 6.0 * l->jump_usual) return 0;
    const double share = l->period > 0.0 ? l->period / l->heard_s : 0.0;
    l->jump_usual += share * (change - l->jump_usual);
    return 1;
}

/* Envelope._book */
static inline int follows(const Envelope *e, Ledger *l) {
    Axes way;
    for (int i = 0; i < e->d; i++) way[i] = l->v[i] * l->period, l->x[i] += way[i];
    l->energy = least(e->limits.energy, most(0.0, l->energy + dot(l->force, way, e->d)));
    return !(apart(l->x, l->at, e->d) > e->limits.drift);
}

/* LetGo.step with `pull` as its newest; `mean` is that of the last ones when there are enough, and then `measured`. */
static inline int partner_holds(const Envelope *e, Ledger *l, double speed, const double *pull, double *mean, int *measured) {
    const Limits *limits = &e->limits;
    const int swing = e->swing, d = e->d, n = (int)l->n_pulls, full = n == e->most_pulls;
    const double load = load_of(l, d);
    Axes slow;
    int alone = 0;
    *measured = load > HANGS_N && n + !full == e->most_pulls;
    if (*measured) {
        const double *first = l->n_before == e->most_before ? e->before + (e->most_before > 1 ? d : 0) : e->before;
        for (int i = 0; i < d; i++) {
            double sum = 0.0, all = 0.0;
            for (int row = n - swing + 1; row < n; row++) sum += e->pulls[row * d + i];
            for (int row = full; row < n; row++) all += e->pulls[row * d + i];
            mean[i] = (sum + pull[i]) / swing;
            slow[i] = (all + pull[i]) / e->most_pulls;
        }
        if (l->n_before == 0.0 || e->most_before == 1) first = mean;
        const double near = least(limits->alone_n, ALONE_SHARE * load);
        const int moves = speed > limits->stands, still = apart(first, mean, d) < STILL_S * limits->steady_n_s;
        alone = (length(mean, d) < near && still) || (length(slow, d) < near && moves && still);
    }
    l->for_s = alone ? l->for_s + l->period : 0.0;
    return !(l->for_s > limits->alone_s);
}

/* Envelope._press, _miss and what is left of _look */
static inline int unremarkable(const Envelope *e, Ledger *l, const double *sensed, double speed) {
    const Limits *limits = &e->limits;
    const int d = e->d;
    const double period = l->period;
    const double against = -dot(l->force, l->v, d) / most(speed, 1e-6);
    l->blocked_ns = against > limits->blocked_n ? l->blocked_ns + against * period : 0.0;
    const int gone = load_of(l, d) <= LIGHT_N && missed(e, l, sensed, speed, period);
    shaken(e, l, period);
    for (int i = 0; i < d; i++) l->felt[i] += least(period, 1.0) * (l->force[i] - l->felt[i]);
    l->rest_s = speed < 0.05 ? l->rest_s + period : 0.0;
    return !(l->blocked_ns > limits->blocked_n * limits->blocked_s) && !gone;
}

/* All that comes before the skill. */
static inline int sense(Envelope *e, double t, const double *x, const double *f, const double *velocity, const double *raw,
                 const double *taught) {
    const int d = e->d;
    Ledger next = *e->now;
    Axes pull, mean, sensed;
    for (int i = 0; i < d; i++) sensed[i] = fabs(raw[i]) < ABSURD ? raw[i] : NAN;
    const double speed = length(next.v, d);
    int measured, weighed = next.weighed >= WEIGHED_TICKS;
    if (!timely(e, &next, t) || !plausible(e, &next, x, f, velocity)) return 0;
    if (stands_still(e, &next, sensed, next.force, speed, next.period)) return 0;
    const int at_rest = speed < e->limits.moving;
    if (!weighed && at_rest && length(f, d) < e->limits.tare_n && all_finite(sensed, d)) return 0; /* to be weighed */
    for (int i = 0; i < d; i++) pull[i] = f[i] - next.weight[i] * (1.0 + next.rate[i] / GRAVITY);
    if (!steady_zero(e, &next, sensed, at_rest) || !follows(e, &next)) return 0;
    dragging(&next, d, next.period);
    if (!partner_holds(e, &next, speed, pull, mean, &measured) || sinks(e, &next, taught, next.period)) return 0;
    pushing(e, &next, next.period);
    if (next.work > e->limits.pushed_j) return 0;
    if (!unremarkable(e, &next, sensed, speed)) return 0;
    if (weighed) remember(e->pulls, &next.n_pulls, e->most_pulls, d, pull);
    if (measured) remember(e->before, &next.n_before, e->most_before, d, mean);
    *e->now = next;
    return 1;
}

/* The checker's word on `velocity` after a timely period: 1, with `c` moved on, where it breaks no rule */
static int allowed(const Rules *r, Commanded *c, int d, double period, const double *velocity) {
    Commanded next = *c;
    Axes v;
    copy(v, velocity, d);
    if (judge(r, &next, d, period, v, 0)) return 0;
    *c = next;
    return 1;
}

/* All that comes after it: Envelope._clip, the checker's judgement, Envelope._write. `wish` and `out` are position, velocity,
 * acceleration. */
static inline int act(Envelope *e, const double *const wish[3], double *const out[3]) {
    const Limits *limits = &e->limits;
    const int d = e->d;
    Ledger *l = e->now;
    const double near = limits->v_max * limits->late;
    Axes velocity;
    int passed = 1;
    for (int n = 0; n < 3; n++)
        if (!all_finite(wish[n], d)) return 0;
    if (!clipped(e, l, wish[1], velocity)) return 0;
    for (int i = 0; i < d; i++) passed &= velocity[i] == wish[1][i];
    if (!allowed(&e->rules, &l->commanded, d, l->period, velocity)) return 0;
    for (int i = 0; i < d; i++) {
        const double v = velocity[i], at = l->at[i];
        const double position = passed ? within(wish[0][i], at - near, at + near) : at + v * limits->dt;
        if (l->period > 0.0) l->rate[i] = (v - l->v[i]) / l->period;
        l->wanted[i] = l->asked[i] = wish[1][i];
        l->v[i] = v;
        out[0][i] = l->sent[i] = within(position, e->low[i], e->high[i]);
        out[1][i] = v;
        out[2][i] = within(passed ? wish[2][i] : 0.0, -limits->a_max, limits->a_max);
    }
    e->tank[0] = l->energy;
    return 1;
}
