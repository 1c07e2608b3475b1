/* The recursions, written once and compiled once for each instruction set and precision: _native.c includes this file with
 *
 *     W         numbers in one vector
 *     SINGLE    where they are float32: then what must be quick with very many frames, and no decoding and nothing on line
 *     NAME(x)   x with the instruction set's name behind it
 *     TARGET    __attribute__((target(...))), or nothing
 *     LARGER    a > b ? a : b of two vectors in one instruction, where no compiler finds it by itself; and SMALLER
 *
 * A `vec` holds one number for each of W lanes. Where there are many sequences, a lane is a sequence (several, one after another,
 * when they differ in length); where there is one, a lane is a frame for the densities and moments, and a state for the
 * recursions. TILES vectors are worked on together, so that the latency of one multiplication hides behind seven others: arrays
 * come in blocks [index][TILES], whose distances in memory the compiler knows.
 */

#ifdef SINGLE
typedef float NAME(real);
typedef int32_t NAME(whole);
#define MANTISSA 23           /* bits of it */
#define BIAS 127              /* of the exponent behind it */
#define LEAST_EXPONENT -115.0f /* no density is smaller beside the best: a path may be lost, but not for good, see group */
#define LEAST_LOG_DENSITY (-1e30f * (float)M_LOG2E)
#define FAINTEST -4e4f        /* below it the rounding of a log-density moves weights by 1 %: the sequence goes to float64 */
#define LEAST_SCALE 1e-18f    /* half of the digits of the exponent: what was lost under 1e-38 is as far below */
#define LEAST_SUM 1e-30f
#define MOST_FUTURE 1e37f
#define LOST 1e-2f
#else
typedef double NAME(real);
typedef long long NAME(whole);
#define MANTISSA 52
#define BIAS 1023
#define LEAST_EXPONENT -995.0
#define LEAST_LOG_DENSITY (-1e100 * M_LOG2E) /* as in models/gaussian.py */
#define FAINTEST -INFINITY
#define LEAST_SCALE 1e-280 /* below it what was lost under 1e-308 could matter: the sequence goes to the logarithmic twin */
#define LEAST_SUM 1e-300
#define MOST_FUTURE 1e306
#define LOST 1e-6 /* what the past may have lost: see group */
#endif
#define real NAME(real)
#define whole NAME(whole)
#define ONE ((whole)BIAS << MANTISSA) /* the bits of 1.0 */
typedef real NAME(vec) __attribute__((vector_size(sizeof(real) * W)));
typedef whole NAME(ivec) __attribute__((vector_size(sizeof(real) * W)));
typedef double NAME(wide) __attribute__((vector_size(sizeof(double) * W)));
#define vec NAME(vec)
#define ivec NAME(ivec)
#define FN TARGET static
#define INLINE TARGET static inline __attribute__((always_inline))
#if W == 16
#define EACH(at) \
    (vec){at(0), at(1), at(2), at(3), at(4), at(5), at(6), at(7), at(8), at(9), at(10), at(11), at(12), at(13), at(14), at(15)}
#define LOWER(a, b) SHUFFLE(a, b, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23)
#define UPPER(a, b) SHUFFLE(a, b, 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31)
#elif W == 8
#define EACH(at) (vec){at(0), at(1), at(2), at(3), at(4), at(5), at(6), at(7)}
#define LOWER(a, b) SHUFFLE(a, b, 0, 8, 1, 9, 2, 10, 3, 11)
#define UPPER(a, b) SHUFFLE(a, b, 4, 12, 5, 13, 6, 14, 7, 15)
#elif W == 4
#define EACH(at) (vec){at(0), at(1), at(2), at(3)}
#define LOWER(a, b) SHUFFLE(a, b, 0, 4, 1, 5)
#define UPPER(a, b) SHUFFLE(a, b, 2, 6, 3, 7)
#else
#define EACH(at) (vec){at(0), at(1)}
#define LOWER(a, b) SHUFFLE(a, b, 0, 2)
#define UPPER(a, b) SHUFFLE(a, b, 1, 3)
#endif
#define SELECT(mask, yes, no) ((vec)(((ivec)(mask) & (ivec)(yes)) | (~(ivec)(mask) & (ivec)(no))))

INLINE vec NAME(all)(real x) { return x - (vec){0}; }

#ifdef LARGER
INLINE vec NAME(larger)(vec a, vec b) { return LARGER(a, b); }
INLINE vec NAME(smaller)(vec a, vec b) { return SMALLER(a, b); }
#else
INLINE vec NAME(larger)(vec a, vec b) { return SELECT(a > b, a, b); }
INLINE vec NAME(smaller)(vec a, vec b) { return SELECT(a < b, a, b); }
#endif

INLINE vec NAME(gather)(const real *from, ptrdiff_t stride) {
#define AT(l) from[(l) * stride]
    return EACH(AT);
#undef AT
}

INLINE real NAME(sum)(vec v) { /* half by half: the shortest way */
#if W == 16
    const Eight32 eight = ((Eight32 *)&v)[0] + ((Eight32 *)&v)[1];
    const Four32 four = ((Four32 *)&eight)[0] + ((Four32 *)&eight)[1];
#elif W == 8 && defined(SINGLE)
    const Four32 four = ((Four32 *)&v)[0] + ((Four32 *)&v)[1];
#elif W == 8
    const Four four = ((Four *)&v)[0] + ((Four *)&v)[1];
#elif W == 4
    const vec four = v;
#else
    return v[0] + v[1];
#endif
#if W > 2
    return (four[0] + four[2]) + (four[1] + four[3]);
#endif
}

INLINE ivec NAME(mask)(unsigned bits) {
    ivec m;
    for (int l = 0; l < W; l++) m[l] = -(whole)(bits >> l & 1);
    return m;
}

/* 2^x for LEAST_EXPONENT <= x <= 0, to 4e-14 (5e-9 and the rounding of float32): 2^n (1 + f q(f)) with |f| <= 1/2. q is the
 * interpolation of (2^f - 1) / f in 9 (6) Chebyshev nodes; the form makes 2^0 exactly 1. Logarithms are to the base of 2 wherever
 * they are many: then only the polynomial costs multiplications. */
INLINE vec NAME(exp2)(vec x) {
#ifdef SINGLE
    const real q[] = {6.931472e-1f, 2.4022651e-1f, 5.550357e-2f, 9.618083e-3f, 1.3390863e-3f, 1.5453163e-4f};
#else
    const real q[] = {0x1.62e42fefa39efp-1, 0x1.ebfbdff823cedp-3, 0x1.c6b08d7047e52p-5, 0x1.3b2ab7181b755p-7, 0x1.5d87fe86fe88ep-10,
                      0x1.4308ac85aa947p-13, 0x1.ffcb9515a8016p-17, 0x1.63d136366db24p-20, 0x1.b63880a30e9ffp-24};
#endif
    const real magic = (real)3 * ((whole)1 << (MANTISSA - 1)); /* adding it leaves the nearest whole number in the low bits */
    const vec shifted = x + magic, f = x - (shifted - magic);
    vec p = NAME(all)(q[sizeof q / sizeof *q - 1]);
    for (int i = sizeof q / sizeof *q - 2; i >= 0; i--) p = p * f + q[i];
    p = p * f + 1.0;
    return (vec)((ivec)p + ((ivec)shifted << MANTISSA));
}

/* W vectors a become their transpose: a[i][l] and a[l][i] change places. Each round is a perfect shuffle of all W x W numbers. */
INLINE void NAME(transpose)(vec *a) {
    for (int n = W; n > 1; n /= 2) {
        vec b[W];
        for (int i = 0; i < W / 2; i++) b[2 * i] = LOWER(a[i], a[i + W / 2]), b[2 * i + 1] = UPPER(a[i], a[i + W / 2]);
        for (int i = 0; i < W; i++) a[i] = b[i];
    }
}

/* ------------------------------------------------------------------------------------------------ densities */

/* Frames `row` (TILES x W of them, -1 for none) become a block x [D + 1][TILES], around the model's origin, with a last 1:
 * moments of (x, 1) hold occupancy, sums and products at once. */
