/* A robot with a learned skill, laid over its block of numbers (page/numbers.py) and a memory of its own; kernels/_whole.h runs it. */

#define HEADER(X) \
    X(version) X(d) X(dt) X(changes) X(leads) X(goals) X(states) X(heard) X(filters) X(strengths) X(stations) X(plans) X(alike) X(keep) \
    X(model_dt) X(pull_s) X(bias_s) X(told) X(most_pulls) X(most_before) X(swing) X(beside) X(late) X(blend) X(average) X(ticks) X(mass) X(share) \
    X(moving) X(b0) X(b1) X(b2) X(a1) X(a2) X(gate) X(patience)
typedef struct { HEADER(A_NUMBER) } Header;

enum { BLOCK_VERSION = 1, MOST_GOALS = 64, MOST_FILTERS = 64, MOST_STATES = 512, MOST_STATIONS = 4096, MOST_PLANS = 4096, MOST_PULLS = 4096, OF_GOAL = 7 };
enum { NO_BLOCK = 1, OTHER_VERSION, OTHER_AXES, OTHER_LENGTH, OTHER_SIZES, NO_MEMORY };

typedef struct Robot {
    Header header;
    Whole whole;
    Table tables[MOST_GOALS];
    Tick watch, filters[MOST_FILTERS];
    Tick *bank[MOST_FILTERS];
    Role role;
    Guard guard;
    Weighing weighing;
    Weighed weighed;
    Sample sample;
    double tank;
    int first;
    double *memory;
} Robot;

typedef struct { const double *at, *end; } Reader;

static const double *taken(Reader *r, double count) { /* NULL where the block is too short */
    const double *from = r->at;
    if (!(count >= 0.0) || count > (double)(r->end - r->at)) return r->at = r->end = NULL;
    r->at += (size_t)count;
    return from;
}

static double *room(double **memory, double count) {
    double *from = *memory;
    *memory += (size_t)count;
    return from;
}

/* One filter of K states over D channels: its numbers, and (2 K + FILTER_STATE, and K twice) of memory */
static int lay_filter(Tick *t, Reader *r, double **memory, int D, int K, const Header *h) {
    *t = (Tick){.D = D, .K = K, .patience = (int)h->patience, .gate = h->gate};
    t->origin = taken(r, D), t->factors = taken(r, (double)K * D * D), t->centres = taken(r, (double)K * D), t->peak = taken(r, K);
    t->initial = taken(r, K), t->chain = taken(r, (double)K * K);
    if (!t->chain) return 0;
    t->weights = room(memory, K), t->state = room(memory, FILTER_STATE), t->log_b = room(memory, K), t->h = room(memory, K);
    filter_reset(t);
    return 1;
}

static int whole_number(double x, double low, double high) { return x >= low && x <= high && x == (double)(int)x; }

static int fits(const Header *h) {
    return whole_number(h->goals, 1, MOST_GOALS) && whole_number(h->states, 1, MOST_STATES) &&
           (h->heard == h->d || h->heard == 2.0 * h->d) && whole_number(h->filters, 0, MOST_FILTERS - 1) &&
           whole_number(h->strengths, 1, MOST_FILTERS) && whole_number(h->stations, 2, MOST_STATIONS) && whole_number(h->plans, 0, MOST_PLANS) &&
           whole_number(h->most_pulls, 1, MOST_PULLS) && whole_number(h->most_before, 1, MOST_PULLS) &&
           whole_number(h->swing, 1, h->most_pulls) && whole_number(h->late, 0, MOST_LATE) && whole_number(h->told, -1, h->goals - 1) &&
           h->dt >= 1e-4 && h->dt <= 0.1 && h->model_dt >= 1e-4 && h->model_dt <= 0.1 && (h->plans == 0.0 || whole_number(h->alike, 1, h->plans));
}

