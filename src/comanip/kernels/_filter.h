/* Eq. (4) in plain loops, for who has no vectors: one tick of models.filtering.ForwardFilter, of channels that are all there.
 *
 * The compiled filter of Python sums its states in lanes, so that the weights agree to rounding and not to the last bit; no
 * command of the default law depends on them.
 */

#define HOPELESS_NATS 20.0
#define HOPELESS_SHARE 2.0611536224385579e-09 /* exp(-20) */
enum { FRESH, HOPELESS_TICKS, RESTARTS, LAST_LOG_LIKELIHOOD, LOG_LIKELIHOOD, FILTER_STATE };

typedef struct Level Level; /* of the extension: which vectors there are */

typedef struct {
    int D, K, patience;
    double gate;
    const double *origin, *factors, *centres, *peak, *initial, *chain; /* Whitening: (D), (K, D, D), (K, D), (K); and (K), (K, K) */
    double *weights, *state, *log_b, *h; /* what is remembered, (K) and FILTER_STATE; and room for one tick, (K) each */
} Tick;

static inline void filter_reset(const Tick *t) {
    copy(t->weights, t->initial, t->K);
    fill(t->state, 0.0, FILTER_STATE);
    t->state[FRESH] = 1.0;
}

static inline void filter_density(const Tick *t, const double *xi, double *log_b) {
    for (int k = 0; k < t->K; k++) {
        double q = 0.0;
        for (int n = 0; n < t->D; n++) {
            const double *row = t->factors + (k * t->D + n) * t->D;
            double z = -t->centres[k * t->D + n];
            for (int m = 0; m <= n; m++) z += (xi[m] - t->origin[m]) * row[m];
            q += z * z;
        }
        log_b[k] = t->peak[k] - 0.5 * q;
    }
}

/* What the weights would be without evidence */
static inline double filter_predicted(const Tick *t, int k) {
    if (t->state[FRESH] != 0.0) return t->initial[k];
    double sum = 0.0;
    for (int j = 0; j < t->K; j++) sum += t->weights[j] * t->chain[j * t->K + k];
    return sum;
}

/* h, its sum and its largest in logarithms, where products of densities would be lost; gives log of the scale that h was divided by */
static inline double filter_faint(const Tick *t, double best) {
    double top = -INFINITY;
    for (int k = 0; k < t->K; k++) {
        t->h[k] = most(t->log_b[k], best - t->gate) + logarithm(most(t->h[k], 1e-300));
        top = most(top, t->h[k]);
    }
    for (int k = 0; k < t->K; k++) t->h[k] = exponential(t->h[k] - top);
    return top;
}

/* StateFilter._step */
static inline int filter_tick(const Tick *t, const double *xi) {
    const int K = t->K;
    double best = -INFINITY, total = 0.0, largest = 0.0, scale;
    filter_density(t, xi, t->log_b);
    for (int k = 0; k < K; k++) best = most(best, t->log_b[k]);
    scale = best;
    for (int k = 0; k < K; k++) {
        t->h[k] = filter_predicted(t, k) * exponential(most(t->log_b[k] - best, -t->gate));
        largest = most(largest, t->h[k]);
        total += t->h[k];
    }
    if (!(total > 1e-250)) {
        for (int k = 0; k < K; k++) t->h[k] = filter_predicted(t, k);
        scale = filter_faint(t, best);
        total = 0.0, largest = scale < best - HOPELESS_NATS ? 0.0 : 1.0;
        for (int k = 0; k < K; k++) total += t->h[k];
    }
    t->state[FRESH] = 0.0;
    t->state[LAST_LOG_LIKELIHOOD] = scale + logarithm(total);
    t->state[LOG_LIKELIHOOD] += t->state[LAST_LOG_LIKELIHOOD];
    t->state[HOPELESS_TICKS] = largest < HOPELESS_SHARE ? t->state[HOPELESS_TICKS] + 1.0 : 0.0;
    if (t->state[HOPELESS_TICKS] >= t->patience) {
        t->state[HOPELESS_TICKS] = 0.0;
        t->state[RESTARTS] += 1.0;
        total = 0.0;
        for (int k = 0; k < K; k++) t->h[k] = exponential(t->log_b[k] - best), total += t->h[k];
    }
    for (int k = 0; k < K; k++) t->weights[k] = t->h[k] / total;
    return 1;
}
