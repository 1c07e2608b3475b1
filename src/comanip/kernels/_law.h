/* One tick of the default law, for the classes of skills/collaborate.py and skills/roles.py that share their arrays with it.
 *
 * The same operations in the same order as there, so that the numbers are the same to the last bit: nothing may be contracted.
 * A tick that is not plain (something missing, an array of another kind, a change of role) gives 0 and leaves all untouched.
 */

typedef struct { /* CollaborativeLaw, in the order of its fields */
    double mass, moving_damping, resting_damping, moving_speed, dead_zone, anticipation, anticipation_s, attraction, start_delay,
        comfortable, yield_gain, slowest_clock, patience, reach, max_acceleration, shake_hz, shake_n, shake_damping, shake_memory, shake_growth,
        lead_s;
} Numbers;

typedef struct { /* of RolePolicy: roles.SHARED */
    double insist_n, insist_ns_per_m, ahead_n, insist_s, held_m_per_s, resting_n, resting_m_per_s, start_patience_s, midway_patience_s,
        finished_m, held_s;
} Policy;

typedef struct { /* RoleEvidence */
    int n, strengths; /* filters, and how many of them are one role */
    Tick **filters;
    const double *prior, *centre, *spread, *numbers;
    double *p, *probabilities, *until;
    double *seen, *said; /* room for one tick */
} Bank;

enum { BANK_DT, BANK_CHANGE, BANK_MEMORY, BANK_GATE };

typedef struct {
    int d, rows;
    double dt, model_dt, step_s, duration_s, top_speed, pull_share, bias_share, keep_shake;
    Numbers law, following;
    Policy policy;
    Bank bank;
    const double *task; /* RoleSkill._task: where lessons end, and the direction */
    const double *path, *velocity_table, *force_table; /* PhaseReference, (rows, d) each */
    double *compliance, *slow, *shake, *went_on;       /* Compliance.memory */
    double *expected, *wanted, *hold, *clock;          /* Pace.memory; clock: phase, rate, resistance */
    double *shown_expected, *velocity, *position, *start, *reference, *pull, *bias, *shown_clock, *rest_s, *moved,
        *against_s, *held_s;                           /* of the skill */
    double *until, *seen;                              /* of Watch */
    Tick *filter;
    const Level *level;
} Law;

enum { PHASE, RATE, RESISTANCE };
#define ABSURD 1e6 /* no robot is so far away, so fast or so strong, in any unit */

static double least(double a, double b) { return b < a ? b : a; }
static double most(double a, double b) { return b > a ? b : a; }
static double within(double x, double low, double high) { return least(most(x, low), high); }

static double dot(const double *a, const double *b, int d) {
    double sum = 0.0;
    for (int i = 0; i < d; i++) sum += a[i] * b[i];
    return sum;
}

static double length(const double *a, int d) { return sqrt(dot(a, a, d)); }

static double largest(const double *a, int d) {
    double top = 0.0;
    for (int i = 0; i < d; i++) top = most(top, fabs(a[i]));
    return top;
}

static int all_finite(const double *a, int d) {
    for (int i = 0; i < d; i++)
        if (!isfinite(a[i])) return 0;
    return 1;
}

/* PhaseReference.floats_at */
static void row_at(const Law *l, const double *table, double phase, double *out) {
    const int d = l->d;
    const double place = within(phase / l->step_s, 0.0, (double)(l->rows - 1));
    const int n = (int)place < l->rows - 2 ? (int)place : l->rows - 2;
    const double share = place - n;
    for (int i = 0; i < d; i++) out[i] = (1.0 - share) * table[n * d + i] + share * table[(n + 1) * d + i];
}

/* PhaseReference.closest, within 0.15 s */
static double closest(const Law *l, const double *position, double near) {
    const int d = l->d;
    int low = (int)most((near - 0.15) / l->step_s, 0.0);
    int high = (int)least((near + 0.15) / l->step_s, (double)l->rows) + 2;
    if (high > l->rows) high = l->rows;
    if (low > high - 1) low = high - 1;
    int best = low;
    double smallest = INFINITY;
    for (int n = low; n < high; n++) {
        double apart = 0.0;
        for (int i = 0; i < d; i++) {
            const double off = l->path[n * d + i] - position[i];
            apart += off * off;
        }
        if (apart < smallest) smallest = apart, best = n;
    }
    return best * l->step_s;
}

