/* skills/roles.py once more, whole: follows, offers to lead, leads. */

#define ROLE(X) \
    X(acts, acts) X(gives, gives) X(answers, answers) X(placed, placed) X(gave_way, gave_way) X(put_back, put_back) X(reached, reached) \
    X(push, push) X(meant, meant) X(blend, blend) X(complies_only, complies_only) X(outside, outside)
typedef struct { /* RoleSkill, what is not in its memory */
    ROLE(ONE_NUMBER)
    Axes place, way;
} Role;

enum { FOLLOWS, PROBES, LEADS };
#define AROUND_S 1.0
#define STIRS_S 0.15

/* Every number of the law on the straight line between following and leading, in fiftieths: roles._between */
static inline void between(const Numbers *following, const Numbers *leading, double blend, Numbers *out) {
    const double place = 50.0 * blend;
    int n = (int)place;
    if (place - n > 0.5 || (place - n == 0.5 && n % 2)) n++; /* round(): halves to even */
    const double share = n / 50.0;
#define MIXED(field, name) out->field = (1.0 - share) * following->field + share * leading->field;
    LAW(MIXED)
#undef MIXED
}

static inline void begin(Law *l, Role *r, int acts) {
    r->acts = acts;
    *l->rest_s = *l->against_s = 0.0;
    if (acts == FOLLOWS && l->foresight.plans) foresight_reset(&l->foresight, l->d, l->position, 0);
}

static inline int answered(Law *l, int against, double after) {
    *l->against_s = against ? *l->against_s + l->dt : 0.0;
    return *l->against_s >= after;
}

static inline int goal_meant(const Law *l) { return (int)(*l->told >= 0.0 ? *l->told : *l->where.goal); }

/* RoleSkill._was_put_back */
static inline int was_put_back(const Law *l, Role *r, const double *x) {
    if (r->gave_way != 0.0 && apart(x, l->start, l->d) < l->policy.finished_m) r->put_back = 1.0;
    return r->put_back != 0.0;
}

/* RoleSkill._take_over_if_nobody_leads */
static inline void take_over(Law *l, Role *r, const double *x) {
    const Policy *policy = &l->policy;
    const int d = l->d, resting = length(l->velocity, d) < policy->resting_m_per_s && length(l->pull, d) < policy->resting_n;
    *l->rest_s = answered(l, !resting, STIRS_S) ? 0.0 : *l->rest_s + l->dt;
    if (r->placed != 0.0 && apart(x, r->place, d) > policy->elsewhere_m) r->answers = r->placed = 0.0;
    if (r->placed == 0.0 && *l->moved == 0.0) *l->moved = apart(x, l->start, d) > 0.02;
    for (int i = 0; i < d && resting && *l->moved == 0.0; i++) l->bias[i] += l->bias_share * l->pull[i];
    const double patience = *l->moved != 0.0 ? policy->midway_patience_s : policy->start_patience_s;
    const double offers = apart(x, l->start, d) <= policy->elsewhere_m ? policy->offers_at_start : 1.0;
    if (resting && *l->rest_s >= patience && !finished(l) && r->answers < offers && !was_put_back(l, r, x)) {
        copy(r->place, x, d);
        r->placed = 1.0;
        heading_at(l->tables + goal_meant(l), d, *l->where.phase, r->way);
        r->reached = r->push = r->meant = *l->held_s = r->gives = 0.0;
        begin(l, r, PROBES);
    }
}

/* RoleSkill._probe */
static inline void probe(Law *l, Role *r, const double *x) {
    const Policy *policy = &l->policy;
    const int d = l->d;
    Axes off;
    for (int i = 0; i < d; i++) off[i] = x[i] - r->place[i];
    const double far = dot(off, r->way, d), along = dot(l->pull, r->way, d);
    if (far > 0.5 * policy->nudge_m) r->gives = 1.0;
    const double most_push = *l->moved != 0.0 ? policy->probe_n
                             : far > policy->nudge_m ? policy->probe_at_start_n : policy->probe_most_n;
    if (*l->rest_s == 0.0 && r->push < most_push) r->push += policy->probe_n_per_s * l->dt;
    else *l->rest_s += l->dt;
    if (*l->rest_s < policy->settles_s) r->reached = far;
    if (far - r->reached > policy->progress_m || far > policy->elsewhere_m) {
        start_pace(l, closest(l->tables + goal_meant(l), d, x, *l->where.phase, AROUND_S), x, goal_meant(l), 0.0, 0);
        begin(l, r, LEADS);
    } else if (*l->rest_s >= policy->settles_s + policy->probe_s || along > policy->ahead_n) {
        copy(r->place, x, d);
        r->answers += 1.0;
        begin(l, r, FOLLOWS);
    }
}

