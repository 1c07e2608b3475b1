/* Plain ticks of skills/roles.py, as Python calls them: it leads alone or follows alone, and nothing is being asked. _roles.h has all. */

/* RoleSkill.step while it leads and means it; the tick at which it gives way, `_give_way_if_he_insists`, is left to it. */
static inline int lead_on(Law *l, const double *x, const double *felt, double *const out[3]) {
    const Policy *than = &l->policy;
    const int d = l->d;
    double force[MOST_AXES], pull[MOST_AXES];
    for (int i = 0; i < d; i++) {
        force[i] = felt[i] - l->bias[i];
        pull[i] = l->pull[i] + l->pull_share * (force[i] - l->pull[i]);
    }
    const double along = dot(pull, l->wanted, d) / most(length(l->wanted, d), 1e-3), speed = length(l->velocity, d);
    const int against = -along > than->insist_n + than->insist_ns_per_m * speed || along > than->ahead_n;
    const double asks = l->clock[GOING] > than->resting_m_per_s ? than->resting_m_per_s : l->law.attraction * than->finished_m;
    const int under_way = l->clock[LED] > than->insist_s && length(l->wanted, d) > asks;
    const int held = (under_way && speed < than->held_m_per_s && length(pull, d) > than->resting_n) || leans(l, pull);
    const double against_s = against ? *l->against_s + l->dt : 0.0, held_s = most(*l->held_s + (held ? l->dt : -l->dt), 0.0);
    if (against_s >= than->insist_s || held_s >= than->held_s || !attend(l, x, felt)) return 0;
    lead_there(l, x, force, out);
    *l->against_s = against_s, *l->held_s = held_s;
    copy(l->pull, pull, d);
    copy(l->reference, l->wanted, d);
    return 1;
}

/* RoleSkill.step while it follows, and it is too early to ask whether anybody leads. */
static inline int follow_on(Law *l, const double *x, const double *felt, double *const out[3]) {
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
    const int patient = rest_s < (moved ? policy->midway_patience_s : policy->start_patience_s);
    if (!patient && !finished(l)) return 0;
    if (!attend(l, x, felt)) return 0;
    locate(l, x, l->velocity);
    l->shown_clock[PHASE] = *l->where.phase;
    that_way(l->tables + (int)*l->where.goal, d, x, l->velocity, l->taught);
    copy(l->position, x, d);
    copy(l->pull, pull, d);
    *l->rest_s = rest_s, *l->moved = moved;
    double foreseen[MOST_AXES];
    const double departs = ahead_of(l, &l->following, x, force, 1, foreseen);
    for (int i = 0; i < d; i++) {
        if (resting && !moved) l->bias[i] += l->bias_share * pull[i];
        force[i] -= l->shown_expected[i];
    }
    comply(l, &l->following, force, most(length(l->compliance, d), departs), untaught(l->compliance, l->taught, d), foreseen);
    send(l, &l->following, x, nothing, out);
    return 1;
}