/* Pace.step */
static void pace(Law *l, const double *x, const double *force) {
    const Numbers *law = &l->law;
    const int d = l->d;
    const double s = l->clock[PHASE];
    const int begun = s >= 0.0, moving = begun && s < l->duration_s;
    double target[MOST_AXES], taught[MOST_AXES] = {0}, felt[MOST_AXES] = {0}, error[MOST_AXES];
    if (begun) row_at(l, l->path, s, target), row_at(l, l->force_table, s, felt);
    else memcpy(target, l->hold, sizeof(double) * d);
    if (moving) row_at(l, l->velocity_table, s, taught);
    const double speed = length(taught, d), along = speed > 1e-6 ? dot(force, taught, d) / speed : 0.0;
    const double excess = least(along + law->comfortable, 0.0);
    l->clock[RESISTANCE] += least(l->dt / law->patience, 1.0) * (excess - l->clock[RESISTANCE]);
    const double rate = moving ? most(1.0 + law->yield_gain * l->clock[RESISTANCE], law->slowest_clock) : 1.0;
    l->clock[RATE] = rate;
    l->clock[PHASE] = least(s + l->dt * rate, l->duration_s);
    for (int i = 0; i < d; i++) error[i] = target[i] - x[i];
    const double asked = length(error, d) * law->attraction, share = asked > 1e-9 ? least(1.0, l->top_speed / asked) : 1.0;
    for (int i = 0; i < d; i++) {
        l->expected[i] = rate * felt[i];
        l->wanted[i] = rate * taught[i] + law->attraction * (error[i] * share);
    }
}

/* CollaborativeSkill._anticipate */
static void anticipate(Law *l, const double *x, const double *force, double *foreseen) {
    const Numbers *law = &l->law;
    const int d = l->d;
    double taught[MOST_AXES], now[MOST_AXES], ahead[MOST_AXES], heading[MOST_AXES];
    for (int i = 0; i < d; i++) taught[i] = x[i] - l->start[i] + l->path[i], foreseen[i] = 0.0;
    const double before = l->shown_clock[PHASE], s = closest(l, taught, before), speed = length(l->compliance, d);
    l->shown_clock[RATE] = (s - before) / l->dt;
    l->shown_clock[PHASE] = s;
    if (speed < 0.02) return;
    row_at(l, l->velocity_table, s, now);
    const double usual = most(length(now, d), 0.03);
    row_at(l, l->velocity_table, s + law->anticipation_s * least(speed / usual, 2.0), ahead);
    for (int i = 0; i < d; i++) heading[i] = l->compliance[i] / speed;
    double agreement = within((dot(force, heading, d) + 1.0) / 2.0, 0.0, 1.0);
    agreement *= least(speed / law->moving_speed, 1.0);
    const double scale = least(speed / usual, 1.5);
    for (int i = 0; i < d; i++)
        foreseen[i] = law->anticipation * agreement * within((ahead[i] - now[i]) / law->anticipation_s * scale, -1.0, 1.0);
}

/* Compliance.step */
static void comply(Law *l, const Numbers *law, const double *excess, const double *reference, const double *feedforward) {
    const int d = l->d;
    const double keep_slow = 1.0 - exp(-2.0 * PI * law->shake_hz * l->dt);
    const double speed = most(largest(l->compliance, d), largest(reference, d)), rest = 1.0 - least(speed / law->moving_speed, 1.0);
    double damping = law->moving_damping + rest * rest * (law->resting_damping - law->moving_damping), fast = 0.0;
    for (int i = 0; i < d; i++) {
        l->slow[i] += keep_slow * (excess[i] - l->slow[i]);
        fast = most(fast, fabs(excess[i] - l->slow[i]));
    }
    *l->shake += l->keep_shake * (fast - *l->shake);
    const double amplitude = most(1.57 * *l->shake - law->shake_n, 0.0);
    *l->went_on += l->dt * (law->shake_growth * amplitude - *l->went_on / law->shake_memory);
    damping += law->shake_damping * (amplitude + *l->went_on);
    const double dead = law->dead_zone * rest, share = l->dt / law->mass;
    for (int i = 0; i < d; i++) {
        const double push = copysign(most(fabs(excess[i]) - dead, 0.0), excess[i]);
        l->compliance[i] = (l->compliance[i] + share * push + l->dt * feedforward[i]) / (1.0 + share * damping);
    }
}