/* RoleSkill._give_way_to_who_insists */
static inline void give_way(Law *l, Role *r) {
    const Policy *policy = &l->policy;
    const int d = l->d;
    const double along = dot(l->pull, l->wanted, d) / most(length(l->wanted, d), 1e-3), speed = length(l->velocity, d);
    const double damper = dot(l->pull, l->velocity, d) < 0.0 ? policy->stiff_ns_per_m : policy->insist_ns_per_m;
    const int pushed = -along > policy->insist_n + damper * speed;
    const int going = l->clock[GOING] > policy->resting_m_per_s;
    const double asks = going ? policy->resting_m_per_s : l->law.attraction * policy->finished_m;
    const int under_way = l->clock[LED] > policy->insist_s && r->meant >= 1.0 && length(l->wanted, d) > asks;
    const int held = (under_way && speed < policy->held_m_per_s && length(l->pull, d) > policy->resting_n) || leans(l, l->pull);
    *l->held_s = most(*l->held_s + (held ? l->dt : -l->dt), 0.0);
    if (answered(l, pushed || along > policy->ahead_n, policy->insist_s) || *l->held_s >= policy->held_s) {
        r->placed = r->answers = 0.0, r->gave_way = 1.0;
        begin(l, r, FOLLOWS);
    }
}

/* RoleSkill._led: what leading adds to the velocity */
static inline void led_by(Law *l, Role *r, const double *x, const double *force, double *reference) {
    const int d = l->d;
    const double change = l->dt / l->policy.blend_s;
    fill(reference, 0.0, d);
    if ((int)r->acts == LEADS) {
        pace(l, x, force);
        copy(l->shown_clock, l->clock, 2);
        copy(l->taught, l->wanted, d);
        r->meant = least(r->meant + change, 1.0);
        for (int i = 0; i < d; i++) {
            reference[i] = l->reference[i] = r->meant * l->wanted[i];
            l->shown_expected[i] = r->meant * l->expected[i] - (1.0 - r->meant) * r->push * r->way[i];
        }
    } else if ((int)r->acts == PROBES) {
        for (int i = 0; i < d; i++) l->shown_expected[i] = -r->push * r->way[i];
    } else {
        const double keep = most(r->blend - change, 0.0) / r->blend;
        for (int i = 0; i < d; i++) l->shown_expected[i] *= keep, reference[i] = l->reference[i] *= keep;
    }
}

/* RoleSkill._step, of finite numbers that were attended to */
static inline void act_attended(Law *l, Role *r, const double *x, const double *felt, int whole,
                                double *const out[3]) {
    const int d = l->d;
    double change = l->dt / l->policy.blend_s;
    Axes force, reference = {0}, excess, both;
    Numbers asking = l->law, offering = l->following, mixed;
    copy(l->position, x, d);
    for (int i = 0; i < d; i++) {
        force[i] = felt[i] - l->bias[i];
        l->pull[i] += l->pull_share * (force[i] - l->pull[i]);
    }
    if (r->complies_only == 0.0) {
        if ((int)r->acts == LEADS) give_way(l, r);
        else if ((int)r->acts == PROBES) probe(l, r, x);
        else take_over(l, r, x);
    }
    if ((int)r->acts != LEADS) {
        locate(l, x, l->velocity);
        l->shown_clock[PHASE] = *l->where.phase;
        that_way(l->tables + (int)*l->where.goal, d, x, l->velocity, l->taught);
    }
    r->blend += within(((int)r->acts != FOLLOWS ? 1.0 : 0.0) - r->blend, -change, change);
    if (r->blend > 0.0) led_by(l, r, x, force, reference);
    asking.resting_damping = asking.moving_damping, asking.dead_zone = 0.0;
    offering.resting_damping = offering.moving_damping = l->policy.probe_damping, offering.dead_zone = 0.0;
    between(&l->following, &l->law, r->blend, &mixed);
    const Numbers *law = (int)r->acts == PROBES ? (r->gives != 0.0 ? &offering : &asking) : &mixed;
    for (int i = 0; i < d; i++) excess[i] = force[i] - l->shown_expected[i], both[i] = l->compliance[i] + reference[i];
    const int follows = (int)r->acts == FOLLOWS && r->complies_only == 0.0;
    const double astray = follows ? untaught(l->compliance, l->taught, d) : 0.0;
    Axes ahead = {0};
    const double departs = follows && r->blend == 0.0 ? ahead_of(l, law, x, force, whole, ahead) : 0.0;
    const double moving = (int)r->acts == LEADS ? most(length(both, d), r->meant * l->clock[GOING])
                                                : most(most(length(l->compliance, d), length(reference, d)), departs);
    comply(l, law, excess, moving, astray, ahead);
    send(l, law, x, reference, out);
}

static inline void act_by_role(Law *l, Role *r, const double *x, const double *felt, int whole, double *const out[3]) {
    (void)attend(l, x, felt);
    act_attended(l, r, x, felt, whole, out);
}

/* RoleSkill._enter; `told_to_lead` as it was made, `last` as for enter_law */
static inline void enter_role(Law *l, Role *r, const double *x, int told_to_lead, double last, double *entries) {
    const int resumes = last == last, led = resumes && (int)r->acts == LEADS;
    const int goal = resumes ? goal_meant(l) : *l->told >= 0.0 ? (int)*l->told : 0;
    r->outside = enter_law(l, x, goal, last, entries);
    r->gives = r->answers = r->placed = r->gave_way = r->put_back = r->reached = r->push = 0.0;
    r->complies_only = r->outside > l->law.reach;
    r->acts = (told_to_lead || led) && r->complies_only == 0.0 ? LEADS : FOLLOWS;
    r->meant = r->blend = (int)r->acts == LEADS;
}
