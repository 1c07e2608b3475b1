/* One tick of a run of the gym (gym/episode.py) where all of it is compiled: envelope, beam and person, sensor, force estimate, what the
 * policy sees, and the parts of the reward. The same operations in the same order as there, so that the numbers are the same to the last
 * bit. The envelope's memory and the beam's are those of their own objects; what is here alone is written back by gym/compiled.py before
 * the Python takes a tick, which it does wherever an envelope's tick is not ordinary.
 */

#define CARRY(X) \
    X(dt, dt_s) X(noise, noise_n) X(bias, bias_n) X(half_mass, half_mass_kg) X(sums, sums) X(fastest, fastest_m_per_s) \
    X(good_s, good_s) X(average, average) X(late, late_ticks) X(blend, blend) X(size, size_m) X(effort, effort_n) \
    X(rough, rough_m_per_s2) X(ends_early, ends_early) X(waits, waits) X(onset, onset_s) X(starts_by, starts_by_s) \
    X(tilt, tilt_rad) X(moved_m, moved_m)
typedef struct { CARRY(ONE_NUMBER) } CarryNumbers; /* gym.compiled */

#define FELT(X) \
    X(gravity, gravity) X(load, load_kg) X(offset, offset_n) X(b0, b0) X(b1, b1) X(b2, b2) X(a1, a1) X(a2, a2) X(s1, s1) X(s2, s2) \
    X(started, started) X(velocity, velocity) X(force, force) X(elapsed, elapsed) X(sample, sample) X(age, age)
typedef struct { FELT(ONE_NUMBER) } FeltAxis; /* CausalInteractionForce, of one axis */

#define MOST_FORCE 1e6 /* interaction.MAX_FORCE */

/* CausalInteractionForce.step, of one axis; `past` are accelerations, the newest first. */
static double felt(const CarryNumbers *k, FeltAxis *a, double *past, double reading, double velocity) {
    a->age = reading != reading ? a->age + k->dt : 0.0;
    if (reading == reading) a->sample = reading;
    double force = a->age <= k->good_s ? a->sample : reading;
    a->elapsed += k->dt;
    if (!(-MOST_FORCE < force && force < MOST_FORCE && isfinite(velocity))) return NAN;
    const double before = a->velocity, last = a->force;
    double acceleration = before != before ? 0.0 : (velocity - before) / a->elapsed;
    a->velocity = velocity, a->force = force, a->elapsed = 0.0;
    const int late = (int)k->late;
    memmove(past + 1, past, sizeof(double) * (late + 1));
    past[0] = acceleration;
    acceleration = past[late] + k->blend * (past[late + 1] - past[late]);
    if (k->average != 0.0 && last == last) force = 0.5 * (force + last);
    const double value = force + a->load * acceleration + a->offset;
    if (a->started == 0.0) { /* Lowpass.step */
        a->started = 1.0;
        a->s1 = value * (1.0 - a->b0);
        a->s2 = value * (a->b2 - a->a2);
    }
    const double out = a->b0 * value + a->s1;
    a->s1 = a->b1 * value - a->a1 * out + a->s2;
    a->s2 = a->b2 * value - a->a2 * out;
    return out;
}

enum { TICKS, MOST_TICKS, DRAWN, HAS_MOVED, COUNTS }; /* of `counts` */
enum { TICKED, FOR_PYTHON, FROM_ACT, NO_NOISE };      /* what a tick says */
enum { OPEN, DIVERGED, MOVED_FIRST, LATE, NOT_LEVEL, TIME_IS_OVER };
enum { POSITION_, VELOCITY_, SENSOR, FORCE_, OBSERVED };

typedef struct {
    PyObject_HEAD
    PyObject *beams, *envelopes; /* whose are below */
    Arrays arrays;
    Beam *beam;
    Envelope *envelope;
    Guard *guard;
    int d, n_seen, n_meant, n_noise, width;
    const CarryNumbers *k;
    int64_t *counts;
    double *time, *observed[OBSERVED], *command, *wish, *said, *told, *shown, *commanded, *truth, *signs, *felt, *rows, *sent, *seen, *last;
    const double *meant, *start, *noise, *taught; /* taught: of the envelope's skill */
    double *parts;
} Carry;

static double hypotenuse(const double *a, int d) { return d == 1 ? fabs(a[0]) : d == 2 ? hypot(a[0], a[1]) : length(a, d); }