FN void NAME(load)(const Model *m, const double *frames, const int64_t *row, vec *x) {
    const int D = m->D;
    for (int b = 0; b < TILES; b++, row += W) {
        const double *from[W];
        for (int l = 0; l < W; l++) {
            from[l] = row[l] < 0 ? m->origin : frames + row[l] * D;
            __builtin_prefetch(from[l] + 2 * TILES * D); /* W sequences at once are more than a processor foresees */
        }
#define AT(l) (real)(from[l][d] - m->origin[d])
        for (int d = 0; d < D; d++) x[d * TILES + b] = EACH(AT);
#undef AT
        x[D * TILES + b] = NAME(all)(1.0);
    }
}

/* log2 N(x; mu_k, Sigma_k) of a block: out [K][TILES]. The inverse Cholesky factor is a triangle: D^2 / 2 products. It and the centre
 * come times sqrt(log2(e) / 2), so that z^2 is the exponent itself. */
FN void NAME(log_density)(const Model *m, const vec *x, vec *out) {
    const int D = m->D;
    const real *factor = m->factors, *centre = m->centres, *peak = m->peak;
    for (int k = 0; k < m->K; k++, out += TILES) {
        vec q[TILES];
        for (int b = 0; b < TILES; b++) q[b] = NAME(all)(peak[k]);
        for (int d = 0; d < D; d++) {
            vec z[TILES];
            const vec *xe = x;
            for (int b = 0; b < TILES; b++) z[b] = NAME(all)(-*centre);
            centre++;
            for (const real *row_end = factor + d + 1; factor < row_end; factor++, xe += TILES)
                for (int b = 0; b < TILES; b++) z[b] += *factor * xe[b];
            for (int b = 0; b < TILES; b++) q[b] -= z[b] * z[b];
        }
        for (int b = 0; b < TILES; b++) out[b] = NAME(larger)(q[b], NAME(all)(LEAST_LOG_DENSITY));
    }
}

/* Log-densities of a block [K][TILES] become densities relative to the best state, whose logarithm goes to `top`. Only ratios
 * between states matter, so a frame that nothing explains (1e5 N) keeps a finite meaning. */
FN void NAME(relative)(vec *b, int K, vec *top) {
    for (int t = 0; t < TILES; t++) top[t] = b[t];
    for (vec *at = b + TILES; at < b + K * TILES; at += TILES)
        for (int t = 0; t < TILES; t++) top[t] = NAME(larger)(top[t], at[t]);
    for (vec *at = b; at < b + K * TILES; at += TILES)
        for (int t = 0; t < TILES; t++) at[t] = NAME(exp2)(NAME(larger)(at[t] - top[t], NAME(all)(LEAST_EXPONENT)));
}

/* Of the least relative density only a bound is known. Forwards it is none: this is taken off, of any other nothing (and a last digit
 * that a compiler rounds otherwise is a denormal). Backwards it counts, so that it is seen if it matters. */
INLINE vec NAME(untold)(void) { return NAME(exp2)(NAME(all)(LEAST_EXPONENT)); }

/* Sum of logarithms, kept as a product whose exponent is taken off at each step: no log() in the loop. */
typedef struct { vec mantissa; ivec exponent; double shift[W]; } NAME(LogSum);
#define LogSum NAME(LogSum)

INLINE void NAME(add_log)(LogSum *sum, vec factor, vec shift) {
    const ivec bits = (ivec)(sum->mantissa * factor);
    sum->exponent += (bits >> MANTISSA) - BIAS;
    sum->mantissa = (vec)((bits & (((whole)1 << MANTISSA) - 1)) | ONE);
    for (int l = 0; l < W; l++) sum->shift[l] += shift[l];
}

static inline double NAME(take_log)(LogSum *sum, int lane) {
    return log(sum->mantissa[lane]) + ((double)sum->exponent[lane] + sum->shift[lane]) * M_LN2;
}

INLINE LogSum NAME(no_log)(void) { return (LogSum){NAME(all)(1.0), (ivec){0}, {0.0}}; }

/* -------------------------------------------------------------------------------------------------- moments */

INLINE void NAME(corner)(vec *sums, ptrdiff_t stride, const vec *a, const vec *b, const int rows, const int columns) {
    vec s[4][6];
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < columns; j++) s[i][j] = sums[i * stride + j];
    for (int t = 0; t < TILES; t++)
        for (int i = 0; i < rows; i++)
            for (int j = 0; j < columns; j++) s[i][j] += a[i * TILES + t] * b[j * TILES + t];
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < columns; j++) sums[i * stride + j] = s[i][j];
}

/* sums[i][j] += sum over t of a[i][t] b[j][t], lane by lane; both counts even. A corner of the sums stays in registers while the
 * block passes: at most one load a product instead of two loads and a store. AVX-512 has registers for 4 x 6. */
FN void NAME(outer)(vec *sums, ptrdiff_t stride, const vec *a, int n_a, const vec *b, int n_b) {
    int i = 0;
    for (; sizeof(vec) == 64 && i + 4 <= n_a; i += 4, a += 4 * TILES, sums += 4 * stride) {
        int j = 0;
        for (; j + 6 <= n_b; j += 6) NAME(corner)(sums + j, stride, a, b + j * TILES, 4, 6);
        for (; j + 4 <= n_b; j += 4) NAME(corner)(sums + j, stride, a, b + j * TILES, 4, 4);
        for (; j < n_b; j += 2) NAME(corner)(sums + j, stride, a, b + j * TILES, 4, 2);
    }
    for (; i < n_a; i += 2, a += 2 * TILES, sums += 2 * stride) {
        int j = 0;
        for (; j + 6 <= n_b; j += 6) NAME(corner)(sums + j, stride, a, b + j * TILES, 2, 6);
        for (; j + 4 <= n_b; j += 4) NAME(corner)(sums + j, stride, a, b + j * TILES, 2, 4);
        for (; j < n_b; j += 2) NAME(corner)(sums + j, stride, a, b + j * TILES, 2, 2);
    }
}

#define MOST_ROWS (sizeof(vec) == 64 ? 10 : 6) /* of moments that registers hold, times two */

/* Of how many states the moments are summed together, from state k on. */
INLINE int NAME(rows_from)(const Model *m, int k) {
    const int blocks = (m->Ke - k + MOST_ROWS - 1) / MOST_ROWS;
    return 2 * ((m->Ke - k + 2 * blocks - 1) / (2 * blocks));
}

/* sums[p][r] += sum over a block of weight[r] x_i x_j, for the p-th pair (i, j) and `rows` states. Two pairs at a time stay in
 * registers while the block passes, and a product is made where it is used: none is stored. */
INLINE void NAME(some_moments)(const Model *m, vec *sums, const vec *weight, const vec *x, const int rows) {
    const ptrdiff_t *of = m->pair;
    for (const vec *end = sums + m->pairs * rows; sums < end; sums += 2 * rows, of += 4) {
        const vec *i = x + of[0], *j = x + of[1], *k = x + of[2], *l = x + of[3];
        vec s[20];
#pragma GCC unroll 20
        for (int r = 0; r < 2 * rows; r++) s[r] = sums[r];
        for (int t = 0; t < TILES; t++) {
            const vec one = i[t] * j[t], other = k[t] * l[t];
#pragma GCC unroll 10
            for (int r = 0; r < rows; r++) {
                vec w = weight[r * TILES + t];
                HOLD(w);
                s[r] += w * one, s[rows + r] += w * other;
            }
        }
#pragma GCC unroll 20
        for (int r = 0; r < 2 * rows; r++) sums[r] = s[r];
    }
}

/* sums += sum over a block of weight[k] (x, 1)(x, 1)^T, upper triangle row by row: [pairs][rows] for one lot of states after another. */
FN void NAME(moments)(const Model *m, vec *sums, const vec *weight, const vec *x) {
    for (int k = 0, rows; k < m->Ke; k += rows, sums += m->pairs * rows, weight += rows * TILES) {
        rows = NAME(rows_from)(m, k);
        if (MOST_ROWS == 10 && rows == 10) NAME(some_moments)(m, sums, weight, x, 10);
        else if (MOST_ROWS == 10 && rows == 8) NAME(some_moments)(m, sums, weight, x, 8);
        else if (rows == 6) NAME(some_moments)(m, sums, weight, x, 6);
        else if (rows == 4) NAME(some_moments)(m, sums, weight, x, 4);
        else NAME(some_moments)(m, sums, weight, x, 2);
    }
}