/* command_velocity; `out` is position, velocity, acceleration. */
static void send(Law *l, const Numbers *law, const double *x, const double *reference, double *const out[3]) {
    const double limit = law->max_acceleration * l->dt, lead = law->lead_s / l->dt;
    for (int i = 0; i < l->d; i++) {
        const double change = within(reference[i] + l->compliance[i] - l->velocity[i], -limit, limit), v = l->velocity[i] + change;
        l->velocity[i] = v;
        out[1][i] = v + lead * change;
        out[0][i] = x[i] + l->dt * v;
        out[2][i] = change / l->dt;
    }
}

/* Watch.step, at most one step of the filter; 0 where the filter leaves it to its twin. */
static int watch(Law *l, const double *x, const double *force) {
    const int due = *l->until <= 1e-9;
    if (due) {
        if (*l->until + l->model_dt <= 1e-9) return 0;
        memcpy(l->seen, x, sizeof(double) * l->d);
        if (l->filter->D > l->d) memcpy(l->seen + l->d, force, sizeof(double) * l->d);
        if (!l->level->tick(l->filter, l->seen)) return 0;
    }
    *l->until = (due ? *l->until + l->model_dt : *l->until) - l->dt;
    return 1;
}

/* CollaborativeSkill.step */
static int follow(Law *l, const double *x, const double *force, double *const out[3], int anticipates) {
    const double nothing[MOST_AXES] = {0};
    double foreseen[MOST_AXES] = {0}, excess[MOST_AXES];
    if (!watch(l, x, force)) return 0;
    memcpy(l->position, x, sizeof(double) * l->d);
    if (anticipates) anticipate(l, x, force, foreseen);
    for (int i = 0; i < l->d; i++) excess[i] = force[i] - l->shown_expected[i];
    comply(l, &l->law, excess, nothing, foreseen);
    send(l, &l->law, x, nothing, out);
    return 1;
}

/* CollaborativeSkill._lead, and what follows it */
static void lead_there(Law *l, const double *x, const double *force, double *const out[3]) {
    const double nothing[MOST_AXES] = {0};
    double excess[MOST_AXES];
    memcpy(l->position, x, sizeof(double) * l->d);
    pace(l, x, force);
    memcpy(l->shown_clock, l->clock, sizeof(double) * 2);
    memcpy(l->shown_expected, l->expected, sizeof(double) * l->d);
    for (int i = 0; i < l->d; i++) excess[i] = force[i] - l->expected[i];
    comply(l, &l->law, excess, l->wanted, nothing);
    send(l, &l->law, x, l->wanted, out);
}

static int lead(Law *l, const double *x, const double *force, double *const out[3]) {
    if (!watch(l, x, force)) return 0;
    lead_there(l, x, force, out);
    return 1;
}

/* RoleEvidence.step. Its filters, with a floor under every transition, leave nothing that is finite to their twins. */
static void hear(Law *l, const double *x, const double *felt) {
    Bank *b = &l->bank;
    const int d = l->d;
    const double change = b->numbers[BANK_CHANGE];
    double neither = 0.0, total = 0.0;
    *b->until -= l->dt;
    if (*b->until > 1e-9) return;
    *b->until += b->numbers[BANK_DT];
    for (int i = 0; i < d; i++) b->seen[i] = x[i], b->seen[d + i] = felt[i] - l->bias[i], b->seen[2 * d + i] = l->velocity[i];
    for (int i = 0; i < 3 * d; i++) {
        const double off = (b->seen[i] - b->centre[i]) / b->spread[i];
        neither -= 0.5 * off * off + log(2.5066 * b->spread[i]);
    }
    double best = b->said[b->n] = neither;
    for (int i = 0; i < b->n; i++) {
        l->level->tick(b->filters[i], b->seen);
        best = most(best, b->said[i] = b->filters[i]->state[LAST_LOG_LIKELIHOOD]);
    }
    for (int i = 0; i <= b->n; i++) {
        const double told = most(b->said[i] - best, -b->numbers[BANK_GATE]) * b->numbers[BANK_MEMORY];
        b->p[i] = ((1.0 - change) * b->p[i] + change * b->prior[i]) * exp(told);
        total += b->p[i];
    }
    for (int i = 0; i <= b->n; i++) b->p[i] /= total;
    for (int i = 0; i <= b->n; i += b->strengths) {
        double role = 0.0;
        for (int j = i; j < i + b->strengths && j <= b->n; j++) role += b->p[j];
        b->probabilities[i / b->strengths] = role;
    }
}