/* Recorder.add of loop.run's row. */
static void keep_row(Carry *c) {
    const int d = c->d;
    double *row = c->rows + c->counts[TICKS] * c->width, *to = row;
    *to++ = c->time[0];
    for (int n = 0; n < OBSERVED; n++, to += d) memcpy(to, c->observed[n], sizeof(double) * d);
    memcpy(to, c->command, sizeof(double) * 3 * d), to += 3 * d;
    memcpy(to, c->shown + 9 * d, sizeof(double) * d), to += d; /* pull */
    memcpy(to, c->shown + 7 * d, sizeof(double) * d), to += d; /* far_position */
    memcpy(to, c->truth, sizeof(double) * 3 * d), to += 3 * d; /* tilt, acceleration, true force */
    memcpy(to, c->signs, sizeof(double) * 3), to += 3;         /* mode, tank, confidence */
    *to = 0.0;
}

/* BeamPlant.advance and read, and the estimator. */
static void go_on(Carry *c) {
    const CarryNumbers *k = c->k;
    const int d = c->d;
    Beam *b = c->beam;
    if (b->left < b->substeps && !b->spare) { /* Beams.feed */
        memcpy(b->next_block, c->noise + c->counts[DRAWN], sizeof(double) * d * NOISE_BLOCK);
        b->spare = 1;
        c->counts[DRAWN] += (int64_t)d * NOISE_BLOCK;
    }
    period(b, c->time[0], c->commanded, c->shown);
    c->time[0] += k->dt;
    const double *drawn = c->noise + c->counts[DRAWN];
    c->counts[DRAWN] += d;
    const int past = (int)k->late + 2, wide = (int)(sizeof(FeltAxis) / 8) + past;
    for (int i = 0; i < d; i++) {
        const End *e = &b->ends[i];
        c->observed[POSITION_][i] = e->position;
        c->observed[VELOCITY_][i] = e->velocity;
        c->observed[SENSOR][i] = e->sampled + k->bias + k->noise * drawn[i];
        c->truth[i] = e->tilt;
        c->truth[d + i] = e->acceleration;
        c->truth[2 * d + i] = e->sensor_force + k->half_mass * (b->along[i].gravity + e->acceleration);
    }
    for (int i = 0; i < d; i++) {
        FeltAxis *a = (FeltAxis *)(c->felt + i * wide);
        c->observed[FORCE_][i] = felt(k, a, (double *)(a + 1), c->observed[SENSOR][i], c->observed[VELOCITY_][i]);
    }
}

/* Sight.look */
static void sees_now(Carry *c) {
    const int d = c->d, wide = 3 * d;
    memmove(c->seen, c->seen + wide, sizeof(double) * (c->n_seen - wide));
    double *now = c->seen + c->n_seen - wide;
    memcpy(now, c->observed[POSITION_], sizeof(double) * d);
    memcpy(now + d, c->observed[VELOCITY_], sizeof(double) * d);
    memcpy(now + 2 * d, c->observed[FORCE_], sizeof(double) * d);
    for (int i = 0; i < wide; i++)
        if (!isfinite(now[i])) now[i] = c->last[i];
    memcpy(c->last, now, sizeof(double) * wide);
}

/* Episode.lost */
static int lost(Carry *c) {
    const CarryNumbers *k = c->k;
    Axes off;
    for (int i = 0; i < c->d; i++) {
        off[i] = c->observed[POSITION_][i] - c->start[i];
        if (!isfinite(c->shown[7 * c->d + i])) return DIVERGED;
    }
    const double gone = hypotenuse(off, c->d);
    if (!(gone < INFINITY)) return DIVERGED;
    if (gone > k->moved_m) {
        if (k->waits != 0.0 && !c->counts[HAS_MOVED] && c->time[0] < k->onset) return MOVED_FIRST;
        c->counts[HAS_MOVED] = 1;
    } else if (!c->counts[HAS_MOVED] && c->counts[TICKS] * k->dt > k->starts_by)
        return LATE;
    return hypotenuse(c->truth, c->d) > k->tilt ? NOT_LEVEL : OPEN;
}

