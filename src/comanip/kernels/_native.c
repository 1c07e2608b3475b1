/* The loops that cost time, compiled: E-step, decoding, one on-line tick of filter and law, roll-outs. Arrays in, arrays out.
 *
 * The mathematics is that of the readable twins in comanip.models, and a test holds the two together. Here is only what makes it
 * fast: several sequences ride in the lanes of one vector, a group of them stays in the L2 cache from the forward pass to the sums,
 * and nothing is written twice. Arrays come through the buffer protocol and the stable ABI, so that one wheel fits every numpy and
 * every Python from 3.11 on. Sizes are checked here, meanings in kernels/__init__.py.
 */

#define PY_SSIZE_T_CLEAN
#ifndef Py_GIL_DISABLED /* builds without the lock have no stable ABI */
#define Py_LIMITED_API 0x030B0000
#endif
#include <Python.h>

#include <float.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if FLT_EVAL_METHOD != 0 /* the exponential rounds by adding 1.5 * 2^52, and a register of 80 bits keeps what should go */
#error "numbers are computed with more digits than double has: on 32-bit x86 compile with -msse2 -mfpmath=sse"
#endif

#ifndef M_LN2
#define M_LN2 0.693147180559945309417
#define M_LOG2E 1.44269504088896340736
#endif

#define TO_EXPONENT 0.84932180028801904272 /* sqrt(log2(e) / 2) */
#define TILES 8               /* vectors in flight: a multiplication takes 4 cycles and 2 start in each */
#define RUN 32                /* steps of a roll-out between visits to its own arrays; a multiple of any number of lanes */
#define LINE 8                /* float64 numbers in a cache line */
#define PIECE 4096            /* frames of a mixture that make one unit of work */
#define SLOTS 16              /* partial sums at least, whatever the number of threads: the same order of additions, the same bits */
#define MOST_SLOTS 128        /* as long as they fit in */
#define SLOTS_SIZE 65536      /* numbers */
#define MOST_CHANNELS 256
#define MOST_THREADS 64
#define WORTH_A_THREAD 4e6    /* multiplications: 0.2 ms, or four times what it costs to start one */
#define SEAM 1e-11            /* how far pieces of a sequence may disagree where they meet, in posterior probability */
#define SEAM_SINGLE 1e-4
#define DRAIN 512             /* frames of a lane whose moments are summed before they join the sums in float64 */
#define UNBELIEVABLE 1e100    /* as in models/filtering.py */
#define HOPELESS 2.0611536224385579e-09 /* exp(-20), as in models/filtering.py */

enum { FRESH, HOPELESS_TICKS, RESTARTS, LAST_LOG_LIKELIHOOD, LOG_LIKELIHOOD, STATE_SIZE }; /* ForwardFilter._state */

typedef struct {             /* Gaussians and a chain, laid out for the recursions */
    int D, K, Ke, nv;        /* channels, states, states made even, vectors that hold one number a state */
    int n_pairs, pairs;      /* products x_i x_j of (x, 1), and that made even */
    ptrdiff_t *pair;         /* [pairs][2] where x_i and x_j begin in a block */
    size_t slot_size;        /* moments, transitions and first of an Hmm */
    double *origin;
    void *factors, *centres, *peak; /* Whitening; factors packed (K, D (D + 1) / 2). All but `origin` in the level's precision */
    void *initial, *log_initial;
    void *forward, *backward;               /* [Ke][Ke] a_ij and its transpose */
    void *forward_across, *backward_across; /* [K][nv W] the same for lanes across states */
} Model;

typedef struct { int64_t begin, from, to, end; } Piece; /* of a sequence: rows that run, and of them those that count */

typedef struct {
    const Model *model;
    const double *frames;
    int64_t n_frames;
    const int64_t *starts;  /* (S + 1) rows where sequences begin, of an Hsmm */
    const Piece *pieces;
    const int64_t *order;   /* pieces, lane by lane */
    const int64_t *lanes;   /* (groups W + 1) where lanes begin in `order` */
    double *log_likelihood, *weights; /* of each piece */
    int64_t *path;          /* asks for nothing but the best path, with `log_likelihood` that of the path */
    double *seams;          /* (P, 2, 2, K) alpha and beta of a piece before what counts, and at its last frame that counts */
    unsigned char *failed;  /* pieces */
    int statistics;
    double faintest;         /* a frame with no state of a larger log-density leaves its sequence to the twin */
    const double *durations; /* (K, longest) of an Hsmm, else NULL */
    int longest;
} Job;

typedef struct {             /* ForwardFilter: everything padded to whole vectors of states */
    int D, K, nv, patience;
    double gate;
    double *origin, *factors, *centres, *peak, *chain, *initial, *log_b, *h, *predicted;
    double *weights, *state; /* owned by Python */
} Tick;

typedef struct {
    int K, nv, n_in, n_out;
    double *gains, *offsets, *h;
} Line;

typedef struct {
    const Model *model;
    int n_axes, n_forces;
    int64_t n, length, force_step; /* force_step: T when every roll-out has its own forces, else 0 */
    const double *start, *force;
    const void *matrix;            /* (K, columns) the chain, and each axis' line: offset, gains; `columns` is even */
    int columns;
    const int64_t *source;         /* (D) which of (position, force, velocity) each channel of the evidence is */
    double gate, dt, *position, *velocity;
    atomic_int *lost;              /* not 0: a path is not finite */
} Rollouts;

typedef struct Level {
    const char *name;
    int lanes, vector;           /* numbers in a vector; its size in float64 numbers */
    const struct Level *single;  /* the same instruction set with float32 */
    void (*group)(const Job *, int, double *, double *);
    void (*alone)(const Job *, int64_t, double *, double *);
    void (*mixture)(const Job *, int, double *, double *);
    void (*paths)(const Job *, int, double *);
    void (*path_alone)(const Job *, int64_t, double *);
    int (*tick)(Tick *, const double *);
    void (*line)(const Line *, const double *, const double *, double *);
    void (*rollouts)(const Rollouts *, int, double *);
} Level;

typedef double Four __attribute__((vector_size(32)));

#if defined(__clang__) || __GNUC__ >= 12
#define SHUFFLE(a, b, ...) __builtin_shufflevector(a, b, __VA_ARGS__)
#else
#define SHUFFLE(a, b, ...) __builtin_shuffle(a, b, (ivec){__VA_ARGS__})
#endif
typedef float Four32 __attribute__((vector_size(16)));
typedef float Eight32 __attribute__((vector_size(32)));

/* Keeps a vector in its register: a compiler would load it again for each multiplication that it takes part in. */
#if defined(__x86_64__)
#define HOLD(v) __asm__("" : "+v"(v))
#elif defined(__aarch64__)
#define HOLD(v) __asm__("" : "+w"(v))
#else
#define HOLD(v) (void)(v)
#endif

#if defined(__x86_64__)
#include <immintrin.h>
#define AVX512 __attribute__((target("avx512f,avx512dq,avx512vl,avx512bw,avx2,fma")))
#define AVX2 __attribute__((target("avx2,fma")))
#define SINGLE
#define W 16
#define NAME(x) x##_avx512_single
#define TARGET AVX512
#define LARGER(a, b) _mm512_max_ps(a, b)
#define SMALLER(a, b) _mm512_min_ps(a, b)
#define LEVEL_NAME "avx512"
#include "_lanes.h"
#define SINGLE_LEVEL level_avx512_single
#define W 8
#define NAME(x) x##_avx512
#define TARGET AVX512
#define LARGER(a, b) _mm512_max_pd(a, b)
#define SMALLER(a, b) _mm512_min_pd(a, b)
#define LEVEL_NAME "avx512"
#include "_lanes.h"
#undef SINGLE_LEVEL
#define SINGLE
#define W 8
#define NAME(x) x##_avx2_single
#define TARGET AVX2
#define LARGER(a, b) _mm256_max_ps(a, b)
#define SMALLER(a, b) _mm256_min_ps(a, b)
#define LEVEL_NAME "avx2"
#include "_lanes.h"
#define SINGLE_LEVEL level_avx2_single
#define W 4
#define NAME(x) x##_avx2
#define TARGET AVX2
#define LARGER(a, b) _mm256_max_pd(a, b)
#define SMALLER(a, b) _mm256_min_pd(a, b)
#define LEVEL_NAME "avx2"
#include "_lanes.h"
#undef SINGLE_LEVEL
#endif
#define SINGLE
#define W 4 /* SSE2 and NEON, and what a compiler makes of four numbers elsewhere */
#define NAME(x) x##_plain_single
#define TARGET
#define LEVEL_NAME "plain"
#include "_lanes.h"
#define SINGLE_LEVEL level_plain_single
#define W 2
#define NAME(x) x##_plain
#define TARGET
#define LEVEL_NAME "plain"
#include "_lanes.h"

static const Level *const LEVELS[] = {
#if defined(__x86_64__)
    &level_avx512, &level_avx2,
#endif
    &level_plain,
};
enum { N_LEVELS = sizeof LEVELS / sizeof *LEVELS };
static const Level *active;

static int runs_here(const Level *level) {
#if defined(__x86_64__)
    if (level == &level_avx512)
        return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl") &&
               __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("fma");
    if (level == &level_avx2) return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
#endif
    (void)level;
    return 1;
}

/* Numbers below 1e-308 cost a hundred cycles each and mean nothing here. They are flushed to zero while a kernel runs, in its own
 * thread, and the thread gets its mode back: a library that switches the whole process changes other people's results. */