FN void NAME(add_lanes)(const vec *from, int stride, int n_rows, int n_columns, double *to) {
    for (int i = 0; i < n_rows; i++)
        for (int j = 0; j < n_columns; j++) to[i * n_columns + j] += NAME(sum)(from[i * stride + j]);
}

/* The moments join `slot` [K][n_pairs] and begin anew: often enough, float32 sums lose nothing. */
FN void NAME(drain)(const Model *m, vec *sums, double *slot) {
    for (int k = 0, rows; k < m->Ke; k += rows, sums += m->pairs * rows) {
        rows = NAME(rows_from)(m, k);
        for (int r = 0; r < rows && k + r < m->K; r++)
            for (int p = 0; p < m->n_pairs; p++) slot[(k + r) * m->n_pairs + p] += NAME(sum)(sums[p * rows + r]);
        memset(sums, 0, sizeof(vec) * m->pairs * rows);
    }
}

/* n <= W numbers. The usual n = W has a branch of its own: then a compiler needs no call. */
INLINE void NAME(put)(double *to, vec v, int n) {
    const NAME(wide) all = __builtin_convertvector(v, NAME(wide));
    if (n == W) memcpy(to, &all, sizeof all);
    else for (int i = 0; i < n; i++) to[i] = v[i];
}

/* n rows of a block [n][TILES] leave for each lane's own array, where they are n numbers side by side; for no lane where it is NULL. */
INLINE void NAME(leave)(const vec *block, double *const *to, int n) {
    for (int c = 0; c < n; c += W) {
        const int some = n - c < W ? n - c : W;
        vec a[W];
        for (int r = 0; r < W; r++) a[r] = block[(c + r) * TILES];
        NAME(transpose)(a);
        for (int l = 0; l < W; l++) {
            if (!to[l]) continue;
            NAME(put)(to[l] + c, a[l], some);
            for (int i = c; i < c + W; i += LINE) __builtin_prefetch(to[l] + n + i + LINE, 1);
        }
    }
}

/* -------------------------------------------------------------------------------------- sequences side by side */

/* s[j] = sum_i in[i] matrix[i][j] for n columns, in every lane; `in` is a column of a block. */
INLINE void NAME(columns)(vec *s, const vec *in, const real *matrix, int K, ptrdiff_t stride, const int n) {
    for (int j = 0; j < n; j++) s[j] = (vec){0};
    for (const vec *end = in + K * TILES; in < end; in += TILES, matrix += stride)
        for (int j = 0; j < n; j++) s[j] += matrix[j] * *in;
}

/* alpha_t of n states, and their sum added to `sums`, before they leave their registers. */
INLINE void NAME(some_forwards)(vec *alpha, const vec *before, const real *chain, const vec *b, vec untold, vec r, int K, int Ke, vec *sums,
                                const int n) {
    vec s[6];
    NAME(columns)(s, before, chain, K, Ke, n);
    for (int i = 0; i < n; i++) sums[i & 1] += alpha[i * TILES] = s[i] * ((b[i * TILES] - untold) * r);
}

INLINE vec NAME(forwards)(vec *alpha, const vec *before, const real *chain, const vec *b, vec untold, vec r, int K, int Ke) {
    vec sums[2] = {{0}};
    int j = 0;
    for (; j + 6 <= Ke; j += 6) NAME(some_forwards)(alpha + j * TILES, before, chain + j, b + j * TILES, untold, r, K, Ke, sums, 6);
    for (; j + 4 <= Ke; j += 4) NAME(some_forwards)(alpha + j * TILES, before, chain + j, b + j * TILES, untold, r, K, Ke, sums, 4);
    for (; j < Ke; j += 2) NAME(some_forwards)(alpha + j * TILES, before, chain + j, b + j * TILES, untold, r, K, Ke, sums, 2);
    return sums[0] + sums[1];
}

typedef struct { vec *beta, *gamma, *v; const vec *alpha, *b; } NAME(Back);

/* beta_t, gamma_t and v_t of n states from state j on; gives the largest v_t there was. */
INLINE vec NAME(some_backwards)(const NAME(Back) *to, int j, const vec *after, const real *chain, vec r, vec brightest, int K, int Ke,
                                const int n) {
    vec s[6];
    NAME(columns)(s, after, chain + j, K, Ke, n);
    for (int i = 0; i < n; i++) {
        const int at = (j + i) * TILES;
        const vec future = s[i] * (to->b[at] * r);
        to->beta[j + i] = s[i];
        to->gamma[at] = to->alpha[at] * s[i];
        brightest = NAME(larger)(brightest, future);
        to->v[at] = NAME(smaller)(future, NAME(all)(MOST_FUTURE));
    }
    return brightest;
}

INLINE vec NAME(backwards)(const NAME(Back) *to, const vec *after, const real *chain, vec r, vec brightest, int K, int Ke) {
    int j = 0;
    for (; j + 6 <= Ke; j += 6) brightest = NAME(some_backwards)(to, j, after, chain, r, brightest, K, Ke, 6);
    for (; j + 4 <= Ke; j += 4) brightest = NAME(some_backwards)(to, j, after, chain, r, brightest, K, Ke, 4);
    for (; j < Ke; j += 2) brightest = NAME(some_backwards)(to, j, after, chain, r, brightest, K, Ke, 2);
    return brightest;
}

/* One group of pieces in W lanes. With a break before frame t the chain starts anew in that lane.
 *
 * Scaled recursions: with s_t the sum of alpha_t and r_t the power of two just above or at 1 / s_t
 *     alpha_t(j) = sum_i alpha_{t-1}(i) a_ij  b_j(t) r_{t-1}     beta_t(i) = sum_j a_ij v_{t+1}(j)
 *     v_{t+1}(j) = b_j(t+1) beta_{t+1}(j) r_t                    gamma_t(i) = alpha_t(i) beta_t(i)
 *     xi_t(i, j) = alpha_t(i) a_ij v_{t+1}(j)                    log p = log s_T - sum_t log r_t
 * A power of two costs no division and no rounding, its logarithm is a whole number, and it is made beside the next product, not
 * between the two. beta starts as 1 / s_T and is at most 1 / alpha: it cannot overflow where alpha is not 0.
 *
 * A path that falls below 1e-308 of the others is lost forwards, though it may turn out the best: a hand that was held beside its
 * state for long. Backwards it is still there, up to MOST_FUTURE, which no state has that can be left out; so that nothing was
 * lost that matters is seen at the first frame, where sum_k Pi_k b_k beta_k must come out as 1. Else the twin takes the sequence.
 *
 * A piece of a sequence starts from anywhere and ends anyhow, in margins that are silent in the sums. What it says at its seams is
 * kept, so that its neighbours can be asked whether they agree. */