/* Watch and RoleEvidence; 0, with neither done, for what must count as missing. */
static int attend(Law *l, const double *x, const double *felt) {
    for (int i = 0; i < l->d && l->bank.n; i++)
        if (!(fabs(x[i]) < ABSURD && fabs(felt[i] - l->bias[i]) < ABSURD)) return 0;
    if (!watch(l, x, felt)) return 0;
    if (l->bank.n) hear(l, x, felt);
    return 1;
}

/* RoleSkill.step while it leads and means it; the tick at which it gives way, `_give_way_if_he_insists`, is left to it. */
static int lead_on(Law *l, const double *x, const double *felt, double *const out[3]) {
    const Policy *than = &l->policy;
    const int d = l->d;
    double force[MOST_AXES], pull[MOST_AXES];
    for (int i = 0; i < d; i++) {
        force[i] = felt[i] - l->bias[i];
        pull[i] = l->pull[i] + l->pull_share * (force[i] - l->pull[i]);
    }
    const double along = dot(pull, l->wanted, d) / most(length(l->wanted, d), 1e-3), speed = length(l->velocity, d);
    const int against = -along > than->insist_n + than->insist_ns_per_m * speed || along > than->ahead_n;
    const int held = l->clock[PHASE] > than->insist_s && speed < than->held_m_per_s && length(pull, d) > than->resting_n;
    const double against_s = against ? *l->against_s + l->dt : 0.0, held_s = most(*l->held_s + (held ? l->dt : -l->dt), 0.0);
    if (against_s >= than->insist_s || held_s >= than->held_s || !attend(l, x, felt)) return 0;
    lead_there(l, x, force, out);
    *l->against_s = against_s, *l->held_s = held_s;
    memcpy(l->pull, pull, sizeof(double) * d);
    memcpy(l->reference, l->wanted, sizeof(double) * d);
    return 1;
}

/* RoleSkill.step while it follows, and it is too early to ask whether anybody leads. */
static int follow_on(Law *l, const double *x, const double *felt, double *const out[3]) {
    const Policy *policy = &l->policy;
    const double nothing[MOST_AXES] = {0};
    const int d = l->d;
    double force[MOST_AXES], pull[MOST_AXES], way[MOST_AXES];
    for (int i = 0; i < d; i++) {
        force[i] = felt[i] - l->bias[i];
        pull[i] = l->pull[i] + l->pull_share * (force[i] - l->pull[i]);
        way[i] = x[i] - l->start[i];
    }
    const int resting = length(l->velocity, d) < policy->resting_m_per_s && length(pull, d) < policy->resting_n;
    const int moved = *l->moved != 0.0 || length(way, d) > 0.02;
    const double rest_s = resting ? *l->rest_s + l->dt : 0.0;
    for (int i = 0; i < d; i++) way[i] = l->task[i] - x[i];
    const int patient = rest_s < (moved ? policy->midway_patience_s : policy->start_patience_s);
    if (!(patient || dot(way, l->task + d, d) <= policy->finished_m) || !attend(l, x, felt)) return 0;
    memcpy(l->position, x, sizeof(double) * d);
    memcpy(l->pull, pull, sizeof(double) * d);
    *l->rest_s = rest_s, *l->moved = moved;
    for (int i = 0; i < d; i++) {
        if (resting && !moved) l->bias[i] += l->bias_share * pull[i];
        force[i] -= l->shown_expected[i];
    }
    comply(l, &l->following, force, nothing, nothing);
    send(l, &l->following, x, nothing, out);
    return 1;
}