/* Paths of all goals, and where along them it may be */
static int lay_paths(Robot *b, Law *l, Reader *r, double **memory) {
    const int d = l->d, n = l->n_goals;
    const double *about = taken(r, OF_GOAL * (double)n);
    double rows = 0.0, at = 0.0;
    if (!about) return 0;
    for (int g = 0; g < n; g++) {
        if (!whole_number(about[OF_GOAL * g], 2, 1e6)) return 0;
        rows += about[OF_GOAL * g];
    }
    const double *path = taken(r, rows * d), *velocity = taken(r, rows * d), *force = taken(r, rows * d), *way = taken(r, rows);
    const double *gain = taken(r, rows), *plan = NULL, *plan_way = NULL, *heading = NULL, *grid = NULL;
    if (l->foresight.plans) {
        plan = taken(r, 3.0 * rows * d), plan_way = taken(r, rows), heading = taken(r, (double)n * d);
        grid = taken(r, 3.0 * l->foresight.plans), l->foresight.prior = taken(r, l->foresight.plans);
        if (!l->foresight.prior) return 0;
        l->foresight.sizes = grid, l->foresight.paces = grid + l->foresight.plans, l->foresight.late = grid + 2 * l->foresight.plans;
    }
    if (!gain) return 0;
    for (int g = 0; g < n; g++, about += OF_GOAL) {
        const size_t i = (size_t)at;
        b->tables[g] = (Table){
            .rows = (int)about[0], .step_s = about[1], .duration_s = about[1] * (about[0] - 1.0), .top_speed = about[2], .slack = about[3],
            .place = about[4], .extent = about[5], .begins = about[6], .path = path + i * d, .velocity = velocity + i * d, .force = force + i * d,
            .way = way + i, .gain = gain + i,
        };
        if (plan) b->tables[g].plan = plan + 3 * i * d, b->tables[g].plan_way = plan_way + i, b->tables[g].heading = heading + g * d;
        at += about[0];
    }
    Where *w = &l->where;
    w->stations = (int)b->header.stations, w->width = 3 * d + STATION;
    w->rows = taken(r, (double)w->stations * w->width), w->first = taken(r, n + 1.0);
    if (!w->first || w->first[0] != 0.0 || w->first[n] != w->stations) return 0;
    for (int g = 0; g < n; g++)
        if (!whole_number(w->first[g + 1], w->first[g] + 2.0, w->stations)) return 0;
    lay_where(w, d, room(memory, w->stations + d + 3.0));
    w->goals = room(memory, n), w->moved = room(memory, w->stations), w->said = room(memory, w->stations);
    return 1;
}

/* evidence.RoleEvidence */
static int lay_bank(Robot *b, Law *l, Reader *r, double **memory) {
    Bank *bank = &l->bank;
    const int n = (int)b->header.filters, d = l->d;
    if (!n) return 1;
    bank->n = n, bank->strengths = (int)b->header.strengths, bank->filters = b->bank;
    bank->numbers = taken(r, BANK_GATE + 1.0), bank->prior = taken(r, n + 1.0), bank->centre = taken(r, 3.0 * d), bank->spread = taken(r, 3.0 * d);
    if (!bank->spread || n % bank->strengths || bank->numbers[BANK_DT] != l->model_dt) return 0;
    for (int i = 0; i < n; i++) {
        const double *states = taken(r, 1);
        if (!states || !whole_number(*states, 1, MOST_STATES)) return 0;
        if (!lay_filter(&b->filters[i], r, memory, 3 * d, (int)*states, &b->header)) return 0;
        b->bank[i] = &b->filters[i];
    }
    bank->p = room(memory, n + 1.0), bank->probabilities = room(memory, n / bank->strengths + 1.0), bank->until = room(memory, 1);
    bank->seen = room(memory, 3.0 * d), bank->said = room(memory, n + 1.0);
    return 1;
}