FN void NAME(group)(const Job *job, int g, double *space, double *slot) {
    const Model *m = job->model;
    const int K = m->K, Ke = m->Ke, step = m->D + 1, all = (1 << W) - 1;
    const real *initial = m->initial;
    const int64_t *lane = job->lanes + (int64_t)g * W;
    int64_t length = 0, shortest = INT64_MAX, next[W];
    ivec ends;
    for (int l = 0; l < W; l++) {
        int64_t n = 0;
        for (int64_t o = lane[l]; o < lane[l + 1]; o++) {
            n += job->pieces[job->order[o]].end - job->pieces[job->order[o]].begin;
            job->log_likelihood[job->order[o]] = 0.0;
        }
        ends[l] = (whole)n;
        next[l] = lane[l];
        if (n > length) length = n;
        if (n < shortest) shortest = n;
    }
    length = (length + TILES - 1) / TILES * TILES;

    vec *x = (vec *)space;               /* blocks [D + 1][TILES] */
    vec *ab = x + length * step;         /* blocks [2 Ke][TILES]: alpha, then b */
    vec *scale = ab + length * 2 * Ke;   /* [length]: r_t */
    vec *weight = scale + length;        /* [Ke][TILES] */
    vec *futures = weight + TILES * Ke;  /* [2][Ke][TILES]: v of this block and of the one behind it */
    vec *beta = futures + 2 * TILES * Ke; /* [Ke] */
    vec *first = beta + Ke;              /* [Ke] */
    vec *pairs = first + Ke;             /* as in moments */
    vec *steps = pairs + (int64_t)Ke * m->pairs; /* [Ke][Ke] */
    double *kept = (double *)(steps + Ke * Ke);              /* [slot_size]: the sums before this group */
    int64_t *row = (int64_t *)(kept + m->slot_size);         /* [length][W] */
    uint16_t *breaks = (uint16_t *)(row + length * W);       /* [length + 1] lanes in which a piece begins, or one has ended */
    uint16_t *seams = breaks + length + 1;                   /* [length + 1] and in which it meets another */
    uint16_t *silent = seams + length + 1;                   /* [length + 1] and in which a frame does not count */

    memset(row, 0xff, sizeof(int64_t) * length * W);
    memset(breaks, 0, sizeof *breaks * 3 * (length + 1));
    breaks[0] = breaks[length] = all;
    for (int l = 0; l < W; l++) {
        int64_t t = 0;
        for (int64_t o = lane[l]; o < lane[l + 1]; o++) {
            breaks[t] |= 1 << l;
            const Piece *p = &job->pieces[job->order[o]];
            for (int64_t r = p->begin; r < p->from; r++) silent[t + r - p->begin] |= 1 << l;
            for (int64_t r = p->to; r < p->end; r++) silent[t + r - p->begin] |= 1 << l;
            if (p->begin < p->from) seams[t + p->from - p->begin - 1] |= 1 << l;
            if (p->to < p->end) seams[t + p->to - p->begin - 1] |= 1 << l;
            for (int64_t r = p->begin; r < p->end; r++, t++) row[t * W + l] = r;
        }
        breaks[t] |= 1 << l;
    }

    ivec failed = {0}, exponent = {0};
    int any_failed = 0;
    vec r = NAME(all)(1.0), top[TILES];
    const vec untold = NAME(untold)(), anywhere = NAME(all)((real)1.0 / K); /* where a piece begins inside its sequence */
    const vec faintest = NAME(larger)(NAME(all)((real)(job->faintest * M_LOG2E)), NAME(all)(FAINTEST));
    double shift[W] = {0.0};
    memset(futures, 0, sizeof(vec) * TILES * Ke); /* serves as alpha before the first frame */
    const vec *before = futures;
    for (int64_t t = 0; t < length; t++) {
        vec *block = ab + (t - t % TILES) * 2 * Ke, *alpha = block + t % TILES, *b = alpha + Ke * TILES;
        if (t % TILES == 0) {
            NAME(load)(m, job->frames, row + t * W, x + t * step);
            NAME(log_density)(m, x + t * step, b);
            NAME(relative)(b, K, top);
            if (Ke > K) memset(b + K * TILES, 0, sizeof(vec) * TILES);
        }
        vec s = NAME(forwards)(alpha, before, m->forward, b, untold, r, K, Ke);
        if (breaks[t]) {
            const ivec anew = NAME(mask)(breaks[t]), inside = NAME(mask)(breaks[t] & silent[t]);
            s = (vec){0};
            for (int k = 0; k < K; k++) {
                const vec start = SELECT(inside, anywhere, NAME(all)(initial[k])) * (b[k * TILES] - untold);
                s += alpha[k * TILES] = SELECT(anew, start, alpha[k * TILES]);
            }
        }
        if (t >= shortest) { /* lanes that have nothing left */
            const ivec alive = ends > (whole)t;
            for (int k = 0; k < K; k++) alpha[k * TILES] = (vec)(alive & (ivec)alpha[k * TILES]);
            s = SELECT(alive, s, NAME(all)(1.0));
        }
        const ivec fine = (s >= LEAST_SCALE) & (top[t % TILES] >= faintest); /* false for NaN, too */
        failed |= ~fine;
        s = SELECT(fine, s, NAME(all)(1.0));
        scale[t] = r = (vec)(2 * ONE - ((ivec)s & (2 * ONE + ((whole)1 << MANTISSA))));
        for (int l = 0; l < W; l++) shift[l] += top[t % TILES][l];
        before = alpha;
        for (int l = 0; l < W && seams[t]; l++)
            if (seams[t] >> l & 1) {
                const double so_far = log(s[l]) + ((double)exponent[l] + shift[l]) * M_LN2;
                job->log_likelihood[job->order[next[l]]] += silent[t] >> l & 1 ? -so_far : so_far;
            }
        if (breaks[t + 1])
            for (int l = 0; l < W; l++)
                if (breaks[t + 1] >> l & 1 && next[l] < lane[l + 1] && t < ends[l]) {
                    const int64_t piece = job->order[next[l]++];
                    if (!(silent[t] >> l & 1)) job->log_likelihood[piece] += log(s[l]) + ((double)exponent[l] + shift[l]) * M_LN2;
                    any_failed |= job->failed[piece] = failed[l] != 0;
                    failed[l] = 0;
                    exponent[l] = (((ivec)r)[l] >> MANTISSA) - BIAS; /* so that the next line leaves nothing */
                    shift[l] = 0.0;
                }
        exponent -= ((ivec)r >> MANTISSA) - BIAS;
    }
    memcpy(kept, slot, sizeof(double) * m->slot_size);
backwards:
    if (any_failed) /* without alpha a sequence adds nothing, unless its frames are infinite in float32 */
        for (int l = 0; l < W; l++)
            for (int64_t o = lane[l], t = 0; o < lane[l + 1]; o++)
                for (int64_t n = job->pieces[job->order[o]].end - job->pieces[job->order[o]].begin; n > 0; n--, t++)
                    if (job->failed[job->order[o]]) {
                        for (int k = 0; k < K; k++) ab[(t - t % TILES) * 2 * Ke + k * TILES + t % TILES][l] = 0.0;
                        for (int d = 0; d < m->D; d++) x[(t - t % TILES) * step + d * TILES + t % TILES][l] = 0.0;
                    }
    any_failed = 0;
    vec brightest = {0};
    for (int l = 0; l < W; l++) next[l] = lane[l + 1];
    memset(futures, 0, (char *)kept - (char *)futures);
    vec *v = futures, *spare = futures + TILES * Ke;
    for (int64_t t = length - 1; t >= 0; t--) {
        const int64_t tile = t % TILES;
        const vec *block = ab + (t - tile) * 2 * Ke, *alpha = block + tile, *b = alpha + Ke * TILES;
        vec *after = v + tile, *gamma = weight + tile;
        if (tile == 0) { vec *other = v; v = spare; spare = other; } /* the sums still need this block */
        vec *vt = v + (tile + TILES - 1) % TILES;
        const vec r = t > 0 ? scale[t - 1] : (vec){0}, until = brightest;
        const NAME(Back) to = {beta, gamma, vt, alpha, b};
        brightest = NAME(backwards)(&to, after, m->backward, r, brightest, K, Ke);
        if (breaks[t + 1]) {
            const ivec over = NAME(mask)(breaks[t + 1]);
            vec s = {0};
            for (int k = 0; k < K; k++) s += alpha[k * TILES];
            s = 1.0 / NAME(larger)(s, NAME(all)(LEAST_SUM));
            brightest = until;
            for (int k = 0; k < Ke; k++) {
                beta[k] = SELECT(over, s, beta[k]);
                gamma[k * TILES] = alpha[k * TILES] * beta[k];
                const vec future = beta[k] * b[k * TILES] * r;
                brightest = NAME(larger)(brightest, future);
                vt[k * TILES] = NAME(smaller)(future, NAME(all)(MOST_FUTURE));
            }
        }
        for (int l = 0; l < W && seams[t]; l++)
            if (seams[t] >> l & 1) {
                double *seam = job->seams + (job->order[next[l] - 1] * 2 + !(silent[t] >> l & 1)) * 2 * K;
                for (int k = 0; k < K; k++) seam[k] = alpha[k * TILES][l], seam[K + k] = beta[k][l];
            }
        if (silent[t] | silent[t + 1]) {
            const ivec counts = ~NAME(mask)(silent[t]), leads_on = ~NAME(mask)(silent[t + 1]);
            for (int k = 0; k < Ke; k++) {
                gamma[k * TILES] = (vec)(counts & (ivec)gamma[k * TILES]);
                after[k * TILES] = (vec)(leads_on & (ivec)after[k * TILES]);
            }
        }
        if (breaks[t]) {
            const ivec anew = NAME(mask)(breaks[t]), inside = NAME(mask)(breaks[t] & silent[t]);
            vec whole_past = {0};
            for (int k = 0; k < K; k++)
                whole_past += SELECT(inside, anywhere, NAME(all)(initial[k])) * beta[k] * block[(Ke + k) * TILES + tile];
            for (int k = 0; k < Ke; k++) first[k] += (vec)(anew & (ivec)gamma[k * TILES]);
            for (int l = 0; l < W; l++)
                if (breaks[t] >> l & 1 && t < ends[l]) {
                    const int64_t piece = job->order[--next[l]];
                    const int kept_all = fabs(whole_past[l] - 1.0) < LOST && until[l] < MOST_FUTURE;
                    if (!job->failed[piece] && !kept_all) any_failed = job->failed[piece] = 1;
                }
            brightest = (vec)(~anew & (ivec)brightest);
            for (int k = 0; k < Ke; k++) vt[k * TILES] = (vec)(~anew & (ivec)vt[k * TILES]);
        }
        if (job->weights) {
            double *to[W];
            for (int l = 0; l < W; l++)
                to[l] = row[t * W + l] >= 0 && !(silent[t] >> l & 1) ? job->weights + row[t * W + l] * K : NULL;
            NAME(leave)(gamma, to, K);
        }
        if (!job->statistics) continue;
        if (tile == 0) {
            NAME(outer)(steps, Ke, block, Ke, spare, Ke);
            NAME(moments)(m, pairs, weight, x + t * step);
        }
        if (t % DRAIN == 0) {
            NAME(drain)(m, pairs, slot);
            NAME(add_lanes)(steps, Ke, K, K, slot + (int64_t)K * m->n_pairs);
            memset(steps, 0, sizeof(vec) * Ke * Ke);
        }
    }
    if (any_failed && job->statistics) { /* rare: all once more, without them */
        memcpy(slot, kept, sizeof(double) * m->slot_size);
        goto backwards;
    }
    if (job->statistics) NAME(add_lanes)(first, 1, K, 1, slot + (int64_t)K * m->n_pairs + K * K);
}

