/* The ordinary tick of safety/envelope.py: in RUN, on a fresh, timely and plausible sample, with nothing to say about it.
 *
 * Two steps, around the skill's own. Each does all that the Python does there, in the same order and to the same bits, or gives 0 and
 * leaves everything untouched: then the Python, the one source of every reason, takes the tick. In doubt a tick is not ordinary.
 */

typedef struct { /* Envelope.LIMITS, and what follows from them */
    double v_max, a_max, force_limit, energy, stuck_s, moving, position_jump, drift, blocked_n, blocked_s, alone_n, alone_s, sudden_s,
        steady_n_s, stands, let_go_n, let_go_s, held_n, let_go_speed, tare_n, jump_n, jump_rest_s, dt, late;
} Limits;

typedef double Axes[MOST_AXES];

typedef struct { /* Envelope.SCALARS, then Envelope.VECTORS, then the two memories of LetGo */
    double period, time, stamp, age, elapsed, impact_s, blocked_ns, alone_s, rest_s, felt, held, for_s, since_s, heard_s, still_s, slow, mean,
        amplitude, weighed, n_pulls, n_before;
    Axes x, sent, at, v, force, wanted, asked, raw, same_s, energy, rate, weight, sensed, usual;
    Commanded commanded;
} Ledger;

typedef struct {
    int d, most_pulls, most_before;
    Limits limits;
    Rules rules;
    Axes low, high;
    Ledger *now;          /* in Python's array, and behind it: */
    double *pulls, *before; /* [most_pulls][d], [most_before][d], oldest first */
    double *tank;
} Envelope;

#define WEIGHED_TICKS 25
#define SWING_S 0.1 /* and SLOW_SWING_S is most_pulls */
#define QUIET_S 0.5
#define GRAVITY 9.80665

static void remember(double *rows, double *n, int most_rows, int d, const double *row) {
    if (*n == most_rows) memmove(rows, rows + d, sizeof(double) * d * (most_rows - 1));
    else *n += 1.0;
    memcpy(rows + ((int)*n - 1) * d, row, sizeof(double) * d);
}

/* Envelope._clock */
static int timely(const Envelope *e, Ledger *l, double t) {
    const double step = t - l->stamp, period = most(t - l->time, 0.0);
    if (!isfinite(t) || step < 0.1 * e->limits.dt || period > e->limits.late + 1e-9) return 0;
    l->elapsed = step;
    l->time = most(t, l->time);
    l->stamp = t;
    l->age = 0.0;
    l->period = period;
    l->impact_s -= period;
    return l->impact_s <= 0.0;
}

/* Envelope._sense, one axis */
static int plausible(const Envelope *e, Ledger *l, int i, double x, double f, double velocity, double sensed) {
    const Limits *limits = &e->limits;
    if (!(fabs(x) < ABSURD) || !(fabs(f) < ABSURD)) return 0;
    if (fabs(x - l->at[i]) > limits->position_jump + 2.0 * limits->v_max * l->elapsed) return 0;
    if (fabs(f) > limits->force_limit || fabs(velocity) > 10.0 * limits->v_max) return 0; /* NaN is a velocity nobody measures */
    const double reading = isfinite(sensed) ? sensed : f;
    l->same_s[i] = reading == l->raw[i] && fabs(l->v[i]) > limits->moving ? l->same_s[i] + l->period : 0.0;
    l->raw[i] = reading;
    l->at[i] = x;
    l->force[i] = f;
    return !(l->same_s[i] > limits->stuck_s + 1e-9);
}

/* Jump.step, while none is pending */
static int steady_zero(const Envelope *e, Ledger *l, const double *sensed, int at_rest) {
    const int known = all_finite(sensed, e->d) && all_finite(l->sensed, e->d);
    if (known) l->heard_s = least(l->heard_s + l->period, most(QUIET_S, l->period));
    const double share = l->period > 0.0 ? l->period / l->heard_s : 0.0;
    for (int i = 0; known && i < e->d; i++) {
        const double change = fabs(sensed[i] - l->sensed[i]);
        if (l->still_s > e->limits.jump_rest_s && change > e->limits.jump_n + 6.0 * l->usual[i]) return 0;
        l->usual[i] += share * (change - l->usual[i]);
    }
    if (known) l->still_s = at_rest ? l->still_s + l->period : 0.0;
    memcpy(l->sensed, sensed, sizeof(double) * e->d);
    return 1;
}

/* Envelope._book */
static int follows(const Envelope *e, Ledger *l) {
    for (int i = 0; i < e->d; i++) {
        const double way = l->v[i] * l->period, gain = l->force[i] * way;
        l->x[i] += way;
        l->energy[i] = least(e->limits.energy, most(0.0, l->energy[i] + gain));
        if (fabs(l->x[i] - l->at[i]) > e->limits.drift) return 0;
    }
    return 1;
}