static void lay_envelope(Robot *b, Envelope *e, const double *limits, const double *walls, double **memory) {
    const Header *h = &b->header;
    *e = (Envelope){.d = (int)h->d, .most_pulls = (int)h->most_pulls, .most_before = (int)h->most_before, .swing = (int)h->swing};
    memcpy(&e->limits, limits, sizeof e->limits);
    e->rules.v_max = e->limits.v_max, e->rules.a_max = e->limits.a_max, e->rules.dt = e->limits.dt;
    b->whole.beside = h->beside;
    for (int i = 0; i < e->d; i++) b->whole.low[i] = b->guard.low[i] = walls[2 * i], b->whole.high[i] = b->guard.high[i] = walls[2 * i + 1];
    wall_in(e, &b->guard);
    e->now = &b->guard.ledger, e->tank = &b->tank;
    e->pulls = room(memory, (double)e->most_pulls * e->d), e->before = room(memory, (double)e->most_before * e->d);
}

static int lay_robot(Robot *b, Reader *r, double *memory) {
    Header *h = &b->header;
    Law *l = &b->whole.law;
    const int d = (int)h->d;
    const double *given = taken(r, sizeof(Numbers) / 8), *followed = taken(r, sizeof(Numbers) / 8), *conduct = taken(r, sizeof(Policy) / 8);
    const double *limits = taken(r, sizeof(Limits) / 8), *walls = taken(r, 2.0 * d), *gravity = taken(r, d);
    if (!gravity) return 0;
    *l = (Law){.d = d, .n_goals = (int)h->goals, .heard = (int)h->heard, .dt = h->dt, .model_dt = h->model_dt};
    memcpy(&l->law, given, sizeof(Numbers)), memcpy(&l->following, followed, sizeof(Numbers)), memcpy(&l->policy, conduct, sizeof(Policy));
    l->keep_shake = least(h->dt / 0.3, 1.0), l->pull_share = least(h->dt / h->pull_s, 1.0), l->bias_share = h->dt / h->bias_s;
    l->tables = b->tables;
    l->foresight = (Foresight){.plans = (int)h->plans, .alike = (int)h->alike, .keep = h->keep};
    double *compliance = room(&memory, 4.0 * d + 4.0), *pace = room(&memory, 3.0 * d + CLOCKS), *skill = room(&memory, 8.0 * d + 7.0);
    lay_law(l, compliance, pace, skill);
    if (l->foresight.plans) lay_foresight(&l->foresight, d, room(&memory, 4.0 * d + TOLD + 2.0 * h->plans));
    *l->told = h->told;
    l->until = room(&memory, 1), l->seen = room(&memory, h->heard);
    if (!lay_paths(b, l, r, &memory) || !lay_filter(&b->watch, r, &memory, (int)h->heard, (int)h->states, h)) return 0;
    l->filter = &b->watch;
    if (!lay_bank(b, l, r, &memory)) return 0;
    Whole *w = &b->whole;
    w->kind = h->changes != 0.0 ? CHANGES : ALONE, w->leads = h->leads != 0.0, w->entries = room(&memory, h->goals);
    w->role = &b->role, w->guard = &b->guard, w->weighing = &b->weighing, w->weighed = &b->weighed;
    w->past = room(&memory, d * (h->late + 2.0));
    lay_envelope(b, &w->envelope, limits, walls, &memory);
    b->weighing = (Weighing){.dt = h->dt, .mass = h->mass, .share = h->share, .moving = h->moving, .b0 = h->b0, .b1 = h->b1, .b2 = h->b2,
                             .a1 = h->a1, .a2 = h->a2, .blend = h->blend, .d = d, .ticks = (int)h->ticks, .late = (int)h->late,
                             .average = h->average != 0.0};
    copy(b->weighing.gravity, gravity, d);
    return r->at == r->end;
}

static void skill_free(World *w) {
    if (w->robot_with_skill) free(w->robot_with_skill->memory);
    free(w->robot_with_skill);
    w->robot_with_skill = NULL;
}