/* Episode.worth, but for the end */
static void worth(Carry *c) {
    const CarryNumbers *k = c->k;
    const int d = c->d;
    const int64_t n = c->counts[TICKS] < c->n_meant ? c->counts[TICKS] : c->n_meant;
    const double *meant = c->meant + (n - 1) * d;
    Axes off, change;
    for (int i = 0; i < d; i++) {
        off[i] = c->observed[POSITION_][i] - meant[i];
        change[i] = c->command[d + i] - c->sent[i];
        c->sent[i] = c->command[d + i];
    }
    const double apart_ = hypotenuse(off, d) / k->size, force = hypotenuse(c->truth + 2 * d, d) / k->effort;
    const double rough = hypotenuse(change, d) / k->dt / k->rough, f2 = force * force, r2 = rough * rough;
    c->parts[0] = -k->dt * (apart_ < 1.0 ? apart_ : 1.0);
    c->parts[1] = -k->dt * (f2 < 1.0 ? f2 : 1.0);
    c->parts[2] = -k->dt * (r2 < 1.0 ? r2 : 1.0);
    c->parts[3] = 0.0;
}

/* Told.step into `wish` */
static void told(Carry *c, const double *said) {
    const CarryNumbers *k = c->k;
    const int d = c->d;
    for (int i = 0; i < d; i++) {
        double v = said[i];
        if (k->sums != 0.0) v = within(c->told[i] + k->dt * v, -k->fastest, k->fastest);
        c->said[i] = said[i];
        c->told[i] = v;
        c->wish[d + i] = v;
        c->wish[i] = c->observed[POSITION_][i] + k->dt * v;
        c->wish[2 * d + i] = 0.0;
    }
}

/* Episode.tick; `open`: why it is over, or OPEN */
static int carry_tick(Carry *c, const double *said, int *open) {
    const int d = c->d;
    const Beam *b = c->beam;
    const int64_t wants = d + (b->left < b->substeps && !b->spare ? (int64_t)d * NOISE_BLOCK : 0);
    if (c->counts[DRAWN] + wants > c->n_noise) return NO_NOISE;
    double *const *o = c->observed;
    for (int i = 0; i < d; i++) c->said[i] = said[i];
    if (!nothing_is_up(c->guard)) return FOR_PYTHON;
    if (!sense(c->envelope, c->time[0], o[POSITION_], o[FORCE_], o[VELOCITY_], o[SENSOR], c->taught)) return FOR_PYTHON;
    c->guard->late = 0.0, c->guard->fresh = 1.0;
    told(c, said);
    const double *const wish[3] = {c->wish, c->wish + d, c->wish + 2 * d};
    double *const command[3] = {c->command, c->command + d, c->command + 2 * d};
    if (!act(c->envelope, wish, command)) return FROM_ACT;
    memcpy(c->commanded, command[1], sizeof(double) * d);
    c->signs[1] = c->envelope->tank[0];
    keep_row(c);
    c->counts[TICKS]++;
    *open = OPEN;
    if (c->counts[TICKS] < c->counts[MOST_TICKS]) {
        go_on(c);
        sees_now(c);
        if (c->k->ends_early != 0.0) *open = lost(c);
    }
    worth(c);
    if (*open == OPEN && c->counts[TICKS] >= c->counts[MOST_TICKS]) *open = TIME_IS_OVER;
    return TICKED;
}

/* -------------------------------------------------------------------------------------------------- Python object */

static PyTypeObject *beam_type, *envelope_type, *carry_type;