/* ----------------------------------------------------------------------------------------- one sequence alone */

/* out[j] = sum_i in[i] matrix[i][j] with lanes across the states j: nv vectors an i. */
INLINE void NAME(across)(vec *out, const real *in, const vec *matrix, int K, int nv) {
    for (int v = 0; v < nv; v += 2) {
        const int two = v + 1 < nv;
        vec a = {0}, b = {0}, c = {0}, d = {0}; /* even and odd i apart: half the latency */
        int i = 0;
        if (two)
            for (; i + 2 <= K; i += 2) {
                a += in[i] * matrix[i * nv + v];
                b += in[i] * matrix[i * nv + v + 1];
                c += in[i + 1] * matrix[(i + 1) * nv + v];
                d += in[i + 1] * matrix[(i + 1) * nv + v + 1];
            }
        else
            for (; i + 2 <= K; i += 2) {
                a += in[i] * matrix[i * nv + v];
                c += in[i + 1] * matrix[(i + 1) * nv + v];
            }
        if (i < K) {
            a += in[i] * matrix[i * nv + v];
            if (two) b += in[i] * matrix[i * nv + v + 1];
        }
        out[v] = a + c;
        if (two) out[v + 1] = b + d;
    }
}

/* Rows of the TILES x W frames from `from` on, up to `to`. */
INLINE void NAME(rows)(int64_t *row, int64_t from, int64_t to) {
    for (int i = 0; i < TILES * W; i++) row[i] = from + i < to ? from + i : -1;
}

/* The same recursions for one sequence: lanes across frames for densities and moments, across states for alpha and beta. */
FN void NAME(alone)(const Job *job, int64_t piece, double *space, double *slot) {
    const Model *m = job->model;
    const int K = m->K, Ke = m->Ke, nv = m->nv, BLOCK = TILES * W;
    const int64_t begin = job->pieces[piece].begin, end = job->pieces[piece].end;
    const int64_t length = end - begin, padded = (length + BLOCK - 1) / BLOCK * BLOCK;
    const vec *forward = (const vec *)m->forward_across, *backward = (const vec *)m->backward_across;

    vec *alpha = (vec *)space;          /* [padded][nv] */
    vec *b = alpha + padded * nv;       /* [padded][nv] */
    vec *v = b + padded * nv;           /* [BLOCK][nv] */
    vec *gamma = v + BLOCK * nv;        /* [BLOCK][nv] */
    vec *beta = gamma + BLOCK * nv;     /* [nv] */
    vec *steps = beta + nv;             /* [K][nv] */
    vec *x = steps + K * nv;            /* [TILES][D + 1] */
    vec *tile = x + TILES * (m->D + 1); /* [nv W or Ke][TILES], zero behind the last state */
    vec *pairs = tile + TILES * (nv * W > Ke ? nv * W : Ke); /* as in moments */
    double *kept = (double *)(pairs + (int64_t)Ke * m->pairs); /* [slot_size] */
    real *scale = (real *)(kept + m->slot_size); /* [padded] */
    int64_t row[TILES * W];

    vec top[TILES];
    double tops = 0.0;
    real s = 1.0;
    union { real number; whole bits; } r = {1.0};
    int64_t exponent = 0;
    const vec untold = NAME(untold)();
    memset(tile, 0, (char *)pairs - (char *)tile);
    for (int64_t t0 = 0; t0 < length; t0 += BLOCK) {
        NAME(rows)(row, begin + t0, end);
        NAME(load)(m, job->frames, row, x);
        NAME(log_density)(m, x, tile);
        NAME(relative)(tile, K, top);
        for (int i = 0; i < BLOCK; i++) {
            for (int j = 0; j < nv; j++) b[(t0 + i) * nv + j] = NAME(gather)((real *)tile + j * W * BLOCK + i, BLOCK);
            if (t0 + i < length) tops += ((real *)top)[i];
        }
        for (int64_t t = t0; t < t0 + BLOCK && t < length; t++) {
            vec sums = {0}, *at = alpha + t * nv;
            if (t > 0) NAME(across)(at, (real *)(at - nv), forward, K, nv);
            else memcpy(at, m->initial, sizeof(vec) * nv);
            for (int i = 0; i < nv; i++) sums += at[i] *= (b[t * nv + i] - untold) * r.number;
            exponent -= (r.bits >> MANTISSA) - BIAS;
            s = NAME(sum)(sums);
            if (!(s >= LEAST_SCALE && ((real *)top)[t - t0] >= FAINTEST && ((real *)top)[t - t0] >= job->faintest * M_LOG2E)) {
                job->failed[piece] = 1;
                return;
            }
            r.number = s;
            r.bits = 2 * ONE - (r.bits & (2 * ONE + ((whole)1 << MANTISSA)));
            scale[t] = r.number;
        }
    }
    job->failed[piece] = 0;
    job->log_likelihood[piece] = log(s) + ((double)exponent + tops) * M_LN2;
    double *transitions = slot + (int64_t)K * m->n_pairs, *first = transitions + K * K;
    memcpy(kept, slot, sizeof(double) * m->slot_size);
    vec brightest = {0};
    memset(v, 0, sizeof(vec) * (2 * BLOCK * nv + nv + K * nv));
    memset(pairs, 0, sizeof(vec) * Ke * m->pairs);
    for (int64_t t0 = padded - BLOCK; t0 >= 0; t0 -= BLOCK) {
        const int n = length - t0 < BLOCK ? (int)(length - t0) : BLOCK;
        for (int i = n - 1; i >= 0; i--) {
            const int64_t t = t0 + i;
            vec *vt = v + i * nv, *at = alpha + t * nv;
            if (t + 1 < length) {
                for (int j = 0; j < nv; j++) {
                    const vec future = beta[j] * b[(t + 1) * nv + j] * scale[t];
                    brightest = NAME(larger)(brightest, future);
                    vt[j] = NAME(smaller)(future, NAME(all)(MOST_FUTURE));
                }
                NAME(across)(beta, (real *)vt, backward, K, nv);
            } else {
                for (int j = 0; j < nv; j++) vt[j] = (vec){0}, beta[j] = NAME(all)(1 / s);
            }
            for (int j = 0; j < nv; j++) gamma[i * nv + j] = at[j] * beta[j];
        }
        if (job->weights)
            for (int i = 0; i < n; i++)
                for (int k = 0; k < K; k++) job->weights[(begin + t0 + i) * K + k] = ((real *)(gamma + i * nv))[k];
        if (!job->statistics) continue;
        for (int i = n; i < BLOCK; i++)
            for (int j = 0; j < nv; j++) gamma[i * nv + j] = v[i * nv + j] = (vec){0};
        for (int k = 0; k < K; k += 2) /* steps[k] += alpha_t(k) v_{t+1}, two states and two vectors at a time */
            for (int j = 0; j < nv; j += 2) {
                const int down = k + 1 < K ? 1 : 0, right = j + 1 < nv ? 1 : 0;
                vec s00 = {0}, s01 = {0}, s10 = {0}, s11 = {0};
                for (int i = 0; i < n; i++) {
                    const real *at = (real *)(alpha + (t0 + i) * nv) + k;
                    const vec *vt = v + i * nv + j;
                    s00 += at[0] * vt[0];
                    s01 += at[0] * vt[right];
                    s10 += at[down] * vt[0];
                    s11 += at[down] * vt[right];
                }
                steps[k * nv + j] += s00;
                if (right) steps[k * nv + j + 1] += s01;
                if (down) steps[(k + 1) * nv + j] += s10;
                if (down && right) steps[(k + 1) * nv + j + 1] += s11;
            }
        for (int k = 0; k < K; k++)
            for (int i = 0; i < TILES; i++) tile[k * TILES + i] = NAME(gather)((real *)(gamma + i * W * nv) + k, nv * W);
        NAME(rows)(row, begin + t0, end);
        NAME(load)(m, job->frames, row, x);
        NAME(moments)(m, pairs, tile, x);
        if (t0 % (DRAIN * W) == 0) {
            NAME(drain)(m, pairs, slot);
            for (int i = 0; i < K; i++)
                for (int j = 0; j < K; j++) transitions[i * K + j] += ((real *)(steps + i * nv))[j];
            memset(steps, 0, sizeof(vec) * K * nv);
        }
    }
    vec whole_past = {0};
    for (int j = 0; j < nv; j++) whole_past += ((const vec *)m->initial)[j] * beta[j] * b[j];
    int kept_all = fabs(NAME(sum)(whole_past) - 1.0) < LOST;
    for (int l = 0; l < W; l++) kept_all &= brightest[l] < MOST_FUTURE;
    if (!kept_all) {
        job->failed[piece] = 1;
        memcpy(slot, kept, sizeof(double) * m->slot_size);
        return;
    }
    if (job->statistics)
        for (int k = 0; k < K; k++) first[k] += ((real *)gamma)[k];
}

