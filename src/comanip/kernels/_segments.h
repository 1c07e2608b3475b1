/* A hidden semi-Markov model, compiled once for each instruction set as _lanes.h is, with W, NAME and TARGET. Lanes are across frames
 * for densities and moments, across durations for the recursions; rows of durations are whole vectors, with zeros behind. */

#define vec NAME(vec)
#define FN TARGET static
#define INLINE TARGET static inline __attribute__((always_inline))

INLINE vec NAME(from)(const double *at) {
    vec v;
    memcpy(&v, at, sizeof v);
    return v;
}

/* The E-step of one sequence, alone; the twin is models/segments.py. With s_t the sum of alpha_t, c_t the power of two just above or
 * at 1 / s_t, and f_t(j) = c_{t-1} b_j(t)
 *     alpha_t(j, r) = f_t(j) [alpha_{t-1}(j, r + 1) + p_j(r) in_t(j)]    in_t(j) = sum_i alpha_{t-1}(i, 1) a_ij
 *     B_t(j, d) = f_t(j) B_{t+1}(j, d - 1), B_t(j, 1) = f_t(j) on_t(j)   on_t(i) = sum_j a_ij V_{t+1}(j), and behind the end 1 / s_T
 *     V_t(j) = sum_d p_j(d) B_t(j, d)                                    P(enters j at t) = in_t(j) V_t(j)
 * What falls below 1e-308 forwards is lost. Backwards it is still there, and may grow beyond float64; so that nothing was lost that
 * matters is seen at the first frame, where sum_j in(j) V(j) must come out as 1. */