#if defined(__x86_64__)
typedef unsigned Mode;
static Mode flush_denormals(void) {
    const Mode before = _mm_getcsr();
    _mm_setcsr(before | 0x8040);
    return before;
}
static void restore(Mode mode) { _mm_setcsr(mode); }
#elif defined(__aarch64__)
typedef uint64_t Mode;
static Mode flush_denormals(void) {
    Mode before;
    __asm__ volatile("mrs %0, fpcr" : "=r"(before));
    __asm__ volatile("msr fpcr, %0" ::"r"(before | 1 << 24));
    return before;
}
static void restore(Mode mode) { __asm__ volatile("msr fpcr, %0" ::"r"(mode)); }
#else
typedef int Mode;
static Mode flush_denormals(void) { return 0; }
static void restore(Mode mode) { (void)mode; }
#endif

/* ------------------------------------------------------------------------------------------------------- memory */

static double *aligned(size_t doubles) { return aligned_alloc(64, (doubles * sizeof(double) + 127) / 64 * 64); }

/* One block is kept between calls: EM asks for the same workspace hundreds of times, and fresh pages cost more than small models.
 * Taken and given back under the GIL. Its size stands in front of it. */
static double *spare;
enum { MOST_SPARE = 4 << 20, HEADER = 8 }; /* doubles */

static double *take_space(size_t doubles) {
    double *block = spare;
    spare = NULL;
    if (block && block[0] < (double)doubles) {
        free(block);
        block = NULL;
    }
    if (!block && (block = aligned(doubles + HEADER))) block[0] = (double)doubles;
    return block ? block + HEADER : NULL;
}

static void give_space(double *space) {
    double *block = space - HEADER;
    if (spare || block[0] > MOST_SPARE) free(block);
    else spare = block;
}

typedef struct { Py_buffer view; } Array;

/* Contiguous numbers of 8 bytes from any object with the buffer protocol; -1 with a Python error. `count` < 0 takes any number. */
static int get(Array *array, PyObject *object, int writable, Py_ssize_t count, Py_ssize_t size, const char *name) {
    if (PyObject_GetBuffer(object, &array->view, writable ? PyBUF_WRITABLE : PyBUF_SIMPLE) < 0) return -1;
    if (count >= 0 && array->view.len != count * size) {
        PyErr_Format(PyExc_ValueError, "%s has %zd bytes; expected %zd", name, array->view.len, count * size);
        PyBuffer_Release(&array->view);
        array->view.obj = NULL;
        return -1;
    }
    return 0;
}

enum { MOST_ARRAYS = 32 };
typedef struct { Array at[MOST_ARRAYS]; int n; } Arrays;

static void *take(Arrays *arrays, PyObject *object, int writable, Py_ssize_t count, Py_ssize_t size, const char *name) {
    if (PyErr_Occurred()) return NULL;
    if (arrays->n == MOST_ARRAYS) return PyErr_Format(PyExc_ValueError, "more than %d arrays", MOST_ARRAYS), NULL;
    if (get(&arrays->at[arrays->n], object, writable, count, size, name) < 0) return NULL;
    return arrays->at[arrays->n++].view.buf;
}

#define NUMBERS(object, count) take(&arrays, object, 0, count, 8, #object)
#define RESULT(object, count) take(&arrays, object, 1, count, 8, #object)

static void release(Arrays *arrays) {
    for (int i = 0; i < arrays->n; i++) PyBuffer_Release(&arrays->at[i].view);
}

static Py_ssize_t count_of(PyObject *object) {
    Array array;
    if (get(&array, object, 0, -1, 8, "") < 0) return -1;
    const Py_ssize_t n = array.view.len / 8;
    PyBuffer_Release(&array.view);
    return n;
}

/* -------------------------------------------------------------------------------------------------------- models */

static double *carve(double **from, size_t n) {
    double *block = *from;
    *from += (n + 15) / 16 * 16; /* whole vectors in float32, too */
    return block;
}

static int vectors(int n, int lanes) { return (n + lanes - 1) / lanes; }

/* All from `factors` to `end` becomes float32, in place. */
static void narrow(Model *m, const double *end) {
    char *base = m->factors;
    void **const at[] = {&m->factors, &m->centres, &m->peak, &m->initial, &m->log_initial, &m->forward, &m->backward,
                         &m->forward_across, &m->backward_across};
    for (ptrdiff_t i = 0, n = end - (double *)m->factors; i < n; i++) {
        double number;
        memcpy(&number, base + i * sizeof(double), sizeof number);
        const float narrower = (float)number;
        memcpy(base + i * sizeof(float), &narrower, sizeof narrower);
    }
    for (size_t i = 0; i < sizeof at / sizeof *at; i++) *at[i] = base + ((char *)*at[i] - base) / 2;
}

/* Takes apart a Whitening for `level`; `transition` may be NULL for a mixture. Gives the block to free, or NULL. */
static double *lay_out(const Level *level, Model *m, int D, int K, const double *origin, const double *factors, const double *centres,
                       const double *peak, const double *initial, const double *transition) {
    const int Ke = K + (K & 1), nv = vectors(K, level->lanes), Kp = nv * level->lanes, triangle = D * (D + 1) / 2;
    m->D = D, m->K = K, m->Ke = Ke, m->nv = nv;
    m->n_pairs = (D + 1) * (D + 2) / 2;
    m->pairs = m->n_pairs + (m->n_pairs & 1);
    m->slot_size = ((size_t)K * m->n_pairs + K * K + K + 7) / 8 * 8;
    const size_t size = D + 2 * m->pairs + (size_t)K * triangle + K * D + K + 2 * (Kp + 2) + 2 * (size_t)Ke * Ke + 2 * (size_t)K * Kp + 256;
    double *block = aligned(size), *free_from = block;
    if (!block) return NULL;
    memset(block, 0, size * sizeof(double));
    m->origin = carve(&free_from, D);
    ptrdiff_t *pair = m->pair = (ptrdiff_t *)carve(&free_from, 2 * m->pairs);
    for (int i = 0; i <= D; i++)
        for (int j = i; j <= D; j++) *pair++ = i * TILES, *pair++ = j * TILES; /* behind the last one: (0, 0) once more */
    double *packed = m->factors = carve(&free_from, (size_t)K * triangle);
    double *scaled_centres = m->centres = carve(&free_from, (size_t)K * D);
    m->peak = carve(&free_from, K);
    double *first = m->initial = carve(&free_from, Kp + 2), *log_first = m->log_initial = carve(&free_from, Kp + 2);
    double *forward = m->forward = carve(&free_from, (size_t)Ke * Ke), *backward = m->backward = carve(&free_from, (size_t)Ke * Ke);
    double *forward_across = m->forward_across = carve(&free_from, (size_t)K * Kp);
    double *backward_across = m->backward_across = carve(&free_from, (size_t)K * Kp);
    memcpy(m->origin, origin, sizeof(double) * D);
    for (int k = 0; k < K; k++) ((double *)m->peak)[k] = M_LOG2E * peak[k];
    for (int row = 0; row < K * D; row++) {
        for (int e = 0; e <= row % D; e++) *packed++ = TO_EXPONENT * factors[(size_t)row * D + e];
        scaled_centres[row] = TO_EXPONENT * centres[row];
    }
    for (int i = 0; i < K; i++) log_first[i] = first[i] = initial[i];
    for (int i = 0; i < K && transition; i++)
        for (int j = 0; j < K; j++) {
            const double a = transition[i * K + j];
            forward[i * Ke + j] = backward[j * Ke + i] = a;
            forward_across[i * Kp + j] = backward_across[j * Kp + i] = a;
        }
    if (!level->single) narrow(m, free_from);
    return block;
}

/* ------------------------------------------------------------------------------------------------------- threads */

typedef struct {
    const Job *job;
    const Rollouts *rollouts;
    const Level *level;
    int n_groups, n_slots, mixture;
    size_t space_size, slot_size;
    double *space, *slots;
    atomic_int next_slot, next_space;
} Work;

/* Of n_groups: many, so that no thread waits long for the last one. */
static int slots_for(int n_groups, size_t slot_size) {
    const size_t room = SLOTS_SIZE / slot_size, n = room < SLOTS ? SLOTS : room > MOST_SLOTS ? MOST_SLOTS : room;
    return n_groups < (int)n ? n_groups : (int)n;
}

static void segments_of(const Level *level, const Job *job, int64_t sequence, double *space, double *slot);

static int is_whole(const Piece *p) { return p->begin == p->from && p->to == p->end; }

static void *work(void *argument) {
    Work *w = argument;
    double *space = w->space + w->space_size * atomic_fetch_add(&w->next_space, 1);
    const int lanes = w->level->lanes;
    const Mode mode = flush_denormals();
    for (int s; (s = atomic_fetch_add(&w->next_slot, 1)) < w->n_slots;)
        for (int g = s; g < w->n_groups; g += w->n_slots) {
            double *slot = w->slots + w->slot_size * s;
            if (w->job && w->job->durations) {
                segments_of(w->level, w->job, g, space, slot);
                continue;
            }
            const int64_t *lane = w->mixture || w->rollouts ? NULL : w->job->lanes + (int64_t)g * lanes;
            const int64_t only = lane && lane[lanes] - lane[0] == 1 ? w->job->order[lane[0]] : -1;
            if (w->rollouts) w->level->rollouts(w->rollouts, g, space);
            else if (w->mixture) w->level->mixture(w->job, g, space, slot);
            else if (w->job->path && only >= 0) w->level->path_alone(w->job, only, space);
            else if (w->job->path) w->level->paths(w->job, g, space);
            else if (only >= 0 && is_whole(&w->job->pieces[only])) w->level->alone(w->job, only, space, slot);
            else w->level->group(w->job, g, space, slot);
        }
    restore(mode);
    return NULL;
}

static size_t common_space(const Model *m, const Level *level) { /* what does not grow with the length of a sequence */
    const size_t Ke = m->Ke;
    return level->vector * (Ke * m->pairs + Ke * Ke + 4 * TILES * Ke + 4 * Ke + TILES * (m->D + 1)) + m->slot_size + 64;
}

