/* Everything that a robot does at one tick: the force estimate, the envelope, and within it the skill. See loop.run, which calls the
 * Python of the same parts in the same order.
 */

enum { ALONE, CHANGES }; /* CollaborativeSkill; RoleSkill */

typedef struct { /* CollaborativeSkill or RoleSkill with its parts, laid over a memory for one tick */
    int kind, leads;  /* leads, as it was told; else it follows, or finds out */
    double *entries;  /* room for a number a goal */
    Law law;
    Role *role;
    Envelope envelope;
    Guard *guard;
    double beside;            /* [m] as Limits.begins_beside_m, NaN for none */
    Axes low, high;           /* the walls as they are stated */
    const Weighing *weighing;
    Weighed *weighed;
    double *past;
} Whole;

typedef struct { double time, force_time; Axes position, velocity, sensed, force; } Sample; /* an observation, kept */

static inline Seen seen_of(const Whole *w, const Sample *s) {
    const Seen seen = {s->time, s->force_time, s->position, s->velocity, s->sensed, s->force, w->law.taught};
    return seen;
}

/* `_enter` of the skill; `resumes`: in the part of the task in which it was */
static inline void enter_skill(Whole *w, const double *x, int resumes) {
    Law *l = &w->law;
    Role *r = w->role;
    const double last = resumes ? l->shown_clock[PHASE] : NAN;
    if (l->heard) filter_reset(l->filter), *l->until = 0.0;
    if (w->kind == CHANGES) {
        enter_role(l, r, x, w->leads, last, w->entries);
        return;
    }
    const int goal = resumes ? (int)*l->where.goal : *l->told >= 0.0 ? (int)*l->told : 0;
    r->outside = enter_law(l, x, goal, last, w->entries);
    r->complies_only = r->outside > l->law.reach;
    r->acts = w->leads && r->complies_only == 0.0 ? LEADS : FOLLOWS;
    r->blend = (int)r->acts == LEADS;
}

/* `step` of the skill: what is missing of a position is where it was, and of a force none */
static inline void think(Whole *w, const double *position, const double *felt, double *const out[3]) {
    Law *l = &w->law;
    const int d = l->d, is_whole = all_finite(position, d) && all_finite(felt, d);
    Axes x, force;
    for (int i = 0; i < d; i++) x[i] = is_finite(position[i]) ? position[i] : l->position[i], force[i] = is_finite(felt[i]) ? felt[i] : 0.0;
    if (w->kind == CHANGES) act_by_role(l, w->role, x, force, is_whole, out);
    else if (w->role->complies_only != 0.0) (void)follow(l, x, force, out, 0, 0);
    else if (w->leads) (void)lead(l, x, force, out);
    else (void)follow(l, x, force, out, 1, is_whole);
}

/* The walls of `g`, as the envelope and its checker see them */
static inline void wall_in(Envelope *e, const Guard *g) {
    copy(e->low, g->low, e->d), copy(e->high, g->high, e->d);
    copy(e->rules.low, g->low, e->d), copy(e->rules.high, g->high, e->d);
}

/* Envelope._enclose */
static inline void enclose(Whole *w, const double *x) {
    const int d = w->law.d;
    int near = 1;
    for (int i = 0; i < d; i++) near &= most(w->low[i] - x[i], x[i] - w->high[i]) <= w->beside;
    for (int i = 0; i < d; i++) {
        w->guard->low[i] = near ? least(w->low[i], x[i]) : w->low[i];
        w->guard->high[i] = near ? most(w->high[i], x[i]) : w->high[i];
    }
    wall_in(&w->envelope, w->guard);
}

/* Envelope._begin after what was wrong with the observation; the reason why it does not */
static inline int begin_at(Whole *w, const Sample *s, int resumes) {
    if (!resumes) enclose(w, s->position);
    restart(&w->envelope, w->guard, s->time, s->position);
    enter_skill(w, s->position, resumes);
    w->guard->ran = 1.0;
    *w->envelope.tank = w->guard->ledger.energy;
    return REASON_NONE;
}

/* loop._begin: all that has a memory forgets it, and looks for the first time */
static inline void begin_whole(Whole *w, Sample *s) {
    Guard *g = w->guard;
    double value;
    estimate_reset(w->weighing, w->weighed);
    estimate(w->weighing, w->weighed, w->past, s->velocity, s->sensed, s->force);
    const Seen seen = seen_of(w, s);
    enclose(w, s->position);
    const int refused = problem_of(&w->envelope, &seen, &value);
    g->ran = 0.0;
    for (int n = 0; n < 3; n++) fill(g->wish[n], 0.0, w->law.d);
    if (!refused) {
        (void)begin_at(w, s, 0);
        return;
    }
    Axes place;
    for (int i = 0; i < w->law.d; i++) place[i] = fabs(s->position[i]) < ABSURD ? s->position[i] : 0.0;
    restart(&w->envelope, g, is_finite(s->time) ? s->time : 0.0, place);
    fault(g, refused, value);
}

/* One tick: of a sample without its force, which is filled in, the command into `out` */
static inline void step_whole(Whole *w, Sample *s, int first, double *const out[3]) {
    Guard *g = w->guard;
    double *wish[3];
    double period;
    for (int n = 0; n < 3; n++) wish[n] = g->wish[n];
    if (first) begin_whole(w, s);
    else estimate(w->weighing, w->weighed, w->past, s->velocity, s->sensed, s->force);
    const Seen seen = seen_of(w, s);
    g->ledger.leads = w->role->blend;
    if (guard_senses(&w->envelope, g, &seen, &period) == SKILL_RESUMES) {
        enter_skill(w, s->position, 1);
        recovered(&w->envelope, g);
    }
    if (thinks(&w->envelope, g, period)) {
        think(w, s->position, s->force, wish);
        heed(&w->envelope, g);
    }
    guard_sends(&w->envelope, g, period, out);
}

/* Envelope.rearm; 0: it runs, else why it does not, and the number that belongs to it */
static inline int rearm_whole(Whole *w, const Sample *s, double *value) {
    const Seen seen = seen_of(w, s);
    const int refused = rearms(&w->envelope, w->guard, &seen, value);
    return refused ? refused : begin_at(w, s, w->guard->ran != 0.0);
}