FN void NAME(segments)(const Job *job, int64_t sequence, double *space, double *slot) {
    const Model *m = job->model;
    const int K = m->K, Ke = m->Ke, nv = m->nv, Kp = nv * W, BLOCK = TILES * W, L = job->longest, stride = L + 2 * W;
    const int64_t begin = job->starts[sequence], length = job->starts[sequence + 1] - begin;
    const int64_t padded = (length + BLOCK - 1) / BLOCK * BLOCK;
    double *b = space;                        /* [padded][Kp] */
    double *in = b + padded * Kp;             /* [padded][Kp]: in_t, then P(enters), then gamma */
    double *out = in + padded * Kp;           /* [padded][Kp]: alpha_t(i, 1), then P(leaves) */
    double *scale = out + padded * Kp;        /* [padded] */
    double *rows = scale + padded;            /* [K][stride]: W in front, L durations, W zeros */
    double *counts = rows + (size_t)K * stride; /* [K][L] */
    vec *steps = (vec *)(counts + (size_t)K * L); /* [K][nv] */
    vec *value = steps + K * nv, *onward = value + nv, *g = onward + nv; /* [nv] */
    vec *x = g + nv;                          /* [TILES][D + 1] */
    vec *tile = x + TILES * (m->D + 1);       /* [nv W or Ke][TILES], zero behind the last state */
    vec *pairs = tile + TILES * (Kp > Ke ? Kp : Ke); /* as in moments */
    double *bound = (double *)(pairs + (int64_t)Ke * m->pairs); /* [K]: no number in a row is larger; a row of zeros costs nothing */
    int64_t row[TILES * W];
    vec top[TILES];
    double tops = 0.0, s = 1.0;
    union { double number; int64_t bits; } r = {1.0};
    int64_t exponent = 0;
    job->failed[sequence] = 1;
    memset(rows, 0, sizeof(double) * K * stride);
    memset(bound, 0, sizeof(double) * K);
    memset(tile, 0, (char *)pairs - (char *)tile);
    for (int64_t t = 0; t < length; t++) {
        if (t % BLOCK == 0) {
            NAME(rows)(row, begin + t, begin + length);
            NAME(load)(m, job->frames, row, x);
            NAME(log_density)(m, x, tile);
            NAME(relative)(tile, K, top);
            for (int i = 0; i < BLOCK; i++)
                for (int j = 0; j < Kp; j++) b[(t + i) * Kp + j] = j < K ? ((double *)tile)[j * BLOCK + i] : 0.0;
        }
        tops += ((double *)top)[t % BLOCK];
        double *in_t = in + t * Kp, *out_t = out + t * Kp;
        if (t == 0) memcpy(in_t, m->initial, sizeof(double) * Kp);
        else NAME(across)((vec *)in_t, out_t - Kp, (const vec *)m->forward_across, K, nv);
        memset(out_t, 0, sizeof(double) * Kp);
        s = 0.0;
        for (int j = 0; j < K; j++) {
            if (!(in_t[j] > 0.0 || bound[j] > 0.0)) continue;
            const double f = b[t * Kp + j] * r.number, e = f * in_t[j], *p = job->durations + (size_t)j * L;
            double *alpha = rows + (size_t)j * stride + W;
            vec sums = {0};
            for (int d = 0; d < L; d += W) {
                const vec now = f * NAME(from)(alpha + d + 1) + e * NAME(from)(p + d);
                memcpy(alpha + d, &now, sizeof now);
                sums += now;
            }
            out_t[j] = alpha[0];
            s += bound[j] = NAME(sum)(sums);
        }
        if (!(s >= LEAST_SCALE)) return;
        exponent -= (r.bits >> 52) - 1023;
        r.number = s;
        r.bits = (2046LL << 52) - (r.bits & (2047LL << 52));
        scale[t] = r.number;
    }
    job->log_likelihood[sequence] = log(s) + ((double)exponent + tops) * M_LN2;

    memset(counts, 0, sizeof(double) * K * L);
    memset(steps, 0, sizeof(vec) * (K * nv + 3 * nv)); /* steps, value, onward, g */
    for (int j = 0; j < K; j++) {
        double *B = rows + (size_t)j * stride + W;
        for (int d = 0; d < L; d++) B[d] = 1.0 / s;
        bound[j] = 1.0 / s;
    }
    for (int64_t t = length - 1; t >= 0; t--) {
        double *in_t = in + t * Kp, *out_t = out + t * Kp, *on = (double *)onward, *V = (double *)value;
        const double c = t > 0 ? scale[t - 1] : 1.0;
        if (t == length - 1)
            for (int i = 0; i < nv; i++) onward[i] = NAME(all)(1.0 / s);
        else {
            NAME(across)(onward, V, (const vec *)m->backward_across, K, nv);
            for (int i = 0; i < K; i++)
                for (int j = 0; out_t[i] > 0.0 && j < nv; j++) steps[i * nv + j] += out_t[i] * value[j];
        }
        for (int j = 0; j < K; j++) {
            double *B = rows + (size_t)j * stride + W;
            const double *p = job->durations + (size_t)j * L, f = b[t * Kp + j] * c, e = in_t[j];
            out_t[j] *= on[j];
            in_t[j] = V[j] = 0.0;
            bound[j] = f * fmax(bound[j], on[j]);
            if (bound[j] == 0.0) {
                memset(B, 0, sizeof(double) * L);
                continue;
            }
            B[-1] = on[j];
            vec sums = {0};
            for (int d = L - W; d >= 0; d -= W) {
                const vec now = f * NAME(from)(B + d - 1);
                memcpy(B + d, &now, sizeof now);
                sums += NAME(from)(p + d) * now;
            }
            V[j] = NAME(sum)(sums);
            in_t[j] = e * V[j];
            if (in_t[j] > 1e-30)
                for (int d = 0; d < L; d++) counts[(size_t)j * L + d] += e * B[d];
        }
    }
    double total = 0.0;
    for (int j = 0; j < K; j++) total += in[j];
    if (!(fabs(total - 1.0) < 1e-10)) return; /* NaN compares false */
    job->failed[sequence] = 0;

    double *transitions = slot + (size_t)K * m->n_pairs, *first = transitions + K * K, *durations = first + K;
    for (int i = 0; i < K; i++)
        for (int j = 0; j < K; j++) transitions[i * K + j] += ((double *)(steps + i * nv))[j];
    for (int j = 0; j < K; j++) first[j] += in[j];
    for (size_t i = 0; i < (size_t)K * L; i++) durations[i] += counts[i];
    memset(pairs, 0, sizeof(vec) * Ke * m->pairs);
    memset(tile, 0, (char *)pairs - (char *)tile);
    for (int64_t t = 0; t < padded; t++) {
        vec *gamma = (vec *)(in + t * Kp), sums = {0};
        if (t < length) { /* a posterior changes only by what enters and what leaves */
            for (int i = 0; i < nv; i++) {
                g[i] += gamma[i];
                gamma[i] = NAME(larger)(g[i], (vec){0});
                sums += gamma[i];
            }
            const double share = 1.0 / NAME(sum)(sums);
            for (int i = 0; i < nv; i++) gamma[i] *= share, g[i] -= ((vec *)(out + t * Kp))[i];
            if (job->weights) memcpy(job->weights + (begin + t) * K, gamma, sizeof(double) * K);
        } else memset(gamma, 0, sizeof(vec) * nv);
        if (t % BLOCK == BLOCK - 1) {
            const int64_t from = t + 1 - BLOCK;
            for (int k = 0; k < K; k++)
                for (int i = 0; i < BLOCK; i++) ((double *)tile)[k * BLOCK + i] = in[(from + i) * Kp + k];
            NAME(rows)(row, begin + from, begin + length);
            NAME(load)(m, job->frames, row, x);
            NAME(moments)(m, pairs, tile, x);
        }
    }
    NAME(drain)(m, pairs, slot);
}