static size_t space_of(const Job *job, int g, const Level *level) {
    const Model *m = job->model;
    const int lanes = level->lanes;
    const int64_t *lane = job->lanes + (int64_t)g * lanes;
    int64_t length = 0;
    for (int l = 0; l < lanes; l++) {
        int64_t n = 0;
        for (int64_t o = lane[l]; o < lane[l + 1]; o++) n += job->pieces[job->order[o]].end - job->pieces[job->order[o]].begin;
        length = n > length ? n : length;
    }
    if (lane[lanes] - lane[0] == 1) {
        const size_t block = TILES * lanes, padded = (length + block - 1) / block * block;
        return common_space(m, level) + padded * (2 * m->nv * level->vector + 1) +
               level->vector * m->nv * (2 * block + 1 + m->K + TILES * lanes);
    }
    const size_t padded = (length + TILES - 1) / TILES * TILES;
    return common_space(m, level) + padded * (level->vector * (m->D + 1 + 2 * m->Ke + 1) + lanes) + 3 * (padded / 4 + 8);
}

/* Multiplications, roughly. */
static double products_of(const Work *w) {
    const Model *m = w->rollouts ? w->rollouts->model : w->job->model;
    const double frames = w->rollouts ? (double)w->rollouts->n * (double)w->rollouts->length : (double)w->job->n_frames;
    return frames * m->K * (m->D * (m->D + 3.0) + 3.0 * m->K + (w->job ? w->job->longest : 0));
}

/* Runs all groups and leaves the sum of all slots in w->slots; -1 without memory. */
static int run(Work *w, int n_threads) {
    pthread_t threads[MOST_THREADS];
    int started = 0;
    const double most = 1.0 + products_of(w) / WORTH_A_THREAD;
    if (n_threads > most) n_threads = (int)most;
    if (n_threads > w->n_slots) n_threads = w->n_slots;
    if (n_threads > MOST_THREADS) n_threads = MOST_THREADS;
    if (n_threads < 1) n_threads = 1;
    w->space_size = (w->space_size + 7) / 8 * 8;
    const size_t size = w->space_size * n_threads + w->slot_size * w->n_slots;
    if (!(w->space = take_space(size))) return -1;
    w->slots = w->space + w->space_size * n_threads;
    Py_BEGIN_ALLOW_THREADS
    memset(w->slots, 0, sizeof(double) * w->slot_size * w->n_slots);
    while (started + 1 < n_threads && pthread_create(&threads[started], NULL, work, w) == 0) started++;
    work(w);
    for (int i = 0; i < started; i++) pthread_join(threads[i], NULL);
    for (int s = 1; s < w->n_slots; s++)
        for (size_t i = 0; i < w->slot_size; i++) w->slots[i] += w->slots[s * w->slot_size + i];
    Py_END_ALLOW_THREADS
    return 0;
}

static void unpack_moments(const Model *m, const double *slots, double *moments) {
    const int n = m->D + 1;
    for (int k = 0; k < m->K; k++)
        for (int i = 0; i < n; i++)
            for (int j = i; j < n; j++) moments[(k * n + i) * n + j] = moments[(k * n + j) * n + i] = *slots++;
}

static int plan_is_sound(const Job *job, const int64_t *first, int64_t S, int64_t P, int64_t n_order, int64_t n_lanes) {
    const int64_t *order = job->order, *lanes = job->lanes;
    if (first[0] != 0 || first[S] != P) return 0;
    for (int64_t s = 0; s < S; s++) {
        if (first[s + 1] <= first[s]) return 0;
        for (const Piece *p = job->pieces + first[s]; p < job->pieces + first[s + 1]; p++) {
            const int begins = p == job->pieces + first[s], ends = p + 1 == job->pieces + first[s + 1];
            if (p->begin < 0 || p->from < p->begin || p->to <= p->from || p->end < p->to || p->end > job->n_frames) return 0;
            if ((p->begin == p->from) != begins || (p->to == p->end) != ends || (!ends && p[1].from != p->to)) return 0;
        }
    }
    for (int64_t o = 0; o < n_order; o++)
        if (order[o] < 0 || order[o] >= P) return 0;
    if (lanes[0] < 0 || lanes[n_lanes] > n_order) return 0;
    for (int64_t l = 0; l < n_lanes; l++)
        if (lanes[l + 1] < lanes[l]) return 0;
    return 1;
}

/* Where two pieces meet: `apart`, how far they disagree about the frame before their seam, as posterior probability (the second may
 * have forgotten too little of what it never saw, the first too little of what comes; NaN where nothing fits), and `gain`, by how much
 * less likely what comes is after what the first has seen than after what the second has, in nats. Pieces may agree on where they are
 * and not on how much that surprises: after a rest beside its state the filter knows better by e^100, and the posterior cannot see it. */
typedef struct {
    double apart, gain;
} Seam;

static Seam seam_of(const double *seams, int64_t piece, int K) {
    const double *alpha = seams + (piece * 2 + 1) * 2 * K, *guess = alpha + K, *start = guess + K, *beta = start + K;
    double of_alpha = 0.0, of_guess = 0.0, of_start = 0.0, all_alpha = 0.0, all_start = 0.0;
    Seam found = {0.0, 0.0};
    for (int k = 0; k < K; k++) {
        of_alpha += alpha[k] * beta[k], of_guess += alpha[k] * guess[k], of_start += start[k] * beta[k];
        all_alpha += alpha[k], all_start += start[k];
    }
    for (int k = 0; k < K; k++) {
        const double gamma = alpha[k] * beta[k] / of_alpha;
        found.apart += fabs(start[k] * beta[k] / of_start - gamma) + fabs(alpha[k] * guess[k] / of_guess - gamma);
    }
    found.gain = log(of_alpha / all_alpha) - log(of_start / all_start);
    return found;
}

/* What became of the pieces becomes what became of the sequences: whether one failed, or has a seam that is open. Where all seams are
 * closed, what a piece said about its frames after a start from anywhere becomes what they are after all frames before. */
static int join(const Job *job, const int64_t *first, int64_t S, double most_apart, double *log_likelihood, unsigned char *failed) {
    int any = 0;
    for (int64_t s = 0; s < S; s++) {
        log_likelihood[s] = failed[s] = 0;
        for (int64_t p = first[s]; p < first[s + 1]; p++) {
            log_likelihood[s] += job->log_likelihood[p];
            failed[s] |= job->failed[p];
            if (p + 1 == first[s + 1]) continue;
            const Seam seam = seam_of(job->seams, p, job->model->K);
            log_likelihood[s] += seam.gain;
            failed[s] |= !(seam.apart < most_apart);
        }
        any |= failed[s];
    }
    return any;
}

/* ----------------------------------------------------------------------------------------------- Python functions */

static PyObject *e_step(PyObject *self, PyObject *args) {
    PyObject *frames, *first_piece, *pieces, *order, *lanes, *initial, *transition, *origin, *factors, *centres, *peak, *moments, *transitions,
        *first, *log_likelihood, *failed, *weights;
    int n_threads, single;
    double faintest;
    (void)self;
    if (!PyArg_ParseTuple(args, "OOOOOOOOOOOOOOOOO(iid)", &frames, &first_piece, &pieces, &order, &lanes, &initial, &transition, &origin,
                          &factors, &centres, &peak, &moments, &transitions, &first, &log_likelihood, &failed, &weights, &n_threads, &single,
                          &faintest))
        return NULL;
    const Level *level = single ? active->single : active;
    const Py_ssize_t D = count_of(origin), K = count_of(peak), S = count_of(first_piece) - 1, n_order = count_of(order);
    const Py_ssize_t n_lanes = count_of(lanes) - 1, N = D > 0 ? count_of(frames) / D : 0, P = count_of(pieces) / 4;
    if (PyErr_Occurred()) return NULL;
    if (D < 1 || K < 1 || S < 1 || P < S || n_lanes < level->lanes || n_lanes % level->lanes)
        return PyErr_Format(PyExc_ValueError, "nothing to do, or a plan for other lanes than %d", level->lanes);
    Arrays arrays = {.n = 0};
    PyObject *result = NULL;
    Model model;
    const int statistics = moments != Py_None;
    Job job = {.model = &model, .n_frames = N, .statistics = statistics, .faintest = faintest};
    job.frames = NUMBERS(frames, N * D);
    const int64_t *first_of = NUMBERS(first_piece, S + 1);
    job.pieces = NUMBERS(pieces, P * 4);
    job.order = NUMBERS(order, n_order);
    job.lanes = NUMBERS(lanes, n_lanes + 1);
    const double *pi = NUMBERS(initial, K), *a = NUMBERS(transition, K * K), *o = NUMBERS(origin, D), *f = NUMBERS(factors, K * D * D);
    const double *c = NUMBERS(centres, K * D), *p = NUMBERS(peak, K);
    double *ll_out = RESULT(log_likelihood, S);
    unsigned char *failed_out = take(&arrays, failed, 1, S, 1, "failed");
    double *m_out = NULL, *t_out = NULL, *f_out = NULL;
    if (statistics) m_out = RESULT(moments, K * (D + 1) * (D + 1)), t_out = RESULT(transitions, K * K), f_out = RESULT(first, K);
    if (weights != Py_None) job.weights = RESULT(weights, N * K);
    double *block = NULL, *per_piece = NULL;
    if (PyErr_Occurred()) goto done;
    if (!plan_is_sound(&job, first_of, S, P, n_order, n_lanes)) {
        PyErr_SetString(PyExc_ValueError, "the plan does not fit the sequences");
        goto done;
    }
    if (!(block = lay_out(level, &model, (int)D, (int)K, o, f, c, p, pi, a))) {
        PyErr_NoMemory();
        goto done;
    }
    const size_t seams = P > S ? P * 4 * K : 0;
    if (!(per_piece = calloc(2 * P + seams, sizeof(double)))) {
        PyErr_NoMemory();
        goto done;
    }
    job.log_likelihood = per_piece, job.seams = per_piece + P, job.failed = (unsigned char *)(per_piece + P + seams);
    Work w = {.job = &job, .level = level, .n_groups = (int)(n_lanes / level->lanes)};
    w.slot_size = model.slot_size;
    w.n_slots = slots_for(w.n_groups, w.slot_size);
    for (int g = 0; g < w.n_groups; g++) {
        const size_t size = space_of(&job, g, level);
        w.space_size = size > w.space_size ? size : w.space_size;
    }
    if (run(&w, n_threads) < 0) {
        PyErr_NoMemory();
        goto done;
    }
    if (statistics) {
        unpack_moments(&model, w.slots, m_out);
        const double *steps = w.slots + (size_t)K * model.n_pairs;
        for (Py_ssize_t i = 0; i < K * K; i++) t_out[i] = a[i] * steps[i];
        memcpy(f_out, steps + K * K, sizeof(double) * K);
    }
    give_space(w.space);
    result = PyBool_FromLong(join(&job, first_of, S, single ? SEAM_SINGLE : SEAM, ll_out, failed_out));
done:
    free(per_piece);
    free(block);
    release(&arrays);
    return result;
}