/* A mixture: no dynamics, so every frame is alone with the weights of the states. Group g is frames from g * PIECE on. */
FN void NAME(mixture)(const Job *job, int g, double *space, double *slot) {
    const Model *m = job->model;
    const int K = m->K, Ke = m->Ke, BLOCK = TILES * W;
    const int64_t begin = (int64_t)g * PIECE, end = begin + PIECE < job->n_frames ? begin + PIECE : job->n_frames;
    vec *x = (vec *)space, *tile = x + TILES * (m->D + 1), *pairs = tile + TILES * Ke;
    int64_t row[TILES * W];
    const real *log_weights = m->log_initial;
    vec top[TILES];
    ivec failed = {0};
    LogSum logs = NAME(no_log)();
    memset(pairs, 0, sizeof(vec) * Ke * m->pairs);
    for (int64_t t0 = begin; t0 < end; t0 += BLOCK) {
        NAME(rows)(row, t0, end);
        NAME(load)(m, job->frames, row, x);
        NAME(log_density)(m, x, tile);
        for (int k = 0; k < K; k++)
            for (int i = 0; i < TILES; i++) tile[k * TILES + i] += log_weights[k] * (real)M_LOG2E;
        NAME(relative)(tile, K, top);
        if (Ke > K) memset(tile + K * TILES, 0, sizeof(vec) * TILES);
        for (int i = 0; i < TILES; i++) {
            vec *h = tile + i, s = {0};
            for (int k = 0; k < K; k++) s += h[k * TILES];
            const int64_t left = end - t0 - i * W;
            const ivec alive = NAME(mask)(left >= W ? (1u << W) - 1 : left > 0 ? (1u << left) - 1 : 0);
            failed |= alive & ~(top[i] >= FAINTEST);
            const vec r = (vec)(alive & (ivec)(1.0 / s));
            for (int k = 0; k < K; k++) h[k * TILES] *= r;
            NAME(add_log)(&logs, SELECT(alive, s, NAME(all)(1.0)), (vec)(alive & (ivec)top[i]));
            for (int l = 0; l < W && l < left && job->weights; l++)
                for (int k = 0; k < K; k++) job->weights[row[i * W + l] * K + k] = h[k * TILES][l];
        }
        NAME(moments)(m, pairs, tile, x);
    }
    NAME(drain)(m, pairs, slot);
    double total = 0.0;
    for (int l = 0; l < W; l++) total += failed[l] ? NAN : NAME(take_log)(&logs, l);
    job->log_likelihood[g] = total;
}

#ifndef SINGLE
/* Viterbi. Forwards only the scores of the best ways are kept, [length][K]; from which state a way came is asked again for the states
 * of the path alone: the same sums, so the same answer. Of equally good ways the first. */

/* out[j] = max_i in[i] + matrix[i][j] for n columns, in every lane. */
INLINE void NAME(arrivals)(vec *out, const vec *in, const real *matrix, int K, ptrdiff_t stride, const int n) {
    vec s[6];
    for (int j = 0; j < n; j++) s[j] = *in + matrix[j];
    for (const vec *end = in++ + K; matrix += stride, in < end; in++)
        for (int j = 0; j < n; j++) s[j] = NAME(larger)(*in + matrix[j], s[j]);
    for (int j = 0; j < n; j++) out[j] = s[j];
}

/* Whole sequences side by side. */
FN void NAME(paths)(const Job *job, int g, double *space) {
    const Model *m = job->model;
    const int K = m->K, Ke = m->Ke;
    const real *log_initial = m->log_initial, *log_forward = m->forward;
    const int64_t *lane = job->lanes + (int64_t)g * W;
    int64_t length = 0, next[W], last[W];
    for (int l = 0; l < W; l++) {
        int64_t n = 0;
        for (int64_t o = lane[l]; o < lane[l + 1]; o++) n += job->pieces[job->order[o]].end - job->pieces[job->order[o]].begin;
        length = n > length ? n : length;
        next[l] = lane[l + 1];
    }
    length = (length + TILES - 1) / TILES * TILES;
    vec *x = (vec *)space;                  /* [D + 1][TILES] */
    vec *b = x + TILES * (m->D + 1);        /* [Ke][TILES] */
    vec *best = b + TILES * Ke;             /* [length][Ke] */
    int64_t *row = (int64_t *)(best + length * Ke);   /* [length][W] */
    uint16_t *breaks = (uint16_t *)(row + length * W); /* [length + 1] lanes in which a sequence begins, or one has ended */
    memset(row, 0xff, sizeof(int64_t) * length * W);
    memset(breaks, 0, sizeof *breaks * (length + 1));
    for (int l = 0; l < W; l++) {
        int64_t t = 0;
        for (int64_t o = lane[l]; o < lane[l + 1]; o++) {
            const Piece *p = &job->pieces[job->order[o]];
            breaks[t] |= 1 << l;
            for (int64_t r = p->begin; r < p->end; r++, t++) row[t * W + l] = r;
        }
        breaks[t] |= 1 << l;
    }
    for (int64_t t = 0; t < length; t++) {
        vec *now = best + t * Ke;
        if (t % TILES == 0) {
            NAME(load)(m, job->frames, row + t * W, x);
            NAME(log_density)(m, x, b);
        }
        int j = 0;
        for (; t > 0 && j + 6 <= Ke; j += 6) NAME(arrivals)(now + j, now - Ke, log_forward + j, K, Ke, 6);
        for (; t > 0 && j < Ke; j += 2) NAME(arrivals)(now + j, now - Ke, log_forward + j, K, Ke, 2);
        if (breaks[t] || t == 0) {
            const ivec anew = t > 0 ? NAME(mask)(breaks[t]) : ~(ivec){0};
            for (int k = 0; k < K; k++) now[k] = SELECT(anew, NAME(all)(log_initial[k]), now[k]);
        }
        for (int k = 0; k < K; k++) now[k] += M_LN2 * b[k * TILES + t % TILES];
    }
    ivec state = {0};
    for (int64_t t = length - 1; t >= 0; t--) {
        const vec *now = best + t * Ke, *before = now - Ke;
        if (breaks[t + 1] || t == length - 1)
            for (int l = 0; l < W; l++)
                if (row[t * W + l] >= 0 && (t == length - 1 || breaks[t + 1] >> l & 1)) {
                    state[l] = 0;
                    for (int k = 1; k < K; k++)
                        if (now[k][l] > now[state[l]][l]) state[l] = k;
                    job->log_likelihood[job->order[--next[l]]] = now[state[l]][l];
                }
        for (int l = 0; l < W; l++) {
            if (row[t * W + l] >= 0) job->path[row[t * W + l]] = state[l];
            last[l] = state[l];
        }
        if (t == 0) break;
        vec top = NAME(all)(-INFINITY);
        state = (ivec){0};
        for (int i = 0; i < K; i++) {
#define AT(l) log_forward[i * Ke + last[l]]
            const vec way = before[i] + EACH(AT);
#undef AT
            const ivec better = way > top;
            top = SELECT(better, way, top);
            state = (better & i) | (~better & state);
        }
    }
}

