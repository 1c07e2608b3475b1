/* One tick of the default law, for the classes of skills/collaborate.py and skills/roles.py that share their arrays with it.
 *
 * The same operations in the same order as there, so that the numbers are the same to the last bit: nothing may be contracted.
 * A tick that is not plain (something missing, an array of another kind, a change of role) gives 0 and leaves all untouched.
 */

#define LAW(X) \
    X(mass, virtual_mass_kg) X(moving_damping, moving_damping_ns_per_m) X(resting_damping, resting_damping_ns_per_m) \
    X(untaught_damping, untaught_damping_ns_per_m) X(moving_speed, moving_speed_m_per_s) X(dead_zone, dead_zone_n) X(anticipation, anticipation) \
    X(anticipation_s, anticipation_s) X(foresight, foresight) X(attraction, attraction_per_s) X(start_delay, start_delay_s) \
    X(comfortable, comfortable_n) X(yield_gain, yield_gain_per_n) X(slowest_clock, slowest_clock) X(patience, patience_s) \
    X(reach, reach_m) X(max_acceleration, max_acceleration_m_per_s2) X(shake_hz, shake_hz) X(shake_n, shake_n) \
    X(shake_damping, shake_damping_ns_per_m_per_n) X(shake_memory, shake_memory_s) X(shake_growth, shake_growth_per_s) \
    X(grip_hz, grip_hz) X(grip_n, grip_n) X(grip_mass, grip_mass_kg_per_n) X(lead_s, lead_s)
typedef struct { LAW(ONE_NUMBER) } Numbers; /* CollaborativeLaw */

#define POLICY(X) \
    X(insist_n, insist_n) X(insist_ns_per_m, insist_ns_per_m) X(stiff_ns_per_m, stiff_ns_per_m) X(ahead_n, ahead_n) X(insist_s, insist_s) \
    X(held_m_per_s, held_m_per_s) X(resting_n, resting_n) X(resting_m_per_s, resting_m_per_s) \
    X(start_patience_s, start_patience_s) X(midway_patience_s, midway_patience_s) X(finished_m, finished_m) X(held_s, held_s) \
    X(probe_n, probe_n) X(probe_at_start_n, probe_at_start_n) X(probe_most_n, probe_most_n) X(probe_n_per_s, probe_n_per_s) \
    X(nudge_m, nudge_m) X(settles_s, settles_s) X(probe_s, probe_s) X(progress_m, progress_m) \
    X(probe_damping, probe_damping_ns_per_m) X(elsewhere_m, elsewhere_m) X(elsewhere_n, elsewhere_n) \
    X(offers_at_start, offers_at_start) X(blend_s, blend_s)
typedef struct { POLICY(ONE_NUMBER) } Policy; /* RolePolicy */

typedef struct { /* RoleEvidence */
    int n, strengths; /* filters, and how many of them are one role */
    Tick **filters;
    const double *prior, *centre, *spread, *numbers;
    double *p, *probabilities, *until;
    double *seen, *said; /* room for one tick */
} Bank;

enum { BANK_DT, BANK_CHANGE, BANK_MEMORY, BANK_GATE };

typedef struct { /* Whereabouts: `stations` rows of 3 d + 5 numbers; goal g has those from first[g] to first[g + 1] */
    int stations, width;
    const double *rows, *first;
    double *p, *offset, *until, *goal, *phase, *goals;
    double *moved, *said; /* room for one sample */
} Where;

typedef struct {
    int d, n_goals;
    int heard; /* numbers that the filter of Watch takes; 0: there is none */
    double dt, model_dt, pull_share, bias_share, keep_shake;
    Numbers law, following;
    Policy policy;
    Bank bank;
    const Table *tables;
    Where where;
    Foresight foresight;
    double *compliance, *slow, *slower, *gripping, *shake, *went_on, *turn, *turned; /* Compliance.memory */
    double *expected, *wanted, *offset, *clock;   /* Pace.memory */
    double *shown_expected, *velocity, *position, *start, *reference, *pull, *bias, *taught, *shown_clock, *rest_s, *moved, *against_s,
        *held_s, *told;                           /* of the skill */
    double *until, *seen;                         /* of Watch */
    Tick *filter;
    const Level *level;
} Law;