static PyObject *mixture(PyObject *self, PyObject *args) {
    PyObject *frames, *log_weights, *origin, *factors, *centres, *peak, *moments, *weights;
    int n_threads, single;
    (void)self;
    if (!PyArg_ParseTuple(args, "OOOOOOOOii", &frames, &log_weights, &origin, &factors, &centres, &peak, &moments, &weights, &n_threads,
                          &single))
        return NULL;
    const Level *level = single ? active->single : active;
    const Py_ssize_t D = count_of(origin), K = count_of(peak), N = D > 0 ? count_of(frames) / D : 0;
    if (PyErr_Occurred()) return NULL;
    if (D < 1 || K < 1 || N < 1) return PyErr_Format(PyExc_ValueError, "nothing to do");
    Arrays arrays = {.n = 0};
    PyObject *result = NULL;
    Model model;
    Job job = {.model = &model, .n_frames = N};
    job.frames = NUMBERS(frames, N * D);
    const double *pi = NUMBERS(log_weights, K), *o = NUMBERS(origin, D), *f = NUMBERS(factors, K * D * D);
    const double *c = NUMBERS(centres, K * D), *p = NUMBERS(peak, K);
    double *m_out = RESULT(moments, K * (D + 1) * (D + 1)), *block = NULL;
    if (weights != Py_None) job.weights = RESULT(weights, N * K);
    if (PyErr_Occurred()) goto done;
    Work w = {.job = &job, .level = level, .n_groups = (int)((N + PIECE - 1) / PIECE), .mixture = 1};
    job.log_likelihood = malloc(sizeof(double) * w.n_groups);
    block = lay_out(level, &model, (int)D, (int)K, o, f, c, p, pi, NULL);
    if (job.log_likelihood && block) {
        w.slot_size = ((size_t)K * model.n_pairs + 7) / 8 * 8;
        w.n_slots = slots_for(w.n_groups, w.slot_size);
        w.space_size = common_space(&model, level);
    }
    if (!job.log_likelihood || !block || run(&w, n_threads) < 0) {
        PyErr_NoMemory();
        goto done;
    }
    unpack_moments(&model, w.slots, m_out);
    give_space(w.space);
    double total = 0.0;
    for (int g = 0; g < w.n_groups; g++) total += job.log_likelihood[g];
    result = PyFloat_FromDouble(total);
done:
    free(job.log_likelihood);
    free(block);
    release(&arrays);
    return result;
}

static PyObject *decode(PyObject *self, PyObject *args) {
    PyObject *frames, *first_piece, *pieces, *order, *lanes, *log_initial, *log_transition, *origin, *factors, *centres, *peak, *path, *score;
    int n_threads;
    (void)self;
    if (!PyArg_ParseTuple(args, "OOOOOOOOOOOOOi", &frames, &first_piece, &pieces, &order, &lanes, &log_initial, &log_transition, &origin,
                          &factors, &centres, &peak, &path, &score, &n_threads))
        return NULL;
    const Py_ssize_t D = count_of(origin), K = count_of(peak), S = count_of(first_piece) - 1, n_order = count_of(order);
    const Py_ssize_t n_lanes = count_of(lanes) - 1, N = D > 0 ? count_of(frames) / D : 0;
    if (PyErr_Occurred()) return NULL;
    if (D < 1 || K < 1 || S < 1 || n_lanes < active->lanes || n_lanes % active->lanes)
        return PyErr_Format(PyExc_ValueError, "nothing to do, or a plan for other lanes than %d", active->lanes);
    Arrays arrays = {.n = 0};
    PyObject *result = NULL;
    Model model;
    Job job = {.model = &model, .n_frames = N};
    job.frames = NUMBERS(frames, N * D);
    const int64_t *first_of = NUMBERS(first_piece, S + 1);
    job.pieces = NUMBERS(pieces, S * 4);
    job.order = NUMBERS(order, n_order);
    job.lanes = NUMBERS(lanes, n_lanes + 1);
    const double *pi = NUMBERS(log_initial, K), *a = NUMBERS(log_transition, K * K), *o = NUMBERS(origin, D);
    const double *f = NUMBERS(factors, K * D * D), *c = NUMBERS(centres, K * D), *p = NUMBERS(peak, K);
    job.path = RESULT(path, N);
    job.log_likelihood = RESULT(score, S);
    double *block = NULL;
    if (PyErr_Occurred()) goto done;
    if (!plan_is_sound(&job, first_of, S, S, n_order, n_lanes)) {
        PyErr_SetString(PyExc_ValueError, "the plan does not fit the sequences, or cuts one");
        goto done;
    }
    block = lay_out(active, &model, (int)D, (int)K, o, f, c, p, pi, a);
    Work w = {.job = &job, .level = active, .n_groups = (int)(n_lanes / active->lanes)};
    w.n_slots = w.n_groups;
    for (int g = 0; block && g < w.n_groups; g++) {
        const size_t size = space_of(&job, g, active);
        w.space_size = size > w.space_size ? size : w.space_size;
    }
    if (!block || run(&w, n_threads) < 0) {
        PyErr_NoMemory();
        goto done;
    }
    give_space(w.space);
    result = Py_NewRef(Py_None);
done:
    free(block);
    release(&arrays);
    return result;
}

static PyObject *rollouts(PyObject *self, PyObject *args) {
    PyObject *start, *force, *source, *initial, *origin, *factors, *centres, *peak, *matrix, *position, *velocity;
    double gate, dt;
    int n_threads, single;
    Py_ssize_t d, f, n, T;
    (void)self;
    if (!PyArg_ParseTuple(args, "nnnnOOOOOOOOOddOOii", &d, &f, &n, &T, &start, &force, &source, &initial, &origin,
                          &factors, &centres, &peak, &matrix, &gate, &dt, &position, &velocity, &n_threads, &single))
        return NULL;
    const Level *level = single ? active->single : active;
    const Py_ssize_t D = count_of(origin), K = count_of(peak), n_force = count_of(force);
    if (PyErr_Occurred()) return NULL;
    if (D < 1 || K < 1 || d < 1 || f < 0 || n < 1 || T < 1 || (n_force != T * f && n_force != n * T * f))
        return PyErr_Format(PyExc_ValueError, "nothing to do, or forces of another shape");
    Arrays arrays = {.n = 0};
    PyObject *result = NULL;
    Model model;
    atomic_int lost = 0;
    Rollouts job = {.model = &model, .n_axes = (int)d, .n_forces = (int)f, .n = n, .length = T, .gate = gate, .dt = dt, .lost = &lost};
    job.force_step = n_force == T * f ? 0 : T;
    job.start = NUMBERS(start, n * d);
    job.force = NUMBERS(force, n_force);
    job.source = NUMBERS(source, D);
    const double *pi = NUMBERS(initial, K), *o = NUMBERS(origin, D), *fa = NUMBERS(factors, K * D * D);
    const double *c = NUMBERS(centres, K * D), *p = NUMBERS(peak, K);
    job.columns = (int)(K + d * (1 + d + f) + 1) / 2 * 2;
    job.matrix = take(&arrays, matrix, 0, K * job.columns, single ? 4 : 8, "matrix");
    job.position = RESULT(position, n * T * d);
    job.velocity = RESULT(velocity, n * T * d);
    double *block = NULL;
    if (PyErr_Occurred()) goto done;
    for (Py_ssize_t i = 0; i < D; i++)
        if (job.source[i] < 0 || job.source[i] >= 2 * d + f) {
            PyErr_SetString(PyExc_ValueError, "a channel of the evidence has no source");
            goto done;
        }
    block = lay_out(level, &model, (int)D, (int)K, o, fa, c, p, pi, NULL);
    Work w = {.rollouts = &job, .level = level, .n_groups = (int)((n + TILES * level->lanes - 1) / (TILES * level->lanes))};
    w.n_slots = w.n_groups;
    w.space_size = block ? common_space(&model, level) + (size_t)level->vector * TILES * ((RUN + 1) * (2 * d + f) + job.columns) : 0;
    if (!block || run(&w, n_threads) < 0) {
        PyErr_NoMemory();
        goto done;
    }
    give_space(w.space);
    result = PyBool_FromLong(!atomic_load(&lost));
done:
    free(block);
    release(&arrays);
    return result;
}