/* One tick of models/filtering.DurationFilter. Gives 0, with nothing changed, where that has to take over. */
FN int NAME(duration_tick)(Waiting *f, const double *xi, double rate) {
    const int D = f->D, K = f->K, L = f->L;
    double offset[MOST_CHANNELS], far = 0.0, best = -INFINITY;
    for (int d = 0; d < D; d++) {
        offset[d] = xi[d] - f->origin[d];
        far += offset[d] * offset[d];
    }
    const double passed = f->time[1] + (rate > 0.0 ? fmin(rate, L) : 0.0);
    const int whole = (int)(passed + 1e-9), first = f->state[FRESH] != 0.0;
    if (!(far < UNBELIEVABLE * UNBELIEVABLE) || (whole > 1 && !first)) return 0;
    const double *factor = f->factors, *centre = f->centres;
    for (int k = 0; k < K; k++) {
        double q = 0.0;
        for (int d = 0; d < D; d++, factor += D) {
            double z = -*centre++;
            for (int e = 0; e <= d; e++) z += offset[e] * factor[e];
            q += z * z;
        }
        f->log_b[k] = f->peak[k] - 0.5 * q;
        best = f->log_b[k] > best ? f->log_b[k] : best;
    }
    const double stay = 1.0 - f->forgets, little = f->forgets / K;
    for (int j = 0; j < K; j++) f->entered[j] = 0.0;
    for (int i = 0; i < K && whole; i++)
        for (int j = 0; j < K; j++) f->entered[j] += f->weights[i] * f->left[(size_t)i * L] * f->transition[i * K + j];
    double total = 0.0, top = 0.0;
    for (int j = 0; j < K; j++) {
        const double keep = stay * f->weights[j], enter = stay * f->entered[j] + little;
        const double *left = f->left + (size_t)j * L, *p = f->durations + (size_t)j * L;
        double *moved = f->moved + (size_t)j * L;
        vec sums = {0};
        for (int d = 0; d < L && !first; d += W) {
            vec old = {0};
            if (!whole) old = NAME(from)(left + d);
            else if (d + W < L) old = NAME(from)(left + d + 1);
            else memcpy(&old, left + d + 1, sizeof(double) * (W - 1));
            const vec now = keep * old + enter * NAME(from)(p + d);
            memcpy(moved + d, &now, sizeof now);
            sums += now;
        }
        f->predicted[j] = first ? f->initial[j] : NAME(sum)(sums);
        f->h[j] = f->predicted[j] * exp(fmax(f->log_b[j] - best, -f->gate));
        if (!(f->h[j] > 1e-290)) return 0; /* lost here it could matter later: only without a floor or a gate */
        total += f->h[j];
        top = f->h[j] > top ? f->h[j] : top;
    }
    const int hopeless = top < HOPELESS;
    if (hopeless && f->state[HOPELESS_TICKS] + 1.0 >= f->patience) return 0;
    f->state[FRESH] = 0.0;
    f->state[HOPELESS_TICKS] = hopeless ? f->state[HOPELESS_TICKS] + 1.0 : 0.0;
    f->state[LAST_LOG_LIKELIHOOD] = best + log(total);
    f->state[LOG_LIKELIHOOD] += f->state[LAST_LOG_LIKELIHOOD];
    for (int j = 0; j < K; j++) {
        f->weights[j] = f->h[j] / total;
        const double share = 1.0 / f->predicted[j];
        for (int d = 0; d < L && !first; d++) f->left[(size_t)j * L + d] = f->moved[(size_t)j * L + d] * share;
    }
    if (!first) f->time[1] = passed - whole;
    return 1;
}

#undef vec
#undef FN
#undef INLINE
#undef W
#undef NAME
#undef TARGET