/* Compliance.memory, Pace.memory and the memory of the skill, as collaborate.memory says */
static inline void lay_law(Law *l, double *compliance, double *pace, double *skill) {
    const int d = l->d;
    double **const paces[] = {&l->expected, &l->wanted, &l->offset, &l->clock};
    double **const skills[] = {
        &l->shown_expected, &l->velocity, &l->position, &l->start, &l->reference, &l->pull, &l->bias, &l->taught, &l->shown_clock,
    };
    l->compliance = compliance, l->slow = compliance + d, l->slower = l->slow + d, l->gripping = l->slower + d;
    l->shake = l->gripping + d, l->went_on = l->shake + 1, l->turn = l->went_on + 1, l->turned = l->turn + 1;
    for (int i = 0; i < 4; i++) *paces[i] = pace + i * d;
    for (int i = 0; i < 9; i++) *skills[i] = skill + i * d;
    l->rest_s = l->shown_clock + 2, l->moved = l->rest_s + 1, l->against_s = l->moved + 1, l->held_s = l->against_s + 1;
    l->told = l->held_s + 1;
}

/* Whereabouts.memory */
static inline void lay_where(Where *w, int d, double *memory) {
    w->p = memory, w->offset = w->p + w->stations, w->until = w->offset + d, w->goal = w->until + 1, w->phase = w->goal + 1;
}

enum { PHASE, RATE, RESISTANCE, WAITS, FADED, FADING, LED, EASING, GOAL, GOING, CLOCKS }; /* Pace.clock */
enum { AT_PHASE, SPACING, DOUBT, BREADTH, LOG_BREADTH, STATION };                 /* Whereabouts.stations, after 3 d vectors */
#define WHERE_PERIOD 0.02
#define WHERE_MEMORY 0.2
#define WHERE_GATE 10.0
#define ASTRAY 1e-6
#define WHERE_SLIPS 0.1
#define LATEST 1.8
#define MOST_FORESEEN 3.0
#define AS_SLOW 4.0

/* Whereabouts._moved and _sample */
static inline void sample(const Law *l, const double *x, const double *v) {
    const Where *w = &l->where;
    const int d = l->d, n = w->stations;
    const double fresh = ASTRAY / n, worth = WHERE_PERIOD / WHERE_MEMORY, speed = length(v, d);
    for (int m = 0; m < n; m++) w->moved[m] = fresh;
    for (int g = 0; g < l->n_goals; g++) {
        const int low = (int)w->first[g], high = (int)w->first[g + 1] - 1;
        for (int m = low; m <= high; m++) {
            const double *row = w->rows + m * w->width;
            const double on = within(dot(v, row + 2 * d, d) * WHERE_PERIOD / row[3 * d + SPACING], -1.0, 1.0);
            const double slips = least(WHERE_SLIPS * speed * WHERE_PERIOD / row[3 * d + SPACING], 0.25);
            double goes = (1.0 - ASTRAY) * w->p[m];
            const double slipped = goes * slips;
            w->moved[m + 1 < high ? m + 1 : high] += slipped;
            w->moved[m - 1 > low ? m - 1 : low] += slipped;
            goes *= 1.0 - 2.0 * slips;
            if (on >= 0.0) {
                w->moved[m + 1 < high ? m + 1 : high] += goes * on;
                w->moved[m] += goes * (1.0 - on);
            } else {
                w->moved[m - 1 > low ? m - 1 : low] -= goes * on;
                w->moved[m] += goes * (1.0 + on);
            }
        }
    }
    const int moves = speed > 0.02;
    double best = -INFINITY, total = 0.0;
    for (int m = 0; m < n; m++) {
        const double *row = w->rows + m * w->width, *about = row + 3 * d;
        double far = 0.0, fast = 0.0;
        for (int i = 0; i < d; i++) far += (x[i] - row[i]) * (x[i] - row[i]);
        for (int i = 0; i < d; i++) fast += (v[i] - row[d + i]) * (v[i] - row[d + i]);
        w->said[m] = -0.5 * (far / (about[DOUBT] * about[DOUBT]));
        if (moves) w->said[m] = w->said[m] - 0.5 * (fast / (about[BREADTH] * about[BREADTH])) - about[LOG_BREADTH];
        best = most(best, w->said[m]);
    }
    for (int m = 0; m < n; m++) {
        w->moved[m] = w->moved[m] * exponential(most(w->said[m] - best, -WHERE_GATE) * worth);
        total += w->moved[m];
    }
    for (int m = 0; m < n; m++) w->p[m] = w->moved[m] / total;
}