/* ------------------------------------------------------------------------------------------------- prepared objects */

typedef struct {
    PyObject_HEAD
    Tick tick;
    const Level *level;
    double *block;
    Array weights, state;
} Filter;

static void across_states(double *to, const double *from, int n_rows, int K, int Kp) { /* (rows, K) -> (rows, Kp) */
    for (int i = 0; i < n_rows; i++) memcpy(to + (size_t)i * Kp, from + (size_t)i * K, sizeof(double) * K);
}

static void transposed(double *to, const double *from, int K, int n, int Kp) { /* (K, n) -> (n, Kp) */
    for (int k = 0; k < K; k++)
        for (int i = 0; i < n; i++) to[(size_t)i * Kp + k] = from[(size_t)k * n + i];
}

static PyObject *filter_new(PyTypeObject *type, PyObject *args, PyObject *keywords) {
    PyObject *origin, *factors, *centres, *peak, *initial, *chain, *weights, *state;
    double gate;
    int patience;
    (void)keywords;
    if (!PyArg_ParseTuple(args, "OOOOOOOOdi", &origin, &factors, &centres, &peak, &initial, &chain, &weights, &state, &gate, &patience))
        return NULL;
    const Py_ssize_t D = count_of(origin), K = count_of(peak);
    if (PyErr_Occurred()) return NULL;
    if (D < 1 || K < 1 || D > MOST_CHANNELS) return PyErr_Format(PyExc_ValueError, "from 1 to %d channels", MOST_CHANNELS);
    Filter *self = (Filter *)PyType_GenericAlloc(type, 0);
    if (!self) return NULL;
    Arrays arrays = {.n = 0};
    const double *o = NUMBERS(origin, D), *f = NUMBERS(factors, K * D * D), *c = NUMBERS(centres, K * D), *p = NUMBERS(peak, K);
    const double *pi = NUMBERS(initial, K), *a = NUMBERS(chain, K * K);
    if (PyErr_Occurred() || get(&self->weights, weights, 1, K, 8, "weights") < 0 || get(&self->state, state, 1, STATE_SIZE, 8, "state") < 0)
        goto wrong;
    Tick *t = &self->tick;
    self->level = active;
    t->D = (int)D, t->K = (int)K, t->nv = vectors((int)K, active->lanes), t->gate = gate, t->patience = patience;
    const size_t Kp = (size_t)t->nv * active->lanes, triangle = D * (D + 1) / 2;
    const size_t size = D + Kp * (triangle + D + K + 5) + 128;
    double *from = self->block = aligned(size);
    if (!from) {
        PyErr_NoMemory();
        goto wrong;
    }
    memset(from, 0, size * sizeof(double));
    t->origin = carve(&from, D);
    t->factors = carve(&from, triangle * Kp);
    t->centres = carve(&from, D * Kp);
    t->chain = carve(&from, K * Kp);
    t->peak = carve(&from, Kp);
    t->initial = carve(&from, Kp);
    t->log_b = carve(&from, Kp);
    t->h = carve(&from, Kp);
    t->predicted = carve(&from, Kp);
    memcpy(t->origin, o, sizeof(double) * D);
    for (Py_ssize_t k = 0; k < K; k++) {
        size_t at = 0;
        for (Py_ssize_t d = 0; d < D; d++)
            for (Py_ssize_t e = 0; e <= d; e++) t->factors[Kp * at++ + k] = f[(k * D + d) * D + e];
    }
    transposed(t->centres, c, (int)K, (int)D, (int)Kp);
    across_states(t->chain, a, (int)K, (int)K, (int)Kp);
    across_states(t->initial, pi, 1, (int)K, (int)Kp);
    for (size_t k = 0; k < Kp; k++) t->peak[k] = k < (size_t)K ? p[k] : -INFINITY;
    t->weights = self->weights.view.buf;
    t->state = self->state.view.buf;
    release(&arrays);
    return (PyObject *)self;
wrong:
    release(&arrays);
    Py_DecRef((PyObject *)self);
    return NULL;
}

static void filter_dealloc(PyObject *object) {
    Filter *self = (Filter *)object;
    PyTypeObject *type = Py_TYPE(object);
    if (self->weights.view.obj) PyBuffer_Release(&self->weights.view);
    if (self->state.view.obj) PyBuffer_Release(&self->state.view);
    free(self->block);
    freefunc release_object = (freefunc)PyType_GetSlot(type, Py_tp_free);
    release_object(object);
    Py_DecRef((PyObject *)type);
}

/* float64 numbers of a contiguous array, `n` of them; anything else is for the twin. */
static int vector(Array *array, PyObject *object, Py_ssize_t n, int writable) {
    if (PyObject_GetBuffer(object, &array->view, PyBUF_FORMAT | PyBUF_C_CONTIGUOUS | (writable ? PyBUF_WRITABLE : 0)) < 0) {
        PyErr_Clear();
        return 0;
    }
    const char *format = array->view.format;
    if (array->view.ndim == 1 && array->view.len == n * 8 && format && format[0] == 'd' && !format[1]) return 1;
    PyBuffer_Release(&array->view);
    return 0;
}

static PyObject *filter_step(PyObject *object, PyObject *xi) {
    Filter *self = (Filter *)object;
    Array array;
    if (!vector(&array, xi, self->tick.D, 0)) Py_RETURN_FALSE;
    const int done = self->level->tick(&self->tick, array.view.buf);
    PyBuffer_Release(&array.view);
    return PyBool_FromLong(done);
}

typedef struct {
    PyObject_HEAD
    Line line;
    const Level *level;
    double *block;
} Lines;

static PyObject *lines_new(PyTypeObject *type, PyObject *args, PyObject *keywords) {
    PyObject *gains, *offsets;
    int n_states, n_in, n_out;
    (void)keywords;
    if (!PyArg_ParseTuple(args, "OOiii", &gains, &offsets, &n_states, &n_out, &n_in)) return NULL;
    if (n_states < 1 || n_in < 1 || n_out < 1) return PyErr_Format(PyExc_ValueError, "states, inputs and outputs must be at least 1");
    Lines *self = (Lines *)PyType_GenericAlloc(type, 0);
    if (!self) return NULL;
    Arrays arrays = {.n = 0};
    const double *g = NUMBERS(gains, (Py_ssize_t)n_states * n_out * n_in), *o = NUMBERS(offsets, (Py_ssize_t)n_states * n_out);
    Line *r = &self->line;
    *r = (Line){.K = n_states, .nv = vectors(n_states, active->lanes), .n_in = n_in, .n_out = n_out};
    self->level = active;
    const size_t Kp = (size_t)r->nv * active->lanes, size = Kp * ((size_t)n_out * n_in + n_out + 1) + 64;
    double *from = PyErr_Occurred() ? NULL : (self->block = aligned(size));
    if (!from) {
        if (!PyErr_Occurred()) PyErr_NoMemory();
        release(&arrays);
        Py_DecRef((PyObject *)self);
        return NULL;
    }
    memset(from, 0, size * sizeof(double));
    r->gains = carve(&from, Kp * n_out * n_in);
    r->offsets = carve(&from, Kp * n_out);
    r->h = carve(&from, Kp);
    transposed(r->gains, g, n_states, n_out * n_in, (int)Kp);
    transposed(r->offsets, o, n_states, n_out, (int)Kp);
    release(&arrays);
    return (PyObject *)self;
}

static void lines_dealloc(PyObject *object) {
    PyTypeObject *type = Py_TYPE(object);
    free(((Lines *)object)->block);
    freefunc release_object = (freefunc)PyType_GetSlot(type, Py_tp_free);
    release_object(object);
    Py_DecRef((PyObject *)type);
}

static PyObject *lines_mean(PyObject *object, PyObject *const *args, Py_ssize_t n) {
    Lines *self = (Lines *)object;
    Array weights, x, out;
    if (n != 3) return PyErr_Format(PyExc_TypeError, "mean takes weights, x and out");
    if (!vector(&weights, args[0], self->line.K, 0)) Py_RETURN_FALSE;
    int done = 0;
    if (vector(&x, args[1], self->line.n_in, 0)) {
        if (vector(&out, args[2], self->line.n_out, 1)) {
            self->level->line(&self->line, weights.view.buf, x.view.buf, out.view.buf);
            PyBuffer_Release(&out.view);
            done = 1;
        }
        PyBuffer_Release(&x.view);
    }
    PyBuffer_Release(&weights.view);
    return PyBool_FromLong(done);
}

#include "_hsmm.h"

/* ---------------------------------------------------------------------------------------------- laws and envelope */


/* An array that comes again at every tick, taken once. Its exporter must be the array itself, as numpy's is, or another object might
 * one day sit at the same address. */
static double *kept(Array *slot, PyObject *object, Py_ssize_t n, int writable) {
    Py_buffer *view = &slot->view;
    if (view->obj == object) return view->buf;
    PyBuffer_Release(view);
    if (!vector(slot, object, n, writable)) {
        view->obj = NULL;
        return NULL;
    }
    if (view->obj == object) return view->buf;
    PyBuffer_Release(view);
    return NULL;
}

/* The same bits as in Python: nothing may be contracted. */
#if defined(__clang__)
#pragma clang fp contract(off)
#else
#pragma GCC push_options
#pragma GCC optimize("fp-contract=off")
#endif
#define TICK(law, filter, xi) (law)->level->tick(filter, xi)
#include "_layout.h"
#include "_exponential.h"
#include "_vectors.h"
#include "_path.h"
#include "_foresight.h"
#include "_law.h"
#include "_enter.h"
#include "_roles.h"
#include "_checker.h"
#include "_envelope.h"
#include "_guard.h"
#include "_ordinary.h"
#include "_beam.h"
#include "_rows.h"
#if !defined(__clang__)
#pragma GCC pop_options
#endif

