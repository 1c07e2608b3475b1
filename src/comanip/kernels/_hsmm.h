/* Explicit durations: the E-step of an Hsmm and a tick of its filter, as Python calls them. The recursions are in _segments.h. */

typedef struct {             /* DurationFilter; every array belongs to Python but the scratch at the end */
    int D, K, L, patience;
    double gate, forgets;
    const double *origin, *factors, *centres, *peak, *initial, *transition, *durations;
    double *weights, *left, *time, *state;
    double *log_b, *entered, *predicted, *h, *moved;
} Waiting;

#define LEAST_SCALE 1e-280 /* as in _lanes.h */
#if defined(__x86_64__)
#define W 8
#define NAME(x) x##_avx512
#define TARGET AVX512
#include "_segments.h"
#define W 4
#define NAME(x) x##_avx2
#define TARGET AVX2
#include "_segments.h"
#endif
#define W 2
#define NAME(x) x##_plain
#define TARGET
#include "_segments.h"

#if defined(__x86_64__)
#define AT_LEVEL(level, name) ((level) == &level_avx512 ? name##_avx512 : (level) == &level_avx2 ? name##_avx2 : name##_plain)
#else
#define AT_LEVEL(level, name) ((void)(level), name##_plain)
#endif

static void segments_of(const Level *level, const Job *job, int64_t sequence, double *space, double *slot) {
    AT_LEVEL(level, segments)(job, sequence, space, slot);
}

static PyObject *segments(PyObject *self, PyObject *args) {
    PyObject *frames, *starts, *initial, *transition, *durations, *origin, *factors, *centres, *peak, *moments, *transitions, *first,
        *counts, *log_likelihood, *failed, *weights;
    int n_threads;
    (void)self;
    if (!PyArg_ParseTuple(args, "OOOOOOOOOOOOOOOOi", &frames, &starts, &initial, &transition, &durations, &origin, &factors, &centres,
                          &peak, &moments, &transitions, &first, &counts, &log_likelihood, &failed, &weights, &n_threads))
        return NULL;
    const Py_ssize_t D = count_of(origin), K = count_of(peak), S = count_of(starts) - 1, N = D > 0 ? count_of(frames) / D : 0;
    const Py_ssize_t L = K > 0 ? count_of(durations) / K : 0;
    if (PyErr_Occurred()) return NULL;
    if (D < 1 || K < 1 || S < 1 || L < 1 || L % 8) return PyErr_Format(PyExc_ValueError, "nothing to do, or durations not in eights");
    Arrays arrays = {.n = 0};
    PyObject *result = NULL;
    Model model;
    Job job = {.model = &model, .n_frames = N, .longest = (int)L};
    job.frames = NUMBERS(frames, N * D);
    job.starts = NUMBERS(starts, S + 1);
    job.durations = NUMBERS(durations, K * L);
    const double *pi = NUMBERS(initial, K), *a = NUMBERS(transition, K * K), *o = NUMBERS(origin, D), *f = NUMBERS(factors, K * D * D);
    const double *c = NUMBERS(centres, K * D), *p = NUMBERS(peak, K);
    job.log_likelihood = RESULT(log_likelihood, S);
    job.failed = take(&arrays, failed, 1, S, 1, "failed");
    double *m_out = RESULT(moments, K * (D + 1) * (D + 1)), *t_out = RESULT(transitions, K * K), *f_out = RESULT(first, K);
    double *d_out = RESULT(counts, K * L);
    if (weights != Py_None) job.weights = RESULT(weights, N * K);
    double *block = NULL;
    if (PyErr_Occurred()) goto done;
    int64_t longest = 0;
    for (Py_ssize_t s = 0; s < S; s++) {
        const int64_t n = job.starts[s + 1] - job.starts[s];
        if (n < 1 || job.starts[0] < 0 || job.starts[s + 1] > N) {
            PyErr_SetString(PyExc_ValueError, "the starts do not fit the frames");
            goto done;
        }
        longest = n > longest ? n : longest;
    }
    if (!(block = lay_out(active, &model, (int)D, (int)K, o, f, c, p, pi, a))) {
        PyErr_NoMemory();
        goto done;
    }
    Work w = {.job = &job, .level = active, .n_groups = (int)S};
    const size_t Kp = (size_t)model.nv * active->lanes, eight = TILES * active->lanes, padded = (longest + eight - 1) / eight * eight;
    w.slot_size = ((size_t)K * model.n_pairs + K * K + K + K * L + 7) / 8 * 8;
    w.n_slots = slots_for(w.n_groups, w.slot_size);
    w.space_size = common_space(&model, active) + padded * (3 * Kp + 1) + K * (2 * L + 2 * active->lanes + Kp)
                   + eight * Kp + 3 * Kp + K + 16;
    if (run(&w, n_threads) < 0) {
        PyErr_NoMemory();
        goto done;
    }
    unpack_moments(&model, w.slots, m_out);
    const double *steps = w.slots + (size_t)K * model.n_pairs, *segment = steps + K * K + K;
    for (Py_ssize_t i = 0; i < K * K; i++) t_out[i] = a[i] * steps[i];
    for (Py_ssize_t i = 0; i < K * L; i++) d_out[i] = job.durations[i] * segment[i];
    memcpy(f_out, steps + K * K, sizeof(double) * K);
    give_space(w.space);
    result = Py_NewRef(Py_None);
done:
    free(block);
    release(&arrays);
    return result;
}