/* Whereabouts._tell */
static inline void tell(const Where *w, int n_goals) {
    int goal = (int)*w->goal;
    for (int g = 0; g < n_goals; g++) {
        double total = 0.0;
        for (int m = (int)w->first[g]; m < (int)w->first[g + 1]; m++) total += w->p[m];
        w->goals[g] = total;
    }
    for (int g = 0; g < n_goals; g++)
        if (w->goals[g] > w->goals[goal] + 0.1) goal = g;
    *w->goal = goal;
}

/* Whereabouts.step, of finite numbers */
static inline void locate(Law *l, const double *position, const double *velocity) {
    Where *w = &l->where;
    const int d = l->d;
    double x[MOST_AXES], v[MOST_AXES];
    *w->until -= l->dt;
    if (*w->until > 1e-9) return;
    for (int i = 0; i < d; i++) x[i] = within(position[i] - w->offset[i], -ABSURD, ABSURD), v[i] = within(velocity[i], -ABSURD, ABSURD);
    while (*w->until <= 1e-9) {
        *w->until += WHERE_PERIOD;
        sample(l, x, v);
    }
    tell(w, l->n_goals);
    const int goal = (int)*w->goal;
    int best = (int)w->first[goal];
    for (int m = best + 1; m < (int)w->first[goal + 1]; m++)
        if (w->p[m] > w->p[best]) best = m;
    *w->phase = closest(l->tables + goal, d, x, w->rows[best * w->width + 3 * d + AT_PHASE], 0.15);
}

/* collaborate._left, _leaving */
static inline double left_of(double u) { return 1.0 - u * u * u * (10.0 + u * (-15.0 + 6.0 * u)); }
static inline double leaving(double u) { return -(u * u * (30.0 + u * (-60.0 + 30.0 * u))); }

/* Pace._in_time */
static inline double in_time(const Table *t, double s, double gone, double led_s) {
    const double left = t->duration_s - s, left_s = LATEST * (left + gone) - led_s;
    return left_s > left ? least(left / left_s, 1.0) : 1.0;
}

/* Pace.step */
static inline void pace(Law *l, const double *x, const double *force) {
    const Numbers *law = &l->law;
    const int d = l->d;
    double *c = l->clock;
    const Table *t = l->tables + (int)c[GOAL];
    const double s = c[PHASE];
    const int begun = c[WAITS] <= 0.0, on_path = begun && s < t->duration_s, fades = begun && c[FADED] < c[FADING];
    const double left = c[FADED] < c[FADING] ? left_of(c[FADED] / c[FADING]) : 0.0;
    const double fading = fades ? leaving(c[FADED] / c[FADING]) / c[FADING] : 0.0;
    double target[MOST_AXES], taught[MOST_AXES] = {0}, felt[MOST_AXES] = {0}, error[MOST_AXES];
    row_at(t, t->path, d, s, target);
    if (on_path) row_at(t, t->velocity, d, s, taught);
    if (begun) row_at(t, t->force, d, s, felt);
    for (int i = 0; i < d; i++) target[i] = target[i] + left * l->offset[i], taught[i] = taught[i] + fading * l->offset[i];
    const double speed = length(taught, d), along = speed > 1e-6 ? dot(force, taught, d) / speed : 0.0;
    const double excess = least(along + law->comfortable, 0.0);
    c[RESISTANCE] += least(l->dt / law->patience, 1.0) * (excess - c[RESISTANCE]);
    const double slowest = most(law->slowest_clock, in_time(t, s, c[FADED], c[LED]));
    double rate = on_path || fades ? most(1.0 + law->yield_gain * c[RESISTANCE], slowest) : 1.0;
    if (c[LED] < c[EASING]) {
        const double ease = c[LED] / c[EASING];
        rate *= ease * ease * (3.0 - 2.0 * ease);
    }
    if (speed > t->top_speed) rate *= t->top_speed / speed;
    c[GOING] = rate * speed;
    for (int i = 0; i < d; i++) error[i] = target[i] - x[i];
    const double on = begun ? l->dt * rate : 0.0;
    c[RATE] = rate;
    c[PHASE] = least(s + on, t->duration_s);
    c[FADED] += on;
    c[LED] += begun ? l->dt : 0.0;
    c[WAITS] = most(c[WAITS] - l->dt, 0.0);
    double gain;
    row_at(t, t->gain, 1, s, &gain);
    const double pulls = law->attraction * gain, asked = length(error, d) * pulls, share = asked > 1e-9 ? least(1.0, t->top_speed / asked) : 1.0;
    for (int i = 0; i < d; i++) {
        l->expected[i] = rate * felt[i];
        l->wanted[i] = rate * taught[i] + pulls * (error[i] * share);
    }
}