enum { POSITION, FORCE, COMMAND, LAW_SLOTS = COMMAND + 3, OF_GOAL = 7 };

typedef struct {
    PyObject_HEAD
    Law law;
    Table *tables; /* law.tables */
    Arrays arrays;
    PyObject *filter, *bank;
    Role *role; /* of one that changes it, or NULL */
    Array slots[LAW_SLOTS];
} Laws;

static PyTypeObject *filter_type;

/* (filters, prior, centre, spread, numbers, p, probabilities, until) of evidence.RoleEvidence, which hears `width` channels */
static int take_bank(Laws *self, PyObject *bank, int width, const Filter *watch) {
    PyObject *filters, *prior, *centre, *spread, *numbers, *p, *probabilities, *until;
    Bank *b = &self->law.bank;
    if (!PyArg_ParseTuple(bank, "OOOOOOOO", &filters, &prior, &centre, &spread, &numbers, &p, &probabilities, &until)) return -1;
    const Py_ssize_t n = PyTuple_Size(filters), n_roles = count_of(probabilities) - 1;
    if (PyErr_Occurred()) return -1;
    if (n_roles < 1 || n < n_roles || n % n_roles) {
        PyErr_SetString(PyExc_ValueError, "a bank has as many filters for each role");
        return -1;
    }
    for (Py_ssize_t i = 0; i < n; i++) {
        const Filter *one = (Filter *)PyTuple_GetItem(filters, i);
        if (Py_TYPE((PyObject *)one) != filter_type || one->tick.D != width || one->level != watch->level) {
            PyErr_SetString(PyExc_ValueError, "a bank is of filters that hear the same channels");
            return -1;
        }
    }
#define TAKE(object, writable, count) take(&self->arrays, object, writable, count, 8, #object)
    b->prior = TAKE(prior, 0, n + 1), b->centre = TAKE(centre, 0, width), b->spread = TAKE(spread, 0, width);
    b->numbers = TAKE(numbers, 0, BANK_GATE + 1), b->p = TAKE(p, 1, n + 1), b->until = TAKE(until, 1, 1);
    b->probabilities = TAKE(probabilities, 1, n_roles + 1);
#undef TAKE
    if (PyErr_Occurred()) return -1;
    self->bank = Py_NewRef(bank);
    b->filters = malloc(n * sizeof *b->filters);
    b->seen = malloc((width + n + 1) * sizeof *b->seen);
    if (!b->filters || !b->seen) {
        PyErr_NoMemory();
        return -1;
    }
    b->said = b->seen + width;
    for (Py_ssize_t i = 0; i < n; i++) b->filters[i] = &((Filter *)PyTuple_GetItem(filters, i))->tick;
    b->n = (int)n, b->strengths = (int)(n / n_roles);
    return 0;
}

/* Rows of each goal's skills.reference.PhaseReference one after the other, and (rows, step_s, top_speed, slack_m, place_m,
 * extent_m, begins_m) of each goal */
static int take_tables(Laws *self, PyObject *path, PyObject *velocity, PyObject *force, PyObject *way, PyObject *gain,
                       PyObject *goals) {
    Law *l = &self->law;
    const Py_ssize_t rows = count_of(way), n = count_of(goals) / OF_GOAL;
    if (PyErr_Occurred()) return -1;
#define TAKE(object, count) take(&self->arrays, object, 0, count, 8, #object)
    const double *x = TAKE(path, rows * l->d), *v = TAKE(velocity, rows * l->d), *f = TAKE(force, rows * l->d), *w = TAKE(way, rows);
    const double *k = TAKE(gain, rows);
    const double *of_goal = TAKE(goals, n * OF_GOAL);
#undef TAKE
    if (PyErr_Occurred()) return -1;
    l->n_goals = (int)n;
    l->tables = self->tables = calloc(n > 0 ? n : 1, sizeof *self->tables);
    if (!self->tables) {
        PyErr_NoMemory();
        return -1;
    }
    Py_ssize_t at = 0;
    for (Py_ssize_t g = 0; g < n; g++, of_goal += OF_GOAL) {
        const int some = (int)of_goal[0];
        if (some < 2 || some > rows - at) break;
        self->tables[g] = (Table){some, of_goal[1], of_goal[1] * (double)(some - 1), of_goal[2], of_goal[3], of_goal[4], of_goal[5], of_goal[6],
                              
                               x + at * l->d, v + at * l->d, f + at * l->d, w + at, k + at, NULL, NULL, NULL};
        at += some;
    }
    if (n > 0 && at == rows) return 0;
    PyErr_SetString(PyExc_ValueError, "a law has a path of 2 rows or more to each goal");
    return -1;
}

/* (tables, ways, headings, grid, prior, memory) of skills.foresight.Foresight; the plans of each size lie together */
static int take_foresight(Laws *self, PyObject *foresight) {
    PyObject *tables, *ways, *headings, *grid, *prior, *memory;
    Law *l = &self->law;
    Foresight *f = &l->foresight;
    int d = l->d, alike;
    if (!PyArg_ParseTuple(foresight, "OOOOOOid", &tables, &ways, &headings, &grid, &prior, &memory, &alike, &f->keep)) return -1;
    const Py_ssize_t plans = count_of(prior), rows = count_of(ways);
    if (PyErr_Occurred()) return -1;
#define TAKE(object, writable, count) take(&self->arrays, object, writable, count, 8, #object)
    const double *plan = TAKE(tables, 0, rows * 3 * d), *way = TAKE(ways, 0, rows), *heading = TAKE(headings, 0, l->n_goals * d);
    f->sizes = TAKE(grid, 0, 3 * plans), f->prior = TAKE(prior, 0, plans);
    double *own = TAKE(memory, 1, 4 * d + TOLD + 2 * plans);
#undef TAKE
    if (PyErr_Occurred()) return -1;
    Py_ssize_t at = 0;
    for (int g = 0; g < l->n_goals; at += l->tables[g++].rows) {
        if (at + l->tables[g].rows > rows) break;
        self->tables[g].plan = plan + at * 3 * d, self->tables[g].plan_way = way + at, self->tables[g].heading = heading + g * d;
    }
    if (at != rows || plans < 1 || alike < 1) {
        PyErr_SetString(PyExc_ValueError, "the plans of all goals, one after the other");
        return -1;
    }
    f->paces = f->sizes + plans, f->late = f->paces + plans;
    f->alike = alike, f->plans = (int)plans;
    lay_foresight(f, d, own);
    return 0;
}

/* stations, firsts, memory and goals of skills.whereabouts.Whereabouts */
static int take_where(Laws *self, PyObject *stations, PyObject *firsts, PyObject *memory, PyObject *goals) {
    Law *l = &self->law;
    Where *w = &l->where;
    w->width = 3 * l->d + STATION;
    const Py_ssize_t n = count_of(stations) / w->width;
    if (PyErr_Occurred()) return -1;
#define TAKE(object, writable, count) take(&self->arrays, object, writable, count, 8, #object)
    w->rows = TAKE(stations, 0, n * w->width), w->first = TAKE(firsts, 0, l->n_goals + 1);
    double *kept_there = TAKE(memory, 1, n + l->d + 3);
    w->goals = TAKE(goals, 1, l->n_goals);
#undef TAKE
    if (PyErr_Occurred()) return -1;
    if (w->first[0] != 0.0 || w->first[l->n_goals] != (double)n) {
        PyErr_SetString(PyExc_ValueError, "the stations of all goals, one after the other");
        return -1;
    }
    w->stations = (int)n;
    lay_where(w, l->d, kept_there);
    w->moved = malloc(2 * n * sizeof *w->moved);
    if (!w->moved) {
        PyErr_NoMemory();
        return -1;
    }
    w->said = w->moved + n;
    return 0;
}

static PyObject *law_new(PyTypeObject *type, PyObject *args, PyObject *keywords) {
    PyObject *filter, *numbers, *following, *policy, *compliance, *pace_memory, *memory, *until, *seen, *bank;
    PyObject *path, *velocity, *force, *way, *gain, *goal_rows, *stations, *firsts, *where, *goals, *foresight, *role;
    double dt, model_dt, pull_s, bias_s;
    int d;
    (void)keywords;
    if (!PyArg_ParseTuple(args, "O!OOO(OOOOOO)OOOOO(OOOO)iddddOOO", filter_type, &filter, &numbers, &following, &policy, &path, &velocity,
                          &force, &way, &gain, &goal_rows, &compliance, &pace_memory, &memory, &until, &seen, &stations, &firsts, &where, &goals, &d, &dt, &model_dt, &pull_s, &bias_s,
                          &bank, &foresight, &role))
        return NULL;
    const int D = ((Filter *)filter)->tick.D;
    if (d < 1 || d > MOST_AXES || (D != d && D != 2 * d))
        return PyErr_Format(PyExc_ValueError, "a law has 1 to %d axes, and a filter of position or position and force", MOST_AXES);
    Laws *self = (Laws *)PyType_GenericAlloc(type, 0);
    if (!self) return NULL;
    Law *l = &self->law;
    *l = (Law){.d = d, .dt = dt, .model_dt = model_dt};
#define TAKE(object, writable, count) take(&self->arrays, object, writable, count, 8, #object)
    const double *given = TAKE(numbers, 0, sizeof(Numbers) / 8), *followed = TAKE(following, 0, sizeof(Numbers) / 8);
    const double *conduct = TAKE(policy, 0, sizeof(Policy) / 8);
    double *of_compliance = TAKE(compliance, 1, 4 * d + 4), *of_pace = TAKE(pace_memory, 1, 3 * d + CLOCKS);
    double *of_skill = TAKE(memory, 1, 8 * d + 7);
    l->until = TAKE(until, 1, 1);
    l->seen = TAKE(seen, 1, D);
    self->role = role == Py_None ? NULL : TAKE(role, 1, sizeof(Role) / 8);
#undef TAKE
    if (PyErr_Occurred() || take_tables(self, path, velocity, force, way, gain, goal_rows) < 0 || take_where(self, stations, firsts, where, goals) < 0 ||
        (foresight != Py_None && take_foresight(self, foresight) < 0) || (bank != Py_None && take_bank(self, bank, 3 * d, (Filter *)filter) < 0)) {
        Py_DecRef((PyObject *)self);
        return NULL;
    }
    memcpy(&l->law, given, sizeof(Numbers));
    memcpy(&l->following, followed, sizeof(Numbers));
    memcpy(&l->policy, conduct, sizeof(Policy));
    l->keep_shake = least(dt / 0.3, 1.0);
    l->pull_share = least(dt / pull_s, 1.0);
    l->bias_share = dt / bias_s;
    lay_law(l, of_compliance, of_pace, of_skill);
    l->heard = D;
    self->filter = Py_NewRef(filter);
    l->filter = &((Filter *)filter)->tick;
    l->level = ((Filter *)filter)->level;
    return (PyObject *)self;
}