/* Lays a robot over `numbers`, which must stay; 0, or what is wrong with them. */
static int skill_take(World *w, const double *numbers, int n) {
    skill_free(w);
    if (!numbers) return 0;
    Reader r = {numbers, numbers + n};
    const double *header = taken(&r, sizeof(Header) / 8);
    if (!header) return NO_BLOCK;
    Robot *b = calloc(1, sizeof(Robot));
    if (!b) return NO_MEMORY;
    memcpy(&b->header, header, sizeof(Header));
    const Header *h = &b->header;
    int wrong = h->version != BLOCK_VERSION ? OTHER_VERSION : h->d != w->axes || h->dt != w->dt_s ? OTHER_AXES : !fits(h) ? OTHER_SIZES : 0;
    if (!wrong) {
        double space = 65536.0 + 4.0 * h->stations + 4.0 * h->plans + 4.0 * h->states + (h->most_pulls + h->most_before) * h->d;
        space += h->filters * (4.0 * MOST_STATES + 64.0);
        b->memory = calloc((size_t)space, sizeof(double));
        wrong = !b->memory ? NO_MEMORY : lay_robot(b, &r, b->memory) ? 0 : OTHER_LENGTH;
    }
    w->robot_with_skill = b;
    if (wrong) skill_free(w);
    return wrong;
}

static void skill_begin(World *w) {
    if (w->robot_with_skill) w->robot_with_skill->first = 1, w->robot_with_skill->tank = w->robot_with_skill->whole.envelope.limits.energy;
}

static void show_skill(World *w, const Robot *b) {
    const Law *l = &b->whole.law;
    const Guard *g = &b->guard;
    for (int i = 0; i < l->d; i++) w->force[i] = b->sample.force[i], w->expected_force[i] = l->shown_expected[i];
    w->mode = g->mode, w->reason = g->reason, w->reason_value = g->value, w->passes = g->mode != MODE_RUN && g->passes != 0.0;
    w->acts = b->role.complies_only != 0.0 ? 3.0 : b->role.acts, w->blend = b->role.blend;
    w->tank_j = b->tank, w->confidence = g->confidence, w->payload_kg = b->weighed.payload;
    w->phase_s = l->shown_clock[PHASE], w->clock_rate = l->shown_clock[RATE];
}

static void skill_tick(World *w) {
    Robot *b = w->robot_with_skill;
    double *out[3] = {w->command_position, w->command_velocity, w->command_acceleration};
    b->sample.time = w->time_s, b->sample.force_time = NAN;
    for (int i = 0; i < (int)w->axes; i++)
        b->sample.position[i] = w->position[i], b->sample.velocity[i] = w->velocity[i], b->sample.sensed[i] = w->sensor_force[i];
    step_whole(&b->whole, &b->sample, b->first, out);
    b->first = 0;
    show_skill(w, b);
}

static int skill_rearm(World *w) {
    double value = NAN;
    const int refused = rearm_whole(&w->robot_with_skill->whole, &w->robot_with_skill->sample, &value);
    show_skill(w, w->robot_with_skill);
    if (refused) w->reason_value = value;
    return refused;
}

static const char *skill_reason(int reason) {
#define ITS_TEXT(name, text) text,
    static const char *const TEXTS[] = {REASONS(ITS_TEXT)};
    return reason >= 0 && reason < N_REASONS ? TEXTS[reason] : "";
}

/* 0 weights of the states, 1 roles, 2 goals: how many, and they in `out` */
static int skill_shown(World *w, int what, double *out) {
    if (!w->robot_with_skill) return 0;
    const Law *l = &w->robot_with_skill->whole.law;
    const int n = what == 0 ? l->filter->K : what == 1 ? (l->bank.n ? l->bank.n / l->bank.strengths + 1 : 0) : l->n_goals;
    copy(out, what == 0 ? l->filter->weights : what == 1 ? l->bank.probabilities : l->where.goals, n);
    return n;
}