/* foresight.anticipated */
static inline void anticipated(const Law *l, const Numbers *law, const double *force, double *foreseen) {
    const int d = l->d;
    const Table *t = l->tables + (int)*l->where.goal;
    const double s = *l->where.phase, speed = length(l->compliance, d);
    double now[MOST_AXES], ahead[MOST_AXES];
    for (int i = 0; i < d; i++) foreseen[i] = 0.0;
    if (speed < 0.02) return;
    row_at(t, t->velocity, d, s, now);
    const double usual = most(length(now, d), 0.03);
    row_at(t, t->velocity, d, s + law->anticipation_s * least(speed / usual, 2.0), ahead);
    double agreement = most(dot(now, l->compliance, d), 0.0) / most(length(now, d) * speed, 1e-9);
    agreement *= least(speed / law->moving_speed, 1.0);
    const double scale = least(speed / usual, 1.5);
    for (int i = 0; i < d; i++) foreseen[i] = (ahead[i] - now[i]) / law->anticipation_s * scale;
    const double asked = length(foreseen, d);
    agreement *= within((dot(force, foreseen, d) / most(asked, 1e-9) + 1.0) / 2.0, 0.0, 1.0);
    agreement *= law->anticipation / most(asked / MOST_FORESEEN, 1.0);
    for (int i = 0; i < d; i++) foreseen[i] = agreement * foreseen[i];
}

/* Foresight.foreseen */
static inline void as_foreseen(const Law *l, const Numbers *law, const double *force, double *foreseen) {
    const Foresight *f = &l->foresight;
    const double along = dot(force, f->velocity, l->d) / most(length(f->velocity, l->d), 1e-3);
    const double share = law->foresight * f->told[SURE] * within((along + 2.0) / 1.5, 0.0, 1.0);
    const double damped = law->moving_damping / law->mass;
    for (int i = 0; i < l->d; i++) foreseen[i] = share * (f->acceleration[i] + damped * f->velocity[i]);
}

/* CollaborativeSkill._anticipate */
static inline void anticipate(Law *l, const double *x, const double *force, double *foreseen) {
    const int d = l->d;
    locate(l, x, l->compliance);
    const double before = l->shown_clock[PHASE];
    l->shown_clock[RATE] = (*l->where.phase - before) / l->dt;
    l->shown_clock[PHASE] = *l->where.phase;
    that_way(l->tables + (int)*l->where.goal, d, x, l->compliance, l->taught);
    if (l->foresight.plans && l->foresight.told[AWAKE] != 0.0) {
        foresee(&l->foresight, l->tables, d, l->dt, x, l->compliance);
        if (l->foresight.told[AWAKE] != 0.0) {
            as_foreseen(l, &l->law, force, foreseen);
            return;
        }
    }
    anticipated(l, &l->law, force, foreseen);
}

/* collaborate._beyond */
static inline void beyond(const double *values, double *slow, double keep, int d, double *fast) {
    for (int i = 0; i < d; i++) {
        slow[i] += keep * (values[i] - slow[i]);
        fast[i] = values[i] - slow[i];
    }
}

/* compliance.untaught */
static inline double untaught(const double *velocity, const double *taught, int d) {
    return most(1.0 - AS_SLOW * length(taught, d) / most(length(velocity, d), 1e-6), 0.0);
}

/* Compliance.step; `moving` is the larger of the compliance's speed and the reference's, or what `at_least_going` says */
static inline void comply(Law *l, const Numbers *law, const double *excess, double moving, double astray, const double *feedforward) {
    const int d = l->d;
    const double keep_slow = 1.0 - exponential(-2.0 * PI * law->shake_hz * l->dt), keep_grip = 1.0 - exponential(-2.0 * PI * law->grip_hz * l->dt);
    const double rest = 1.0 - least(moving / law->moving_speed, 1.0);
    double damping = law->moving_damping + rest * rest * (law->resting_damping - law->moving_damping);
    damping += astray * law->untaught_damping;
    double quick[MOST_AXES], fast[MOST_AXES], faster[MOST_AXES];
    beyond(excess, l->slow, keep_slow, d, quick);
    beyond(quick, l->slower, keep_slow, d, fast);
    beyond(quick, l->gripping, keep_grip, d, faster);
    *l->shake += l->keep_shake * (least(length(fast, d), ABSURD) - *l->shake);
    *l->turn += l->keep_shake * (least(length(faster, d), ABSURD) - *l->turn);
    const double amplitude = most(1.57 * *l->shake - law->shake_n, 0.0), turns = most(1.57 * *l->turn - law->grip_n, 0.0);
    *l->went_on += l->dt * (law->shake_growth * amplitude - *l->went_on / law->shake_memory);
    *l->turned += l->dt * (law->shake_growth * turns - *l->turned / law->shake_memory);
    damping += law->shake_damping * (amplitude + *l->went_on);
    const double dead = law->dead_zone * rest, share = l->dt / (law->mass + law->grip_mass * (turns + *l->turned)), size = length(excess, d);
    const double felt = size > dead ? 1.0 - dead / size : 0.0;
    for (int i = 0; i < d; i++)
        l->compliance[i] = (l->compliance[i] + share * (excess[i] * felt) + l->dt * feedforward[i]) / (1.0 + share * damping);
}