static void law_dealloc(PyObject *object) {
    Laws *self = (Laws *)object;
    PyTypeObject *type = Py_TYPE(object);
    for (int i = 0; i < LAW_SLOTS; i++) PyBuffer_Release(&self->slots[i].view);
    release(&self->arrays);
    free(self->law.bank.filters);
    free(self->law.bank.seen);
    free(self->tables);
    free(self->law.where.moved);
    Py_XDECREF(self->filter);
    Py_XDECREF(self->bank);
    freefunc release_object = (freefunc)PyType_GetSlot(type, Py_tp_free);
    release_object(object);
    Py_DecRef((PyObject *)type);
}

/* (position, force, and the command's position, velocity, acceleration) of one tick; 0 when it is for the twin. */
static int law_takes(Laws *self, PyObject *const *args, Py_ssize_t n, const double **x, const double **force, double *out[3]) {
    const int d = self->law.d;
    if (n != 5) return 0;
    *x = kept(&self->slots[POSITION], args[0], d, 0);
    *force = kept(&self->slots[FORCE], args[1], d, 0);
    for (int i = 0; i < 3; i++)
        if (!(out[i] = kept(&self->slots[COMMAND + i], args[2 + i], d, 1))) return 0;
    return *x && *force && all_finite(*x, d) && all_finite(*force, d);
}

/* One tick of a skill that changes its role; 0, with nothing changed but what was heard, for the twin. */
static int by_role(Law *l, Role *role, const double *x, const double *force, double *const out[3]) {
    if (!role || !attend(l, x, force)) return 0;
    act_attended(l, role, x, force, 1, out);
    return 1;
}

#define LAW_METHOD(name, call)                                                          \
    static PyObject *law_##name(PyObject *object, PyObject *const *args, Py_ssize_t n) { \
        Law *l = &((Laws *)object)->law;                                                \
        const double *x, *force;                                                        \
        double *out[3];                                                                 \
        return PyBool_FromLong(law_takes((Laws *)object, args, n, &x, &force, out) && call); \
    }
LAW_METHOD(comply, follow(l, x, force, out, 0, 0))
LAW_METHOD(follow, follow(l, x, force, out, 1, 1))
LAW_METHOD(lead, lead(l, x, force, out))
LAW_METHOD(by_role, by_role(l, ((Laws *)object)->role, x, force, out))

/* (position, goal, last): from rest there to that goal, see enter_law; how far outside of what was taught that is [m] */
static PyObject *law_enter(PyObject *object, PyObject *args) {
    Law *l = &((Laws *)object)->law;
    PyObject *position;
    double last;
    int goal;
    if (!PyArg_ParseTuple(args, "Oid", &position, &goal, &last)) return NULL;
    if (goal < 0 || goal >= l->n_goals) return PyErr_Format(PyExc_ValueError, "goal %d of %d", goal, l->n_goals);
    Arrays arrays = {.n = 0};
    const double *x = take(&arrays, position, 0, l->d, 8, "position");
    PyObject *off = x ? PyFloat_FromDouble(enter_law(l, x, goal, last, l->where.said)) : NULL;
    release(&arrays);
    return off;
}

enum { FELT = 0, N_FELT = 5, WISH = N_FELT, SENT = WISH + 3, ENVELOPE_SLOTS = SENT + 3 }; /* FELT: as in `envelope_senses` */
enum { NOT_MINE = -1, RESTS, THINKS, RESUMES };                                            /* what it says of the skill */

typedef struct {
    PyObject_HEAD
    Envelope envelope;
    Guard *guard;
    double *mode, *confidence; /* as shown */
    Arrays arrays;
    Array slots[ENVELOPE_SLOTS];
} Envelopes;

static PyObject *envelope_new(PyTypeObject *type, PyObject *args, PyObject *keywords) {
    PyObject *limits, *rules, *walls, *memory, *tank, *mode, *confidence;
    int d, most_pulls, most_before, swing;
    (void)keywords;
    if (!PyArg_ParseTuple(args, "OOOOOOOiiii", &limits, &rules, &walls, &memory, &tank, &mode, &confidence, &d, &most_pulls, &most_before, &swing)) return NULL;
    if (d < 1 || d > MOST_AXES || most_pulls < 1 || most_before < 1 || swing < 1) return PyErr_Format(PyExc_ValueError, "1 to %d axes", MOST_AXES);
    Envelopes *self = (Envelopes *)PyType_GenericAlloc(type, 0);
    if (!self) return NULL;
    Envelope *e = &self->envelope;
    *e = (Envelope){.d = d, .most_pulls = most_pulls, .most_before = most_before, .swing = swing};
#define TAKE(object, writable, count) take(&self->arrays, object, writable, count, 8, #object)
    const double *numbers = TAKE(limits, 0, sizeof(Limits) / 8), *checked = TAKE(rules, 0, 3 + 2 * d), *bounds = TAKE(walls, 0, 2 * d);
    Guard *guard = self->guard = TAKE(memory, 1, sizeof(Guard) / 8 + (most_pulls + most_before) * d);
    e->tank = TAKE(tank, 1, 1), self->mode = TAKE(mode, 1, 1), self->confidence = TAKE(confidence, 1, 1);
#undef TAKE
    if (PyErr_Occurred()) {
        Py_DecRef((PyObject *)self);
        return NULL;
    }
    memcpy(&e->limits, numbers, sizeof(Limits));
    e->rules.v_max = checked[0], e->rules.a_max = checked[1], e->rules.dt = checked[2];
    for (int i = 0; i < d; i++) {
        e->low[i] = bounds[2 * i], e->high[i] = bounds[2 * i + 1];
        e->rules.low[i] = checked[3 + 2 * i], e->rules.high[i] = checked[4 + 2 * i];
    }
    e->now = &guard->ledger;
    e->pulls = (double *)(guard + 1);
    e->before = e->pulls + most_pulls * d;
    return (PyObject *)self;
}

static void envelope_dealloc(PyObject *object) {
    Envelopes *self = (Envelopes *)object;
    PyTypeObject *type = Py_TYPE(object);
    for (int i = 0; i < ENVELOPE_SLOTS; i++) PyBuffer_Release(&self->slots[i].view);
    release(&self->arrays);
    freefunc release_object = (freefunc)PyType_GetSlot(type, Py_tp_free);
    release_object(object);
    Py_DecRef((PyObject *)type);
}

/* (time, force_time, position, force, velocity, sensor_force, taught): what the skill is to do, or NOT_MINE with nothing changed */
static PyObject *envelope_senses(PyObject *object, PyObject *const *args, Py_ssize_t n) {
    Envelopes *self = (Envelopes *)object;
    const double *felt[N_FELT];
    double period;
    if (n != 2 + N_FELT || !PyFloat_Check(args[0]) || !PyFloat_Check(args[1])) return PyLong_FromLong(NOT_MINE);
    for (int i = 0; i < N_FELT; i++)
        if (!(felt[i] = kept(&self->slots[FELT + i], args[2 + i], self->envelope.d, 0))) return PyLong_FromLong(NOT_MINE);
    const Seen seen = {PyFloat_AsDouble(args[0]), PyFloat_AsDouble(args[1]), felt[0], felt[2], felt[3], felt[1], felt[4]};
    Guard *g = self->guard;
    const int resumes = guard_senses(&self->envelope, g, &seen, &period) == SKILL_RESUMES;
    g->ledger.period = period;
    return PyLong_FromLong(resumes ? RESUMES : thinks(&self->envelope, g, period) ? THINKS : RESTS);
}

/* The skill has begun again from where the arm is. */
static PyObject *envelope_recovered(PyObject *object, PyObject *none) {
    Envelopes *self = (Envelopes *)object;
    (void)none;
    recovered(&self->envelope, self->guard);
    return PyLong_FromLong(thinks(&self->envelope, self->guard, self->guard->ledger.period) ? THINKS : RESTS);
}

static void envelope_sends(Envelopes *self, double *const out[3]) {
    guard_sends(&self->envelope, self->guard, self->guard->ledger.period, out);
    *self->mode = self->guard->mode, *self->confidence = self->guard->confidence;
}

