/* interaction.py once more: eq. (3) on line, F = F_s + s m (a - g), after the object was weighed (TaringInteractionForce). */

#define MAX_FORCE 1e6
#define MOST_GAP_S 0.05

typedef struct { /* numbers that do not change */
    double dt, mass, share, moving; /* of the object as stated [kg], this hand's share, [m/s] */
    double b0, b1, b2, a1, a2;      /* of the low-pass */
    double blend;                   /* of a wait between two ticks */
    Axes gravity;
    int d, ticks, late, average;    /* of the tare; of the acceleration; samples are averaged over a tick */
} Weighing;

typedef struct { /* what is remembered; `past` is (d, late + 2) elsewhere */
    double weighed, left, count, gap, longest, gaps, good_s, payload;
    Axes sum, last, load, offset, velocity, force, elapsed, sample, age, s1, s2, started;
} Weighed;

/* TaringInteractionForce.reset */
static inline void estimate_reset(const Weighing *w, Weighed *m) {
    m->weighed = m->count = m->gap = m->longest = m->gaps = m->good_s = 0.0;
    m->left = w->ticks, m->payload = w->mass;
    fill(m->sum, 0.0, w->d);
    fill(m->last, NAN, w->d);
}

/* TaringInteractionForce._weighs */
static inline int weighs(const Weighing *w, Weighed *m, const double *sensed) {
    int missing = 0;
    for (int i = 0; i < w->d; i++) missing += sensed[i] != sensed[i];
    if (m->count > 0.0 && missing == w->d && m->gap < MOST_GAP_S / w->dt) {
        m->gap += 1.0;
        return 1;
    }
    if (!all_finite(sensed, w->d)) return 0;
    m->gaps += m->gap > 0.0, m->longest = most(m->longest, m->gap), m->gap = 0.0;
    for (int i = 0; i < w->d; i++) m->sum[i] += sensed[i];
    m->count += 1.0;
    copy(m->last, sensed, w->d);
    return 1;
}

/* TaringInteractionForce._weighed, and CausalInteractionForce.reset and begin */
static inline void weighed(const Weighing *w, Weighed *m, double *past) {
    const int d = w->d;
    const double g2 = dot(w->gravity, w->gravity, d);
    Axes bias = {0}, mean;
    if (m->count >= 3.0 && g2 > 0.0) {
        for (int i = 0; i < d; i++) mean[i] = m->sum[i] / m->count;
        m->payload = most(dot(mean, w->gravity, d) / g2 / w->share, 0.0);
        for (int i = 0; i < d; i++) bias[i] = mean[i] - w->share * m->payload * w->gravity[i];
    }
    for (int i = 0; i < d; i++) {
        m->load[i] = w->share * m->payload;
        m->offset[i] = -m->load[i] * w->gravity[i] - bias[i];
        m->velocity[i] = m->force[i] = NAN;
        m->elapsed[i] = m->s1[i] = m->s2[i] = m->started[i] = 0.0;
        m->sample[i] = m->last[i], m->age[i] = m->gap * w->dt;
    }
    m->good_s = 1.5 * (m->gaps >= 3.0 ? (m->longest + 1.0) * w->dt : 0.0);
    fill(past, 0.0, d * (w->late + 2));
    m->weighed = 1.0;
}

/* Lowpass.step */
static inline double lowpass(const Weighing *w, Weighed *m, int i, double value) {
    if (m->started[i] == 0.0) m->started[i] = 1.0, m->s1[i] = value * (1.0 - w->b0), m->s2[i] = value * (w->b2 - w->a2);
    const double out = w->b0 * value + m->s1[i];
    m->s1[i] = w->b1 * value - w->a1 * out + m->s2[i];
    m->s2[i] = w->b2 * value - w->a2 * out;
    return out;
}

/* CausalInteractionForce.step on one axis */
static inline double estimated(const Weighing *w, Weighed *m, double *past, int i, double sample, double velocity) {
    m->age[i] = sample != sample ? m->age[i] + w->dt : 0.0;
    if (sample == sample) m->sample[i] = sample;
    double force = m->age[i] <= m->good_s ? m->sample[i] : sample;
    m->elapsed[i] += w->dt;
    if (!(-MAX_FORCE < force && force < MAX_FORCE && is_finite(velocity))) return NAN;
    const double before = m->velocity[i], last = m->force[i];
    double acceleration = before != before ? 0.0 : (velocity - before) / m->elapsed[i];
    m->velocity[i] = velocity, m->force[i] = force, m->elapsed[i] = 0.0;
    for (int n = w->late + 1; n > 0; n--) past[n] = past[n - 1];
    past[0] = acceleration;
    acceleration = past[w->late] + w->blend * (past[w->late + 1] - past[w->late]);
    if (w->average && last == last) force = 0.5 * (force + last);
    return lowpass(w, m, i, force + m->load[i] * acceleration + m->offset[i]);
}

/* TaringInteractionForce.step; F into `out` */
static inline void estimate(const Weighing *w, Weighed *m, double *past, const double *velocity, const double *sensed, double *out) {
    if (m->weighed == 0.0) {
        int at_rest = 1;
        for (int i = 0; i < w->d; i++) at_rest &= fabs(velocity[i]) < w->moving;
        m->left -= 1.0;
        if (m->left >= 0.0 && at_rest && weighs(w, m, sensed)) {
            fill(out, 0.0, w->d);
            return;
        }
        weighed(w, m, past);
    }
    for (int i = 0; i < w->d; i++) out[i] = estimated(w, m, past + i * (w->late + 2), i, sensed[i], velocity[i]);
}