/* One sequence: lanes across frames for densities, across states for the scores. */
FN void NAME(path_alone)(const Job *job, int64_t sequence, double *space) {
    const Model *m = job->model;
    const int K = m->K, Ke = m->Ke, nv = m->nv, Kp = nv * W, BLOCK = TILES * W;
    const int64_t begin = job->pieces[sequence].begin, end = job->pieces[sequence].end, length = end - begin;
    const vec *log_forward = (const vec *)m->forward_across;
    vec *x = (vec *)space, *tile = x + TILES * (m->D + 1), *best = tile + TILES * Ke; /* [length][nv] */
    int64_t row[TILES * W];
    for (int64_t t0 = 0; t0 < length; t0 += BLOCK) {
        NAME(rows)(row, begin + t0, end);
        NAME(load)(m, job->frames, row, x);
        NAME(log_density)(m, x, tile);
        for (int64_t t = t0; t < t0 + BLOCK && t < length; t++) {
            vec *now = best + t * nv;
            const real *before = (const real *)(now - nv);
            for (int v = 0; t > 0 && v < nv; v++) {
                vec even = before[0] + log_forward[v], odd = even;
                for (int i = 1; i + 1 < K; i += 2) {
                    odd = NAME(larger)(before[i] + log_forward[i * nv + v], odd);
                    even = NAME(larger)(before[i + 1] + log_forward[(i + 1) * nv + v], even);
                }
                if (K % 2 == 0) odd = NAME(larger)(before[K - 1] + log_forward[(K - 1) * nv + v], odd);
                now[v] = NAME(larger)(even, odd);
            }
            if (t == 0) memcpy(now, m->log_initial, sizeof(vec) * nv);
            for (int k = 0; k < K; k++) ((real *)now)[k] += M_LN2 * ((real *)tile)[k * BLOCK + t - t0];
        }
    }
    const real *now = (const real *)(best + (length - 1) * nv);
    int state = 0;
    for (int k = 1; k < K; k++)
        if (now[k] > now[state]) state = k;
    job->log_likelihood[sequence] = now[state];
    for (int64_t t = length - 1;; t--) {
        job->path[begin + t] = state;
        if (t == 0) break;
        const real *before = now - Kp, *way = (const real *)m->backward_across + state * Kp;
        real top = before[0] + way[0];
        now = before;
        state = 0;
        for (int i = 1; i < K; i++)
            if (before[i] + way[i] > top) top = before[i] + way[i], state = i;
    }
}

/* ---------------------------------------------------------------------------------------------------- on line */

/* One tick, lanes across states; the mathematics and the constants are those of models/filtering.py. Gives 0, with nothing
 * changed, where that has to take over: something is missing, or the weights would need logarithms. */
FN int NAME(tick)(Tick *f, const double *xi) {
    const int D = f->D, K = f->K, nv = f->nv;
    double offset[MOST_CHANNELS], far = 0.0;
    for (int d = 0; d < D; d++) {
        offset[d] = xi[d] - f->origin[d];
        far += offset[d] * offset[d];
    }
    if (!(far < UNBELIEVABLE * UNBELIEVABLE)) return 0; /* NaN compares false */
    vec *log_b = (vec *)f->log_b, *h = (vec *)f->h, *predicted = (vec *)f->predicted;
    const vec *factors = (const vec *)f->factors, *centres = (const vec *)f->centres, *peak = (const vec *)f->peak;
    vec tops = NAME(all)(-INFINITY);
    for (int v = 0; v < nv; v++) {
        vec q = {0};
        for (int d = 0, at = v; d < D; d++) {
            vec z = -centres[d * nv + v];
            for (int e = 0; e <= d; e++, at += nv) z += offset[e] * factors[at];
            q += z * z;
        }
        log_b[v] = peak[v] - 0.5 * q; /* lanes behind the last state have a peak of -infinity */
        tops = NAME(larger)(log_b[v], tops);
    }
    double best = tops[0];
    for (int l = 1; l < W; l++) best = tops[l] > best ? tops[l] : best;
    if (f->state[FRESH] != 0.0) memcpy(predicted, f->initial, sizeof(vec) * nv);
    else NAME(across)(predicted, f->weights, (const vec *)f->chain, K, nv);
    const vec least = NAME(larger)(NAME(all)(-f->gate * M_LOG2E), NAME(all)(LEAST_EXPONENT));
    vec sums = {0}, largest = {0};
    for (int v = 0; v < nv; v++) {
        h[v] = predicted[v] * NAME(exp2)(NAME(larger)((log_b[v] - best) * M_LOG2E, least));
        sums += h[v];
        largest = NAME(larger)(largest, h[v]);
    }
    const double total = NAME(sum)(sums);
    if (!(total > 1e-250)) return 0; /* terms below 1e-308 are lost: too many of them here */
    double top = largest[0];
    for (int l = 1; l < W; l++) top = largest[l] > top ? largest[l] : top;
    const int hopeless = top < HOPELESS;
    if (hopeless && f->state[HOPELESS_TICKS] + 1.0 >= f->patience) return 0;
    f->state[FRESH] = 0.0;
    f->state[HOPELESS_TICKS] = hopeless ? f->state[HOPELESS_TICKS] + 1.0 : 0.0;
    f->state[LAST_LOG_LIKELIHOOD] = best + log(total);
    f->state[LOG_LIKELIHOOD] += f->state[LAST_LOG_LIKELIHOOD];
    const double scale = 1.0 / total;
    for (int k = 0; k < K; k++) f->weights[k] = ((double *)h)[k] * scale;
    return 1;
}

/* sum_k h_k (gains_k x + offsets_k), lanes across states. */
FN void NAME(line)(const Line *r, const double *weights, const double *x, double *out) {
    vec *h = (vec *)r->h;
    const vec *gains = (const vec *)r->gains, *offsets = (const vec *)r->offsets;
    memcpy(h, weights, sizeof(double) * r->K); /* zero behind the last state since it was made */
    for (int o = 0; o < r->n_out; o++) {
        vec sums = {0};
        for (int v = 0; v < r->nv; v++) {
            vec y = offsets[o * r->nv + v];
            for (int i = 0; i < r->n_in; i++) y += x[i] * gains[(o * r->n_in + i) * r->nv + v];
            sums += h[v] * y;
        }
        out[o] = NAME(sum)(sums);
    }
}

#endif

/* -------------------------------------------------------------------------------------------------- roll-outs */

INLINE vec NAME(take)(const double *from, int n) {
    NAME(wide) all = {0};
    if (n == W) memcpy(&all, from, sizeof all);
    else for (int i = 0; i < n; i++) all[i] = from[i];
    return __builtin_convertvector(all, vec);
}