/* Position, velocity and acceleration of the skill's command and of that to be sent; False, with nothing changed, where it is unfit. */
static PyObject *envelope_acts(PyObject *object, PyObject *const *args, Py_ssize_t n) {
    Envelopes *self = (Envelopes *)object;
    double *arrays[6];
    const int d = self->envelope.d;
    if (n != 6) Py_RETURN_FALSE;
    for (int i = 0; i < 6; i++)
        if (!(arrays[i] = kept(&self->slots[WISH + i], args[i], d, i >= 3)) || (i < 3 && !all_finite(arrays[i], d))) Py_RETURN_FALSE;
    for (int i = 0; i < 3; i++) copy(self->guard->wish[i], arrays[i], d);
    heed(&self->envelope, self->guard);
    envelope_sends(self, arrays + 3);
    Py_RETURN_TRUE;
}

/* The same where the skill is not asked. */
static PyObject *envelope_rests(PyObject *object, PyObject *const *args, Py_ssize_t n) {
    Envelopes *self = (Envelopes *)object;
    double *out[3];
    if (n != 3) Py_RETURN_FALSE;
    for (int i = 0; i < 3; i++)
        if (!(out[i] = kept(&self->slots[SENT + i], args[i], self->envelope.d, 1))) Py_RETURN_FALSE;
    envelope_sends(self, out);
    Py_RETURN_TRUE;
}

#if !defined(__clang__)
#pragma GCC push_options
#pragma GCC optimize("fp-contract=off")
#endif
#include "_carry.h"
#if !defined(__clang__)
#pragma GCC pop_options
#endif

/* --------------------------------------------------------------------------------------------------------- module */

#define REASON_NAME(name, text) #name " "
static const Layout LAYOUTS[] = {
    {"wrist", WRIST(ITS_NAME)}, {"person", HUMAN(ITS_NAME)}, {"along", ALONG(ITS_NAME)}, {"end", END(ITS_NAME)}, {"law", LAW(ITS_NAME)},
    {"policy", POLICY(ITS_NAME)}, {"limits", LIMITS(ITS_NAME)}, {"scalars", SCALARS(ITS_NAME)}, {"vectors", VECTORS(ITS_NAME) CHECKED(ITS_NAME)},
    {"carry", CARRY(ITS_NAME)}, {"felt", FELT(ITS_NAME)}, {"guard", GUARD(ITS_NAME)}, {"guarded", GUARDED(ITS_NAME)},
    {"reasons", REASONS(REASON_NAME)}, {"role", ROLE(ITS_NAME)},
};

static PyObject *layouts(PyObject *self, PyObject *none) {
    (void)self, (void)none;
    PyObject *found = PyDict_New();
    for (size_t i = 0; found && i < sizeof LAYOUTS / sizeof *LAYOUTS; i++) {
        PyObject *names = PyUnicode_FromString(LAYOUTS[i].names);
        if (!names || PyDict_SetItemString(found, LAYOUTS[i].block, names) < 0) Py_CLEAR(found);
        Py_XDECREF(names);
    }
    return found;
}

static PyObject *levels(PyObject *self, PyObject *none) {
    (void)self, (void)none;
    PyObject *names = PyList_New(0);
    for (int i = 0; names && i < N_LEVELS; i++) {
        PyObject *name = runs_here(LEVELS[i]) ? PyUnicode_FromString(LEVELS[i]->name) : NULL;
        if (name && PyList_Append(names, name) < 0) PyErr_Clear();
        Py_XDECREF(name);
    }
    return names;
}

static PyObject *level(PyObject *self, PyObject *none) {
    (void)self, (void)none;
    return PyUnicode_FromString(active->name);
}

static PyObject *lanes(PyObject *self, PyObject *none) {
    (void)self, (void)none;
    return PyLong_FromLong(active->lanes);
}

static PyObject *use(PyObject *self, PyObject *args) {
    const char *name;
    (void)self;
    if (!PyArg_ParseTuple(args, "s", &name)) return NULL;
    for (int i = 0; i < N_LEVELS; i++)
        if (strcmp(LEVELS[i]->name, name) == 0 && runs_here(LEVELS[i])) {
            active = LEVELS[i];
            Py_RETURN_NONE;
        }
    return PyErr_Format(PyExc_ValueError, "this processor does not run %s", name);
}

static PyMethodDef functions[] = {
    {"e_step", e_step, METH_VARARGS, "Expectations of a hidden Markov model over planned groups; True when a sequence needs the twin."},
    {"segments", segments, METH_VARARGS, "Expectations of a hidden semi-Markov model; sequences marked as failed need the twin."},
    {"mixture", mixture, METH_VARARGS, "Moments of a mixture and the log-likelihood of all frames."},
    {"decode", decode, METH_VARARGS, "Viterbi paths of sequences, and their log-probabilities."},
    {"rollouts", rollouts, METH_VARARGS, "Many roll-outs of a learned velocity law; False when one is not finite."},
    {"carry", carry_each, METH_VARARGS, "One tick of each of many runs of the gym; says which are for the Python."},
    {"layouts", layouts, METH_NOARGS, "Shared blocks of numbers: block -> names in the order of memory."},
    {"levels", levels, METH_NOARGS, "Instruction sets that run here, fastest first."},
    {"level", level, METH_NOARGS, "The instruction set in use."},
    {"lanes", lanes, METH_NOARGS, "float64 numbers in one vector of it."},
    {"use", use, METH_VARARGS, "Choose an instruction set; objects made before keep theirs."},
    {NULL, NULL, 0, NULL},
};

static PyMethodDef filter_methods[] = {
    {"step", filter_step, METH_O, "One tick; False, with nothing changed, when the twin has to take it."},
    {NULL, NULL, 0, NULL},
};
static PyType_Slot filter_slots[] = {
    {Py_tp_new, filter_new}, {Py_tp_dealloc, filter_dealloc}, {Py_tp_methods, filter_methods}, {0, NULL},
};
static PyType_Spec filter_spec = {"comanip.kernels._native.Filter", sizeof(Filter), 0, Py_TPFLAGS_DEFAULT, filter_slots};

static PyMethodDef lines_methods[] = {
    {"mean", (PyCFunction)(void (*)(void))lines_mean, METH_FASTCALL, "Weighted regression lines; False when the arrays are for the twin."},
    {NULL, NULL, 0, NULL},
};
static PyType_Slot lines_slots[] = {
    {Py_tp_new, lines_new}, {Py_tp_dealloc, lines_dealloc}, {Py_tp_methods, lines_methods}, {0, NULL},
};
static PyType_Spec lines_spec = {"comanip.kernels._native.Lines", sizeof(Lines), 0, Py_TPFLAGS_DEFAULT, lines_slots};

#define LAW_ENTRY(name, says) {#name, (PyCFunction)(void (*)(void))law_##name, METH_FASTCALL, says " False, with nothing changed, when the twin has to."}
static PyMethodDef law_methods[] = {
    LAW_ENTRY(comply, "One tick of compliance alone."),
    LAW_ENTRY(follow, "One tick of a follower."),
    LAW_ENTRY(lead, "One tick of a leader."),
    LAW_ENTRY(by_role, "One tick of a skill that follows, offers to lead or leads."),
    {"enter", law_enter, METH_VARARGS, "From rest, to a goal; how far outside of what was taught that is."},
    {NULL, NULL, 0, NULL},
};
static PyType_Slot law_slots[] = {{Py_tp_new, law_new}, {Py_tp_dealloc, law_dealloc}, {Py_tp_methods, law_methods}, {0, NULL}};
static PyType_Spec law_spec = {"comanip.kernels._native.Law", sizeof(Laws), 0, Py_TPFLAGS_DEFAULT, law_slots};

static PyMethodDef envelope_methods[] = {
    {"senses", (PyCFunction)(void (*)(void))envelope_senses, METH_FASTCALL, "Before the skill: whether it rests, thinks or begins again."},
    {"recovered", envelope_recovered, METH_NOARGS, "After it has begun again: whether it rests or thinks."},
    {"acts", (PyCFunction)(void (*)(void))envelope_acts, METH_FASTCALL, "After it thought; False, with nothing changed, when unfit."},
    {"rests", (PyCFunction)(void (*)(void))envelope_rests, METH_FASTCALL, "Where it did not."},
    {NULL, NULL, 0, NULL},
};
static PyType_Slot envelope_slots[] = {
    {Py_tp_new, envelope_new}, {Py_tp_dealloc, envelope_dealloc}, {Py_tp_methods, envelope_methods}, {0, NULL},
};
static PyType_Spec envelope_spec = {"comanip.kernels._native.Envelope", sizeof(Envelopes), 0, Py_TPFLAGS_DEFAULT, envelope_slots};

static int start(PyObject *module) {
    for (int i = N_LEVELS - 1; i >= 0; i--)
        if (runs_here(LEVELS[i])) active = LEVELS[i];
    PyType_Spec *const specs[] = {&filter_spec, &lines_spec, &law_spec, &envelope_spec, &waiting_spec, &beam_spec, &rows_spec, &carry_spec};
    for (size_t i = 0; i < sizeof specs / sizeof *specs; i++) {
        PyObject *type = PyType_FromSpec(specs[i]);
        if (!type || PyModule_AddType(module, (PyTypeObject *)type) < 0) {
            Py_XDECREF(type);
            return -1;
        }
        PyTypeObject **known = specs[i] == &filter_spec ? &filter_type : specs[i] == &beam_spec ? &beam_type
            : specs[i] == &envelope_spec ? &envelope_type : specs[i] == &carry_spec ? &carry_type : NULL;
        if (known) *known = (PyTypeObject *)type; /* and its reference */
        else Py_DecRef(type);
    }
    return 0;
}

static PyModuleDef_Slot module_slots[] = {{Py_mod_exec, start}, {0, NULL}};
static PyModuleDef definition = {
    .m_base = PyModuleDef_HEAD_INIT, .m_name = "_native", .m_doc = "Compiled twins of comanip.models.", .m_methods = functions,
    .m_slots = module_slots,
};

PyMODINIT_FUNC PyInit__native(void) { return PyModuleDef_Init(&definition); }
