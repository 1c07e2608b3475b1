/* skills/reference.py once more: a path that was taught, and where a start on it enters. */

typedef struct { /* PhaseReference: one goal's path, (rows, d) each; way, gain (rows). Of its plans: (rows, 3 d), (rows), (d) */
    int rows;
    double step_s, duration_s, top_speed, slack, place, extent, begins;
    const double *path, *velocity, *force, *way, *gain, *plan, *plan_way, *heading;
} Table;

#define AS_NEAR 0.15
#define PLACES 200

/* PhaseReference.floats_at */
static inline void row_at(const Table *t, const double *table, int d, double phase, double *out) {
    const double place = within(phase / t->step_s, 0.0, (double)(t->rows - 1));
    const int n = (int)place < t->rows - 2 ? (int)place : t->rows - 2;
    const double share = place - n;
    for (int i = 0; i < d; i++) out[i] = (1.0 - share) * table[n * d + i] + share * table[(n + 1) * d + i];
}

/* PhaseReference.that_way */
static inline void that_way(const Table *t, int d, const double *x, const double *velocity, double *taught) {
    const int every = 1 + t->rows / PLACES;
    const double speed = length(velocity, d);
    double fastest = 0.0;
    for (int n = 0; n < t->rows && !(speed < 1e-6); n += every) {
        double far = 0.0, along = 0.0;
        for (int i = 0; i < d; i++) {
            const double off = t->path[n * d + i] - x[i];
            far += off * off;
            along += t->velocity[n * d + i] * velocity[i];
        }
        if (far < t->place * t->place) fastest = most(fastest, along);
    }
    const double share = speed < 1e-6 ? 0.0 : fastest / (speed * speed);
    for (int i = 0; i < d; i++) taught[i] = velocity[i] * share;
}

/* PhaseReference.remaining_m */
static inline double remaining(const Table *t, double phase) {
    double gone;
    row_at(t, t->way, 1, phase, &gone);
    return t->way[t->rows - 1] - gone;
}

/* PhaseReference.closest */
static inline double closest(const Table *t, int d, const double *position, double near, double reach) {
    int low = (int)most((near - reach) / t->step_s, 0.0);
    int high = (int)least((near + reach) / t->step_s, (double)t->rows) + 2;
    if (high > t->rows) high = t->rows;
    if (low > high - 1) low = high - 1;
    int best = low;
    double smallest = INFINITY;
    for (int n = low; n < high; n++) {
        double apart = 0.0;
        for (int i = 0; i < d; i++) {
            const double off = t->path[n * d + i] - position[i];
            apart += off * off;
        }
        if (apart < smallest) smallest = apart, best = n;
    }
    return best * t->step_s;
}

/* PhaseReference._along */
static inline void path_along(const Table *t, int d, double way, double *out) {
    const int last = t->rows - 1;
    int low = 0, high = t->rows;
    if (way >= t->way[last] || way <= t->way[0]) {
        copy(out, t->path + (way >= t->way[last] ? last : 0) * d, d);
        return;
    }
    while (low < high) { /* bisect_right */
        const int middle = (low + high) / 2;
        if (way < t->way[middle]) high = middle;
        else low = middle + 1;
    }
    const int n = low - 1;
    const double share = (way - t->way[n]) / (t->way[n + 1] - t->way[n]);
    for (int i = 0; i < d; i++) out[i] = (1.0 - share) * t->path[n * d + i] + share * t->path[(n + 1) * d + i];
}

/* PhaseReference.heading */
static inline void heading_at(const Table *t, int d, double phase, double *out) {
    const double ahead = 0.1 * t->extent;
    double gone;
    Axes here;
    row_at(t, t->way, 1, phase, &gone);
    gone = least(gone, t->way[t->rows - 1] - ahead);
    path_along(t, d, gone, here);
    path_along(t, d, gone + ahead, out);
    for (int i = 0; i < d; i++) out[i] -= here[i];
    const double size = most(length(out, d), 1e-300);
    for (int i = 0; i < d; i++) out[i] /= size;
}

/* PhaseReference.outside_m */
static inline double outside(const Table *t, int d, const double *x) {
    double nearest = INFINITY;
    for (int n = 0; n < t->rows; n++) nearest = least(nearest, apart(t->path + n * d, x, d));
    return nearest;
}

/* PhaseReference.entry; `last` NaN: for the first time */
static inline double entry(const Table *t, int d, const double *x, double last) {
    if (last != last && apart(t->path, x, d) <= t->begins) return 0.0;
    const double within_m = outside(t, d, x) + AS_NEAR * t->extent;
    const double was = last == last ? t->way[t->rows - 1] - remaining(t, last) : 0.0;
    double off = INFINITY;
    int chosen = 0;
    for (int n = 0; n < t->rows;) { /* part by part that is as near */
        double smallest = apart(t->path + n * d, x, d);
        if (!(smallest <= within_m)) {
            n++;
            continue;
        }
        int best = n;
        for (n++; n < t->rows; n++) {
            const double far = apart(t->path + n * d, x, d);
            if (!(far <= within_m)) break;
            if (far < smallest) smallest = far, best = n;
        }
        if (last != last) return best * t->step_s;
        if (fabs(t->way[best] - was) < off) off = fabs(t->way[best] - was), chosen = best;
    }
    return chosen * t->step_s;
}