/* command_velocity; `out` is position, velocity, acceleration. */
static inline void send(Law *l, const Numbers *law, const double *x, const double *reference, double *const out[3]) {
    const double limit = law->max_acceleration * l->dt, lead = law->lead_s / l->dt;
    double changes[MOST_AXES];
    for (int i = 0; i < l->d; i++) changes[i] = reference[i] + l->compliance[i] - l->velocity[i];
    const double size = length(changes, l->d), share = size > limit ? limit / size : 1.0;
    for (int i = 0; i < l->d; i++) {
        const double change = changes[i] * share, v = l->velocity[i] + change;
        l->velocity[i] = v;
        out[1][i] = v + lead * change;
        out[0][i] = x[i] + l->dt * v;
        out[2][i] = change / l->dt;
    }
}

/* Watch.step; 0 where the filter leaves a step to its twin, who then goes on from there: what was heard is not heard again. */
static inline int watch(Law *l, const double *x, const double *force) {
    if (!l->heard) return 1;
    while (*l->until <= 1e-9) {
        copy(l->seen, x, l->d);
        if (l->heard > l->d) copy(l->seen + l->d, force, l->d);
        if (!TICK(l, l->filter, l->seen)) return 0;
        *l->until += l->model_dt;
    }
    *l->until -= l->dt;
    return 1;
}

/* CollaborativeSkill._foresees */
static inline void hear_motion(Law *l, const double *x, const double *force) {
    const int goal = (int)*l->where.goal;
    hears(&l->foresight, l->tables + goal, l->d, l->dt, goal, *l->where.phase, x, l->compliance, force);
}

/* RoleSkill._ahead; gives how fast a resting hand counts as moving */
static inline double ahead_of(Law *l, const Numbers *law, const double *x, const double *force, int whole, double *foreseen) {
    const Foresight *f = &l->foresight;
    double departs = 0.0;
    if (f->plans && law->foresight > 0.0) {
        if (whole) hear_motion(l, x, force);
        if (f->told[AWAKE] != 0.0) foresee(&l->foresight, l->tables, l->d, l->dt, x, l->compliance);
        departs = f->told[DEPARTS] * law->moving_speed;
        if (f->told[AWAKE] != 0.0) {
            as_foreseen(l, law, force, foreseen);
            return departs;
        }
    }
    anticipated(l, law, force, foreseen);
    return departs;
}

/* CollaborativeSkill.step of a follower, or of who only complies; of a sample from which something is missing nothing is heard */
static inline int follow(Law *l, const double *x, const double *force, double *const out[3], int anticipates, int hears_it) {
    const double nothing[MOST_AXES] = {0};
    double foreseen[MOST_AXES] = {0}, excess[MOST_AXES], departs = 0.0;
    if (!watch(l, x, force)) return 0;
    if (anticipates && hears_it && l->foresight.plans && l->law.foresight > 0.0) hear_motion(l, x, force);
    copy(l->position, x, l->d);
    if (anticipates) anticipate(l, x, force, foreseen);
    if (l->foresight.plans) departs = l->foresight.told[DEPARTS] * l->law.moving_speed;
    for (int i = 0; i < l->d; i++) excess[i] = force[i] - l->shown_expected[i];
    const double astray = anticipates ? untaught(l->compliance, l->taught, l->d) : 0.0;
    comply(l, &l->law, excess, most(length(l->compliance, l->d), departs), astray, foreseen);
    send(l, &l->law, x, nothing, out);
    return 1;
}

/* How fast the hand of a leader goes, or its reference by itself */
static inline double at_least_going(const Law *l) {
    double both[MOST_AXES];
    for (int i = 0; i < l->d; i++) both[i] = l->compliance[i] + l->wanted[i];
    return most(length(both, l->d), l->clock[GOING]);
}

