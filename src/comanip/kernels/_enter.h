/* Beginning, and beginning again: what skills/collaborate.py and skills/roles.py do from rest, where the hand is. */

#define FADES_OFFSET_S 1.0
#define FADES_BELOW 0.7
#define EASES_S 0.8
#define EASES_IN_S 0.3

/* Pace.start; `waits` [s], `eases` as there */
static inline void start_pace(Law *l, double phase, const double *position, int goal, double waits, int eases) {
    const Table *t = l->tables + goal;
    const int d = l->d;
    Axes at;
    row_at(t, t->path, d, phase, at);
    for (int i = 0; i < d; i++) l->offset[i] = position[i] - at[i];
    const double off = length(l->offset, d);
    fill(l->expected, 0.0, d);
    fill(l->wanted, 0.0, d);
    fill(l->clock, 0.0, CLOCKS);
    l->clock[PHASE] = phase, l->clock[RATE] = waits > 0.0 ? 1.0 : 0.0, l->clock[WAITS] = waits, l->clock[GOAL] = goal;
    l->clock[FADING] = off > 0.0 ? most(FADES_OFFSET_S, 1.875 * off / (FADES_BELOW * most(t->top_speed, 1e-9))) : 0.0;
    l->clock[EASING] = !eases ? 0.0 : phase > 0.0 ? EASES_S : EASES_IN_S;
}

/* Whereabouts.reset */
static inline void where_reset(const Where *w, const Table *tables, int d, int n_goals, const double *position, int goal,
                               const double *entries) {
    Axes at;
    double total = 0.0;
    row_at(tables + goal, tables[goal].path, d, entries[goal], at);
    for (int i = 0; i < d; i++) w->offset[i] = position[i] - at[i];
    fill(w->p, 1e-3 / w->stations, w->stations);
    for (int g = 0; g < n_goals; g++) {
        int best = (int)w->first[g];
        double smallest = INFINITY;
        for (int m = best; m < (int)w->first[g + 1]; m++) {
            const double off = fabs(w->rows[m * w->width + 3 * d + AT_PHASE] - entries[g]);
            if (off < smallest) smallest = off, best = m;
        }
        w->p[best] += 1.0;
    }
    for (int m = 0; m < w->stations; m++) total += w->p[m];
    for (int m = 0; m < w->stations; m++) w->p[m] /= total;
    *w->until = 0.0, *w->goal = goal, *w->phase = entries[goal];
    tell(w, n_goals);
}

/* collaborate.believable */
static inline void believable(const double *x, double *out, int d) {
    for (int i = 0; i < d; i++) out[i] = x[i] != x[i] ? 0.0 : within(x[i], -ABSURD, ABSURD);
}

/* The part of `_enter` that both skills share: from rest at `x` to `goal`, at the nearest phase, or, where `last` [s] is a number, at
 * the nearest along the way to that. `entries` is room for a number a goal. Gives how far outside of what was taught that is [m]. */
static inline double enter_law(Law *l, const double *x, int goal, double last, double *entries) {
    const int d = l->d;
    double off = INFINITY;
    fill(l->shown_expected, 0.0, 8 * d + 6); /* of all its memory but what it was told */
    believable(x, l->position, d);
    copy(l->start, l->position, d);
    fill(l->compliance, 0.0, 4 * d + 4);
    for (int g = 0; g < l->n_goals; g++) {
        entries[g] = entry(l->tables + g, d, l->position, last);
        off = least(off, outside(l->tables + g, d, l->position));
    }
    where_reset(&l->where, l->tables, d, l->n_goals, l->position, goal, entries);
    if (l->foresight.plans) foresight_reset(&l->foresight, d, l->position, entries[goal] <= 0.0);
    start_pace(l, entries[goal], l->position, goal, l->law.start_delay, 1);
    l->shown_clock[PHASE] = entries[goal];
    return off;
}