typedef struct {
    PyObject_HEAD
    Waiting tick;
    const Level *level;
    double *block;
    Arrays arrays;
} Waitings;

static PyObject *waiting_new(PyTypeObject *type, PyObject *args, PyObject *keywords) {
    PyObject *origin, *factors, *centres, *peak, *initial, *transition, *durations, *weights, *left, *time, *state;
    double gate, forgets;
    int patience;
    (void)keywords;
    if (!PyArg_ParseTuple(args, "OOOOOOOOOOOddi", &origin, &factors, &centres, &peak, &initial, &transition, &durations, &weights,
                          &left, &time, &state, &gate, &forgets, &patience))
        return NULL;
    const Py_ssize_t D = count_of(origin), K = count_of(peak), L = K > 0 ? count_of(durations) / K : 0;
    if (PyErr_Occurred()) return NULL;
    if (D < 1 || D > MOST_CHANNELS || K < 1 || L < 1 || L % 8)
        return PyErr_Format(PyExc_ValueError, "from 1 to %d channels, and durations in eights", MOST_CHANNELS);
    Waitings *self = (Waitings *)PyType_GenericAlloc(type, 0);
    if (!self) return NULL;
    Waiting *t = &self->tick;
    *t = (Waiting){.D = (int)D, .K = (int)K, .L = (int)L, .patience = patience, .gate = gate, .forgets = forgets};
#define TAKE(object, writable, count) take(&self->arrays, object, writable, count, 8, #object)
    t->origin = TAKE(origin, 0, D), t->factors = TAKE(factors, 0, K * D * D), t->centres = TAKE(centres, 0, K * D);
    t->peak = TAKE(peak, 0, K), t->initial = TAKE(initial, 0, K), t->transition = TAKE(transition, 0, K * K);
    t->durations = TAKE(durations, 0, K * L);
    t->weights = TAKE(weights, 1, K), t->left = TAKE(left, 1, K * L), t->time = TAKE(time, 1, 2), t->state = TAKE(state, 1, STATE_SIZE);
#undef TAKE
    double *from = PyErr_Occurred() ? NULL : (self->block = aligned(4 * (K + 16) + K * L + 16));
    self->level = active;
    if (!from) {
        if (!PyErr_Occurred()) PyErr_NoMemory();
        Py_DecRef((PyObject *)self);
        return NULL;
    }
    double **const scratch[] = {&t->log_b, &t->entered, &t->predicted, &t->h};
    for (int i = 0; i < 4; i++) *scratch[i] = carve(&from, K);
    t->moved = carve(&from, K * L);
    return (PyObject *)self;
}

static void waiting_dealloc(PyObject *object) {
    Waitings *self = (Waitings *)object;
    PyTypeObject *type = Py_TYPE(object);
    release(&self->arrays);
    free(self->block);
    freefunc release_object = (freefunc)PyType_GetSlot(type, Py_tp_free);
    release_object(object);
    Py_DecRef((PyObject *)type);
}

/* (xi, rate) */
static PyObject *waiting_step(PyObject *object, PyObject *const *args, Py_ssize_t n) {
    Waitings *self = (Waitings *)object;
    Array xi;
    if (n != 2 || !PyFloat_Check(args[1]) || !vector(&xi, args[0], self->tick.D, 0)) Py_RETURN_FALSE;
    const int done = AT_LEVEL(self->level, duration_tick)(&self->tick, xi.view.buf, PyFloat_AsDouble(args[1]));
    PyBuffer_Release(&xi.view);
    return PyBool_FromLong(done);
}

static PyMethodDef waiting_methods[] = {
    {"step", (PyCFunction)(void (*)(void))waiting_step, METH_FASTCALL, "One tick; False, with nothing changed, when the twin has to take it."},
    {NULL, NULL, 0, NULL},
};
static PyType_Slot waiting_slots[] = {
    {Py_tp_new, waiting_new}, {Py_tp_dealloc, waiting_dealloc}, {Py_tp_methods, waiting_methods}, {0, NULL},
};
static PyType_Spec waiting_spec = {"comanip.kernels._native.DurationFilter", sizeof(Waitings), 0, Py_TPFLAGS_DEFAULT, waiting_slots};