/* CollaborativeSkill._lead, and what follows it */
static inline void lead_there(Law *l, const double *x, const double *force, double *const out[3]) {
    const double nothing[MOST_AXES] = {0};
    double excess[MOST_AXES] = {0};
    copy(l->position, x, l->d);
    pace(l, x, force);
    copy(l->shown_clock, l->clock, 2);
    copy(l->shown_expected, l->expected, l->d);
    copy(l->taught, l->wanted, l->d);
    for (int i = 0; i < l->d; i++) excess[i] = force[i] - l->expected[i];
    comply(l, &l->law, excess, at_least_going(l), 0.0, nothing);
    send(l, &l->law, x, l->wanted, out);
}

static inline int lead(Law *l, const double *x, const double *force, double *const out[3]) {
    if (!watch(l, x, force)) return 0;
    lead_there(l, x, force, out);
    return 1;
}

/* RoleEvidence.step. Its filters, with a floor under every transition, leave nothing that is finite to their twins. */
static inline void hear(Law *l, const double *x, const double *felt) {
    Bank *b = &l->bank;
    const int d = l->d;
    const double change = b->numbers[BANK_CHANGE];
    double neither = 0.0;
    *b->until -= l->dt;
    if (*b->until > 1e-9) return;
    double force[MOST_AXES], foreseen[MOST_AXES] = {0};
    for (int i = 0; i < d; i++) force[i] = felt[i] - l->bias[i];
    if (l->foresight.plans && l->foresight.told[AWAKE] != 0.0) { /* RoleSkill._asked */
        as_foreseen(l, &l->following, force, foreseen);
        for (int i = 0; i < d; i++) force[i] += l->following.mass * foreseen[i];
    }
    for (int i = 0; i < d; i++) b->seen[i] = x[i], b->seen[d + i] = force[i], b->seen[2 * d + i] = l->velocity[i];
    for (int i = 0; i < 3 * d; i++) {
        const double off = (b->seen[i] - b->centre[i]) / b->spread[i];
        neither -= 0.5 * off * off + logarithm(2.5066 * b->spread[i]);
    }
    while (*b->until <= 1e-9) {
        *b->until += b->numbers[BANK_DT];
        double best = b->said[b->n] = neither, total = 0.0;
        for (int i = 0; i < b->n; i++) {
            TICK(l, b->filters[i], b->seen);
            best = most(best, b->said[i] = b->filters[i]->state[LAST_LOG_LIKELIHOOD]);
        }
        for (int i = 0; i <= b->n; i++) {
            const double told = most(b->said[i] - best, -b->numbers[BANK_GATE]) * b->numbers[BANK_MEMORY];
            b->p[i] = ((1.0 - change) * b->p[i] + change * b->prior[i]) * exponential(told);
            total += b->p[i];
        }
        for (int i = 0; i <= b->n; i++) b->p[i] /= total;
    }
    for (int i = 0; i <= b->n; i += b->strengths) {
        double role = 0.0;
        for (int j = i; j < i + b->strengths && j <= b->n; j++) role += b->p[j];
        b->probabilities[i / b->strengths] = role;
    }
}

/* Watch and RoleEvidence; 0, with neither done, for what must count as missing. */
static inline int attend(Law *l, const double *x, const double *felt) {
    for (int i = 0; i < l->d && l->bank.n; i++)
        if (!(fabs(x[i]) < ABSURD && fabs(felt[i] - l->bias[i]) < ABSURD)) return 0;
    if (!watch(l, x, felt)) return 0;
    if (l->bank.n) hear(l, x, felt);
    return 1;
}

/* Of a robot that was told nothing, which alone has plans: at the end of the way, who pulls so much wants to be elsewhere */
static inline int leans(const Law *l, const double *pull) {
    const Table *t = l->tables + (int)(*l->told >= 0.0 ? *l->told : *l->where.goal);
    return l->foresight.plans && !(l->clock[GOING] > l->policy.resting_m_per_s) && remaining(t, l->clock[PHASE]) <= 0.0 &&
           length(pull, l->d) > l->policy.elsewhere_n;
}

/* RoleSkill._unfinished, not */
static inline int finished(const Law *l) {
    const Table *t = l->tables + (int)(*l->told >= 0.0 ? *l->told : *l->where.goal);
    return !(remaining(t, *l->where.phase) - t->slack > l->policy.finished_m);
}