/* As `leave`, the way back. */
INLINE void NAME(enter)(vec *block, const double *const *from, int n) {
    for (int c = 0; c < n; c += W) {
        const int some = n - c < W ? n - c : W;
        vec a[W];
        for (int l = 0; l < W; l++) {
            a[l] = NAME(take)(from[l] + c, some);
            for (int i = c; i < c + W; i += LINE) __builtin_prefetch(from[l] + n + i + LINE);
        }
        NAME(transpose)(a);
        for (int r = 0; r < some; r++) block[(c + r) * TILES] = a[r];
    }
}

INLINE void NAME(mixed)(vec *out, const vec *h, const real *matrix, int K, ptrdiff_t stride, const int n) {
    for (int half = 0; half < TILES; half += 4) {
        vec s[4][4] = {{{0}}};
        const vec *at = h + half;
        for (const real *a = matrix, *end = matrix + K * stride; a < end; a += stride, at += TILES)
            for (int i = 0; i < 4; i++) {
                vec weight = at[i];
                HOLD(weight);
                for (int j = 0; j < n; j++) s[j][i] += a[j] * weight;
            }
        for (int j = 0; j < n; j++)
            for (int i = 0; i < 4; i++) out[j * TILES + half + i] = s[j][i];
    }
}

/* out[j] = sum_k h[k] matrix[k][j] for a block h [K][TILES]; an even number of columns. */
INLINE void NAME(blend)(vec *out, const vec *h, const real *matrix, int K, int columns) {
    int j = 0;
    for (; sizeof(vec) == 64 && j + 4 <= columns; j += 4) NAME(mixed)(out + j * TILES, h, matrix + j, K, columns, 4);
    for (; j < columns; j += 2) NAME(mixed)(out + j * TILES, h, matrix + j, K, columns, 2);
}

/* TILES x W roll-outs at once, lanes across them: filter, regression, Euler. The gate keeps a weight from being forgotten and a
 * frame without explanation from deciding alone, exactly as in a tick. */
FN void NAME(rollouts)(const Rollouts *job, int g, double *space) {
    const Model *m = job->model;
    const real *initial = m->initial, gate = (real)(job->gate * M_LOG2E), dt = (real)job->dt;
    const int K = m->K, Ke = m->Ke, D = m->D, d = job->n_axes, f = job->n_forces, n_in = d + f, BLOCK = TILES * W;
    const int64_t begin = (int64_t)g * BLOCK, T = job->length;
    vec *x = (vec *)space;                 /* [D + 1][TILES] */
    vec *b = x + TILES * (D + 1);          /* [Ke][TILES] */
    vec *h = b;                            /* the weights take the place of the densities */
    vec *next = b + TILES * Ke;            /* [columns][TILES]: the prediction, then lines */
    vec *forces = next + TILES * job->columns;     /* [RUN][f][TILES] */
    vec *positions = forces + RUN * f * TILES;     /* [RUN][d][TILES] */
    vec *velocities = positions + RUN * d * TILES; /* [RUN][d][TILES], and the last one of the run before */
    vec *position = positions, *velocity = velocities + RUN * d * TILES;
    const vec least = NAME(larger)(NAME(all)(-gate), NAME(all)(LEAST_EXPONENT));
    int64_t who[TILES * W];
    for (int i = 0; i < BLOCK; i++) {
        who[i] = begin + i < job->n ? begin + i : job->n - 1; /* lanes left over repeat the last */
        for (int a = 0; a < d; a++) ((real *)position)[a * BLOCK + i] = (real)job->start[who[i] * d + a];
    }
    memset(velocity, 0, sizeof(vec) * d * TILES);
    for (int k = 0; k < K; k++)
        for (int i = 0; i < TILES; i++) next[k * TILES + i] = NAME(all)(initial[k]);
    vec scale[TILES]; /* of the weights: what they are linear in takes it later, and more cheaply */
    for (int i = 0; i < TILES; i++) scale[i] = NAME(all)(1.0);
    for (int64_t t = 0; t < T; t++) { /* paths leave every RUN steps: to touch 192 rows at each would cost more than all arithmetic */
        const int run = (int)(t % RUN);
        if (run == 0)
            for (int i = 0; i < TILES; i++) {
                const double *from[W];
                for (int l = 0; l < W; l++) from[l] = job->force + (who[i * W + l] * job->force_step + t) * f;
                NAME(enter)(forces + i, from, f * (int)(T - t < RUN ? T - t : RUN));
            }
        const vec *force = forces + run * f * TILES;
        for (int c = 0; c < D; c++) {
            const int from = (int)job->source[c];
            const vec *now = from < d ? position + from * TILES : from < n_in ? force + (from - d) * TILES : velocity + (from - n_in) * TILES;
            for (int i = 0; i < TILES; i++) x[c * TILES + i] = now[i] - (real)m->origin[c];
        }
        NAME(log_density)(m, x, b);
        vec top[TILES], sums[TILES] = {{0}};
        for (int i = 0; i < TILES; i++) top[i] = b[i];
        for (int k = 1; k < K; k++)
            for (int i = 0; i < TILES; i++) top[i] = NAME(larger)(top[i], b[k * TILES + i]);
        for (int k = 0; k < K; k++)
            for (int i = 0; i < TILES; i++) {
                const vec lead = NAME(larger)(b[k * TILES + i] - top[i], least);
                sums[i] += h[k * TILES + i] = NAME(exp2)(lead) * (next[k * TILES + i] * scale[i]);
            }
        for (int i = 0; i < TILES; i++) scale[i] = 1.0 / NAME(larger)(sums[i], NAME(all)(LEAST_SUM));
        NAME(blend)(next, h, job->matrix, K, job->columns);
        velocity = velocities + run * d * TILES;
        const vec *slope = next + K * TILES; /* [d][1 + n_in][TILES]: the states' lines, blended, and then at the input */
        for (int o = 0; o < d; o++, slope += (1 + n_in) * TILES) {
            vec y[TILES];
            for (int i = 0; i < TILES; i++) y[i] = slope[i];
            for (int c = 0; c < n_in; c++) {
                const vec *in = c < d ? position + c * TILES : force + (c - d) * TILES;
                for (int i = 0; i < TILES; i++) y[i] += slope[(1 + c) * TILES + i] * in[i];
            }
            for (int i = 0; i < TILES; i++) velocity[o * TILES + i] = y[i] * scale[i];
        }
        if (run == RUN - 1 || t == T - 1)
            for (int i = 0; i < TILES; i++) {
                double *x_to[W], *v_to[W];
                for (int l = 0; l < W; l++) {
                    const int64_t lane = begin + i * W + l, to = (lane * T + t - run) * d;
                    x_to[l] = lane < job->n ? job->position + to : NULL;
                    v_to[l] = lane < job->n ? job->velocity + to : NULL;
                }
                NAME(leave)(positions + i, x_to, (run + 1) * d);
                NAME(leave)(velocities + i, v_to, (run + 1) * d);
            }
        vec *next_position = positions + (run + 1) % RUN * d * TILES;
        for (int i = 0; i < d * TILES; i++) next_position[i] = position[i] + dt * velocity[i];
        position = next_position;
    }
    ivec lost = {0}; /* what is not finite stays so: the end tells */
    for (int i = 0; i < d * TILES; i++) lost |= ~(position[i] - position[i] == NAME(all)(0));
    for (int l = 0; l < W; l++)
        if (lost[l]) atomic_store(job->lost, 1);
}

static const Level NAME(level) = {
#ifdef SINGLE
    LEVEL_NAME, W, sizeof(vec) / sizeof(double), NULL, NAME(group), NAME(alone), NAME(mixture), NULL, NULL, NULL, NULL, NAME(rollouts),
#else
    LEVEL_NAME, W, W, &SINGLE_LEVEL, NAME(group), NAME(alone), NAME(mixture), NAME(paths), NAME(path_alone), NAME(tick), NAME(line), NAME(rollouts),
#endif
};

#undef vec
#undef ivec
#undef real
#undef whole
#undef ONE
#undef MANTISSA
#undef BIAS
#undef LEAST_EXPONENT
#undef LEAST_LOG_DENSITY
#undef FAINTEST
#undef MOST_FUTURE
#undef LOST
#undef LEAST_SCALE
#undef LEAST_SUM
#undef FN
#undef INLINE
#undef SELECT
#undef EACH
#undef LOWER
#undef UPPER
#undef LogSum
#undef LARGER
#undef SMALLER
#undef SINGLE
#undef W
#undef NAME
#undef TARGET
#undef LEVEL_NAME