/* (beam, envelope, arrays): the arrays in the order of gym.compiled.ARRAYS */
static PyObject *carry_new(PyTypeObject *type, PyObject *args, PyObject *keywords) {
    PyObject *beams, *envelopes, *all;
    (void)keywords;
    if (!PyArg_ParseTuple(args, "O!O!O", beam_type, &beams, envelope_type, &envelopes, &all)) return NULL;
    Carry *c = (Carry *)PyType_GenericAlloc(type, 0);
    if (!c) return NULL;
    Py_IncRef(beams), Py_IncRef(envelopes);
    c->beams = beams, c->envelopes = envelopes;
    c->beam = &((Beams *)beams)->beam, c->envelope = &((Envelopes *)envelopes)->envelope, c->guard = ((Envelopes *)envelopes)->guard;
    const int d = c->d = c->beam->d;
    const Py_ssize_t all_n = PySequence_Size(all);
    Py_ssize_t sizes[MOST_ARRAYS];
    void *at[MOST_ARRAYS] = {0};
    for (Py_ssize_t n = 0; n < all_n && n < MOST_ARRAYS && !PyErr_Occurred(); n++) {
        PyObject *one = PySequence_GetItem(all, n);
        at[n] = one ? take(&c->arrays, one, 1, -1, 8, "array") : NULL;
        sizes[n] = at[n] ? c->arrays.at[c->arrays.n - 1].view.len / 8 : 0;
        Py_XDECREF(one);
    }
    int next = 0;
    c->k = at[next++], c->counts = at[next++], c->time = at[next++];
    for (int n = 0; n < OBSERVED; n++) c->observed[n] = at[next++];
    c->command = at[next++], c->wish = at[next++], c->said = at[next++], c->told = at[next++], c->shown = at[next++];
    c->commanded = at[next++], c->truth = at[next++], c->signs = at[next++], c->felt = at[next++], c->rows = at[next++];
    c->sent = at[next++], c->seen = at[next++], c->last = at[next++], c->meant = at[next++], c->start = at[next++];
    c->noise = at[next++], c->parts = at[next++], c->taught = at[next++];
    if (!PyErr_Occurred()) {
        c->width = 1 + 12 * d + 4;
        c->n_seen = (int)sizes[18], c->n_meant = (int)(sizes[20] / d), c->n_noise = (int)sizes[22];
        const Py_ssize_t past = (Py_ssize_t)c->k->late + 2, rows = c->counts[MOST_TICKS] + 1;
        const Py_ssize_t wanted[] = {
            (Py_ssize_t)sizeof(CarryNumbers) / 8, COUNTS, 1, d, d, d, d, 3 * d, 3 * d, d, d, SHOWN * d, d, 3 * d, 3,
            d * ((Py_ssize_t)sizeof(FeltAxis) / 8 + past), rows * c->width, d, -3 * d, 3 * d, -d, d, -d * (NOISE_BLOCK + 1), 4, d,
        };
        if (all_n != next || c->envelope->d != d) PyErr_Format(PyExc_ValueError, "a run has %d arrays of one number of axes", next);
        for (int n = 0; n < next && !PyErr_Occurred(); n++) /* negative: at least so many */
            if (wanted[n] < 0 ? sizes[n] < -wanted[n] : sizes[n] != wanted[n])
                PyErr_Format(PyExc_ValueError, "array %d has %zd numbers; expected %zd", n, sizes[n], wanted[n]);
    }
    if (PyErr_Occurred()) {
        Py_DecRef((PyObject *)c);
        return NULL;
    }
    return (PyObject *)c;
}

static void carry_dealloc(PyObject *object) {
    Carry *c = (Carry *)object;
    PyTypeObject *type = Py_TYPE(object);
    release(&c->arrays);
    Py_DecRef(c->beams);
    Py_DecRef(c->envelopes);
    freefunc release_object = (freefunc)PyType_GetSlot(type, Py_tp_free);
    release_object(object);
    Py_DecRef((PyObject *)type);
}

static PyType_Slot carry_slots[] = {{Py_tp_new, carry_new}, {Py_tp_dealloc, carry_dealloc}, {0, NULL}};
static PyType_Spec carry_spec = {"comanip.kernels._native.Carry", sizeof(Carry), 0, Py_TPFLAGS_DEFAULT, carry_slots};

/* (runs (a list of n, None where the Python takes all), said (n, d), status (n) int64, open (n) int64): one tick of each */
static PyObject *carry_each(PyObject *self, PyObject *args) {
    PyObject *runs, *said, *status, *open;
    (void)self;
    if (!PyArg_ParseTuple(args, "OOOO", &runs, &said, &status, &open)) return NULL;
    if (!PyList_Check(runs)) return PyErr_Format(PyExc_TypeError, "runs must be a list");
    const Py_ssize_t n = PyList_Size(runs), numbers = count_of(said), d = n ? numbers / n : 1;
    Arrays arrays = {.n = 0};
    const double *actions = NUMBERS(said, numbers);
    int64_t *told = RESULT(status, n), *over = RESULT(open, n);
    for (Py_ssize_t i = 0; i < n && !PyErr_Occurred(); i++) {
        PyObject *one = PyList_GetItem(runs, i); /* borrowed */
        if (Py_TYPE(one) != carry_type) {
            told[i] = FOR_PYTHON;
            continue;
        }
        Carry *c = (Carry *)one;
        if (c->d != d) {
            PyErr_Format(PyExc_ValueError, "run %zd has %d axes, said has %zd", i, c->d, d);
            break;
        }
        int why = OPEN;
        told[i] = c->counts[TICKS] < c->counts[MOST_TICKS] ? carry_tick(c, actions + i * d, &why) : FOR_PYTHON;
        over[i] = why;
    }
    release(&arrays);
    if (PyErr_Occurred()) return NULL;
    Py_RETURN_NONE;
}