/* LetGo.step with `pull` as its newest; `mean` is that of the last ones when there are enough, and then `measured`. */
static int partner_holds(const Envelope *e, Ledger *l, double speed, const double *pull, double *mean, int *measured) {
    const Limits *limits = &e->limits;
    const int swing = (int)most(nearbyint(SWING_S / limits->dt), 1.0);
    Axes slow;
    const int d = e->d, n = (int)l->n_pulls, full = n == e->most_pulls;
    const double load = length(l->weight, d);
    int alone = 0;
    *measured = l->weighed >= WEIGHED_TICKS && load > limits->held_n && n + !full == e->most_pulls;
    if (*measured) {
        const double *first = l->n_before == e->most_before ? e->before + (e->most_before > 1 ? d : 0) : e->before;
        const int back = (int)least(most(nearbyint(SWING_S / 2.0 / limits->dt), 1.0), least(l->n_before, e->most_before - 1.0));
        const double *earlier = e->before + ((int)l->n_before - back) * d;
        double lost = 0.0, changed = 0.0;
        for (int i = 0; i < d; i++) {
            double sum = 0.0, all = 0.0;
            for (int row = n - swing + 1; row < n; row++) sum += e->pulls[row * d + i];
            for (int row = full; row < n; row++) all += e->pulls[row * d + i];
            mean[i] = (sum + pull[i]) / swing;
            slow[i] = (all + pull[i]) / e->most_pulls;
            const double before = l->n_before == 0.0 || e->most_before == 1 ? mean[i] : first[i];
            lost += (before - mean[i]) * (before - mean[i]);
            changed += back ? (earlier[i] - mean[i]) * (earlier[i] - mean[i]) : 0.0;
        }
        l->since_s = sqrt(lost) > 0.5 * load ? 0.0 : l->since_s + l->period;
        const int moves = speed > limits->stands, steady = sqrt(changed) < SWING_S / 2.0 * limits->steady_n_s;
        const int sudden = l->for_s > 0.0 || l->since_s < 4.0 * limits->sudden_s;
        const int nobody = length(mean, d) < limits->alone_n && (moves || steady);
        alone = sudden && (nobody || (length(slow, d) < limits->alone_n && moves));
    }
    l->for_s = alone ? l->for_s + l->period : 0.0;
    return !(l->for_s > limits->alone_s);
}

/* Envelope._look, but for LetGo */
static int unremarkable(const Envelope *e, Ledger *l) {
    const Limits *limits = &e->limits;
    const double speed = length(l->v, e->d), size = length(l->force, e->d), period = l->period;
    const double against = -dot(l->force, l->v, e->d) / most(speed, 1e-6);
    l->blocked_ns = against > limits->blocked_n ? l->blocked_ns + against * period : 0.0;
    l->held = (speed >= limits->moving && l->held != 0.0) || size > limits->held_n;
    l->alone_s = l->held != 0.0 && size < limits->let_go_n && speed > limits->let_go_speed ? l->alone_s + period : 0.0;
    double signed_force = l->force[0];
    for (int i = 1; i < e->d; i++)
        if (fabs(l->force[i]) > fabs(signed_force)) signed_force = l->force[i];
    l->slow += (1.0 - exp(-2.0 * PI * period)) * (signed_force - l->slow);
    l->mean += least(period / 0.5, 1.0) * (fabs(signed_force - l->slow) - l->mean);
    l->amplitude = 1.57 * l->mean;
    l->rest_s = speed < 0.05 ? l->rest_s + period : 0.0;
    l->felt += least(period, 1.0) * (signed_force - l->felt);
    return !(l->blocked_ns > limits->blocked_n * limits->blocked_s) && !(l->alone_s > limits->let_go_s);
}

/* All that comes before the skill. */
static int sense(Envelope *e, double t, const double *x, const double *f, const double *velocity, const double *raw) {
    const int d = e->d;
    Ledger next = *e->now;
    Axes pull, mean, sensed;
    for (int i = 0; i < d; i++) sensed[i] = fabs(raw[i]) < ABSURD ? raw[i] : NAN;
    int measured, weighed = next.weighed >= WEIGHED_TICKS;
    if (!timely(e, &next, t)) return 0;
    for (int i = 0; i < d; i++)
        if (!plausible(e, &next, i, x[i], f[i], velocity[i], sensed[i])) return 0;
    const int at_rest = largest(next.v, d) < e->limits.moving;
    if (!weighed && at_rest && largest(f, d) < e->limits.tare_n && all_finite(sensed, d)) return 0; /* to be weighed */
    for (int i = 0; i < d; i++) pull[i] = f[i] - next.weight[i] * (1.0 + next.rate[i] / GRAVITY);
    if (!steady_zero(e, &next, sensed, at_rest) || !follows(e, &next)) return 0;
    if (!partner_holds(e, &next, length(next.v, d), pull, mean, &measured) || !unremarkable(e, &next)) return 0;
    if (weighed) remember(e->pulls, &next.n_pulls, e->most_pulls, d, pull);
    if (measured) remember(e->before, &next.n_before, e->most_before, d, mean);
    *e->now = next;
    return 1;
}

static double cap(const Limits *limits, double room) {
    const double a = limits->a_max;
    return room > 0.0 ? most(0.0, sqrt(2.0 * a * room) - 0.5 * a * limits->late) : 0.0;
}

/* All that comes after it: Envelope._clip, the checker's judgement, Envelope._write. `wish` and `out` are position, velocity,
 * acceleration. */
static int act(Envelope *e, const double *const wish[3], double *const out[3]) {
    const Limits *limits = &e->limits;
    const int d = e->d;
    Ledger *l = e->now;
    const double change = limits->a_max * l->period, near = limits->v_max * limits->late;
    Axes velocity;
    int passed = 1;
    for (int n = 0; n < 3; n++)
        if (!all_finite(wish[n], d)) return 0;
    for (int i = 0; i < d; i++) {
        const double x = l->x[i], at = l->at[i], tank = l->energy[i] / limits->force_limit, asked = wish[1][i];
        const double up = least(limits->v_max, cap(limits, least(e->high[i] - most(x, at), tank)));
        const double down = least(limits->v_max, cap(limits, least(least(x, at) - e->low[i], tank)));
        velocity[i] = within(within(asked, -down, up), l->v[i] - change, l->v[i] + change);
        passed &= velocity[i] == asked;
    }
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
        e->tank[i] = l->energy[i];
    }
    return 1;
}
