/* One control period of beam and person, for plants/beam.py, people/partners.py and people/intent.py: the same operations in the same order
 * as there, so that the numbers are the same to the last bit. A run's state is here alone; what a plant shows comes out each period.
 */

enum { NOISE_BLOCK = 2048 }; /* humans.BLOCK */

#define WRIST(X) \
    X(mass, mass_kg) X(length, length_m) X(wrist_stiffness, wrist_stiffness_nm_per_rad) \
    X(wrist_damping, wrist_damping_nms_per_rad) X(lag, actuator_lag_s) X(inertia, inertia) X(decay, decay) X(step, step_s) \
    X(yy, yy) X(yv, yv) X(yu, yu) X(vy, vy) X(vv, vv) X(vu, vu)
typedef struct { WRIST(ONE_NUMBER) } Wrist; /* BeamPlant._as_numbers */

#define HUMAN(X) \
    X(stiffness, stiffness_n_per_m) X(damping, damping_ns_per_m) X(feedforward, feedforward) X(yields, yields) \
    X(yielding, yielding_ns_per_m) X(persistence, persistence) X(lag, lag_s) X(dead_zone, dead_zone_n) X(mix, mix) \
    X(intent_step, intent_step_s) X(keep, keep) X(fresh, fresh) X(relative, relative) X(absolute, absolute_n) \
    X(tremor, tremor_n) X(phase_step, phase_step)
typedef struct { HUMAN(ONE_NUMBER) } Human; /* partners.Person.numbers */

#define ALONG(X) \
    X(axial, axial) X(gravity, gravity) X(start, start) X(moves, moves) X(carried, carried) X(origin, origin) X(phase, phase)
typedef struct { ALONG(ONE_NUMBER) } Along; /* of each axis */
typedef struct { double start, duration, far[]; } Leg;                                 /* of humans.Course, far[d] */
typedef struct { double pull, surplus; } Felt;

#define END(X) \
    X(position, position) X(velocity, velocity) X(acceleration, acceleration) X(tilt, tilt) X(tilt_rate, tilt_rate) \
    X(tilt_acceleration, tilt_acceleration) X(sensor_force, sensor_force) X(far_position, far_position) \
    X(far_velocity, far_velocity) X(pull, pull) X(sampled, sampled)
typedef struct { /* _TransverseAxis, and Intent and Noise of the person */
    END(ONE_NUMBER)
    double correction, correction_speed, felt, surplus, planned_speed, noise, phase;
    Felt *past; /* [person_late], the oldest at `oldest` */
    double *line; /* [sensor_late + 1] */
    int oldest, next;
} End;
enum { SHOWN = 11 }; /* numbers of an End that the plant shows: the first ones */

typedef struct {
    int d, substeps, n_legs, n_rows, person_late, sensor_late, left, spare;
    Wrist wrist;
    Human human;
    Along along[MOST_AXES];
    End ends[MOST_AXES];
    double curve_start, curve_step;
    double *legs, *curve; /* [n_legs][2 + d]; [n_rows][3][d] of humans.Curve */
    double *block, *next_block; /* [d][NOISE_BLOCK], used from the end */
} Beam;

static void minimum_jerk(double s, double *out) {
    const int within_it = s > 0.0 && s < 1.0;
    out[0] = within_it ? s * s * s * (10.0 + s * (-15.0 + 6.0 * s)) : s >= 1.0;
    out[1] = within_it ? s * s * (30.0 + s * (-60.0 + 30.0 * s)) : 0.0;
    out[2] = within_it ? s * (60.0 + s * (-180.0 + 120.0 * s)) : 0.0;
}

/* The rest of Along.at: what the sampled curve adds. */
static void course_at(const Beam *b, int i, double time, double *x, double *v, double *a) {
    const double last = b->n_rows - 1, asked = (time - b->curve_start) / b->curve_step;
    const double place = asked <= 0.0 ? 0.0 : asked < last ? asked : last;
    const int n = (int)place < b->n_rows - 2 ? (int)place : b->n_rows - 2;
    const double share = place - n, *one = b->curve + n * 3 * b->d + i, *other = one + 3 * b->d;
    *x += (1.0 - share) * one[0] + share * other[0];
    *v += (1.0 - share) * one[b->d] + share * other[b->d];
    *a += (1.0 - share) * one[2 * b->d] + share * other[2 * b->d];
}

/* Intent.step: equilibrium from the start, its velocity and the planned acceleration. */
static void intend(Beam *b, int i, double time, double *x, double *v, double *a) {
    const Human *h = &b->human;
    End *e = &b->ends[i];
    const int moves = b->along[i].moves != 0.0;
    *x = *v = *a = 0.0;
    for (int n = 0; n < b->n_legs && moves; n++) {
        const Leg *leg = (const Leg *)(b->legs + n * (2 + b->d));
        double unit[3];
        minimum_jerk((time - leg->start) / leg->duration, unit);
        *x += leg->far[i] * unit[0];
        *v += leg->far[i] * unit[1] / leg->duration;
        *a += leg->far[i] * unit[2] / pow(leg->duration, 2.0);
    }
    if (b->n_rows && moves) course_at(b, i, time, x, v, a);
    e->planned_speed = *v;
    if (h->yields == 0.0 || !moves) return;
    const Felt before = e->past[e->oldest];
    const double dead = h->dead_zone, pull = before.pull;
    const double beyond = pull > dead ? pull - dead : pull < -dead ? pull + dead : 0.0;
    const double wanted = beyond / h->yielding + h->persistence * before.surplus;
    e->correction_speed += h->intent_step / h->lag * (wanted - e->correction_speed);
    e->correction += h->intent_step * e->correction_speed;
    *x += e->correction, *v += e->correction_speed;
}

/* _Human.force */
static void pull(Beam *b, int i, double time) {
    const Human *h = &b->human;
    const Along *along = &b->along[i];
    End *e = &b->ends[i];
    double x, v, a;
    intend(b, i, time, &x, &v, &a);
    const double expected = along->carried + h->feedforward * a, off = along->origin + x - e->far_position;
    double force = h->stiffness * off + h->damping * (v - e->far_velocity) + expected;
    e->noise = h->keep * e->noise + h->fresh * b->block[i * NOISE_BLOCK + b->left - 1];
    e->phase += h->phase_step;
    force += e->noise * (h->relative * fabs(force) + h->absolute) + h->tremor * sin(e->phase);
    if (h->yields != 0.0 && along->moves != 0.0) { /* Intent.feel */
        e->felt += h->mix * (expected - force - e->felt);
        e->surplus += h->mix * (e->far_velocity - e->planned_speed - e->surplus);
        e->past[e->oldest] = (Felt){e->felt, e->surplus};
        e->oldest = (e->oldest + 1) % b->person_late;
    }
    e->pull = force;
}

/* _TransverseAxis.advance and _AxialAxis.advance */
static void carry(Beam *b, int i, double commanded) {
    const Wrist *w = &b->wrist;
    End *e = &b->ends[i];
    const double m = w->mass, g = b->along[i].gravity, error = e->velocity - commanded;
    e->acceleration = -error * (1.0 - w->decay) / w->step;
    e->position += commanded * w->step + error * w->lag * (1.0 - w->decay);
    e->velocity = commanded + error * w->decay;
    const double moment = e->pull * w->length - 0.5 * m * (g + e->acceleration) * w->length;
    e->tilt_acceleration = (moment - w->wrist_stiffness * e->tilt - w->wrist_damping * e->tilt_rate) / w->inertia;
    e->sensor_force = e->pull - m * (g + e->acceleration + 0.5 * w->length * e->tilt_acceleration);
    const double tilt = e->tilt, rate = e->tilt_rate, turn = moment / w->inertia;
    e->tilt = w->yy * tilt + w->yv * rate + w->yu * turn;
    e->tilt_rate = w->vy * tilt + w->vv * rate + w->vu * turn;
    if (b->along[i].axial != 0.0) { /* nothing tilts along the beam */
        e->tilt = e->tilt_rate = e->tilt_acceleration = 0.0;
        e->sensor_force = e->pull - m * e->acceleration;
    }
    e->far_position = e->position + w->length * e->tilt;
    e->far_velocity = e->velocity + w->length * e->tilt_rate;
}

/* BeamPlant.advance; 0, with nothing changed, where the noise would run out and no other block is there. */
static int period(Beam *b, double time, const double *commanded, double *shown) {
    double total[MOST_AXES] = {0.0};
    if (b->left < b->substeps && !b->spare) return 0;
    for (int n = 0; n < b->substeps; n++) {
        if (b->left == 0) {
            double *used = b->block;
            b->block = b->next_block, b->next_block = used;
            b->left = NOISE_BLOCK, b->spare = 0;
        }
        for (int i = 0; i < b->d; i++) pull(b, i, time + n * b->wrist.step);
        b->left--;
        for (int i = 0; i < b->d; i++) {
            End *e = &b->ends[i];
            carry(b, i, commanded[i]);
            e->line[e->next] = e->sensor_force; /* the place of the oldest */
            e->next = (e->next + 1) % (b->sensor_late + 1);
            total[i] += e->line[e->next];
        }
    }
    for (int i = 0; i < b->d; i++) {
        b->ends[i].sampled = total[i] / b->substeps;
        for (int q = 0; q < SHOWN; q++) shown[q * b->d + i] = (&b->ends[i].position)[q];
    }
    return 1;
}

#ifdef PY_VERSION_HEX /* else for the page, which has no Python (page/page.c) */
/* -------------------------------------------------------------------------------------------------- Python object */

typedef struct {
    PyObject_HEAD
    Beam beam;
    double *memory;
    Array slots[2]; /* commanded, shown */
} Beams;

static PyObject *beam_new(PyTypeObject *type, PyObject *args, PyObject *keywords) {
    PyObject *wrist, *human, *along, *legs, *curve, *clock;
    int substeps, person_late, sensor_late;
    (void)keywords;
    if (!PyArg_ParseTuple(args, "OOOOOOiii", &wrist, &human, &along, &legs, &curve, &clock, &substeps, &person_late, &sensor_late)) return NULL;
    const Py_ssize_t d = count_of(along) / (Py_ssize_t)(sizeof(Along) / 8), on_legs = count_of(legs), on_curve = count_of(curve);
    if (PyErr_Occurred()) return NULL;
    if (d < 1 || d > MOST_AXES || substeps < 1 || substeps > NOISE_BLOCK || person_late < 1 || sensor_late < 0)
        return PyErr_Format(PyExc_ValueError, "a beam has 1 to %d axes, substeps and delays", MOST_AXES);
    const Py_ssize_t n_legs = on_legs / (2 + d), n_rows = on_curve / (3 * d);
    if (n_rows == 1) return PyErr_Format(PyExc_ValueError, "a curve has no rows, or two and more");
    Beams *self = (Beams *)PyType_GenericAlloc(type, 0);
    if (!self) return NULL;
    Beam *b = &self->beam;
    *b = (Beam){.d = (int)d, .substeps = substeps, .n_legs = (int)n_legs, .n_rows = (int)n_rows, .person_late = person_late, .sensor_late = sensor_late};
    Arrays arrays = {.n = 0};
    const double *w = NUMBERS(wrist, sizeof(Wrist) / 8), *h = NUMBERS(human, sizeof(Human) / 8);
    const double *a = NUMBERS(along, d * (Py_ssize_t)(sizeof(Along) / 8)), *l = NUMBERS(legs, n_legs * (2 + d));
    const double *c = NUMBERS(curve, n_rows * 3 * d), *t = NUMBERS(clock, 2);
    const size_t size = 2 * d * NOISE_BLOCK + (2 + d) * n_legs + 3 * d * n_rows + d * (2 * person_late + sensor_late + 1);
    double *from = self->memory = PyErr_Occurred() ? NULL : calloc(size, sizeof(double));
    if (!from) {
        if (!PyErr_Occurred()) PyErr_NoMemory();
        release(&arrays);
        Py_DecRef((PyObject *)self);
        return NULL;
    }
    memcpy(&b->wrist, w, sizeof(Wrist));
    memcpy(&b->human, h, sizeof(Human));
    memcpy(b->along, a, sizeof(Along) * d);
    b->block = from, b->next_block = from + d * NOISE_BLOCK, from = b->next_block + d * NOISE_BLOCK;
    memcpy(b->legs = from, l, sizeof(double) * (2 + d) * n_legs), from += (2 + d) * n_legs;
    memcpy(b->curve = from, c, sizeof(double) * 3 * d * n_rows), from += 3 * d * n_rows;
    b->curve_start = t[0], b->curve_step = t[1];
    for (int i = 0; i < d; i++) {
        End *e = &b->ends[i];
        e->position = e->far_position = b->along[i].start, e->phase = b->along[i].phase;
        e->sensor_force = b->along[i].axial != 0.0 ? 0.0 : -0.5 * b->wrist.mass * b->along[i].gravity;
        e->past = (Felt *)from, from += 2 * person_late;
        e->line = from, from += sensor_late + 1;
        for (int n = 0; n <= sensor_late; n++) e->line[n] = e->sensor_force;
    }
    release(&arrays);
    return (PyObject *)self;
}

static void beam_dealloc(PyObject *object) {
    Beams *self = (Beams *)object;
    PyTypeObject *type = Py_TYPE(object);
    for (int i = 0; i < 2; i++) PyBuffer_Release(&self->slots[i].view);
    free(self->memory);
    freefunc release_object = (freefunc)PyType_GetSlot(type, Py_tp_free);
    release_object(object);
    Py_DecRef((PyObject *)type);
}

/* (time, commanded (d,), shown (SHOWN, d)) */
static PyObject *beam_advance(PyObject *object, PyObject *const *args, Py_ssize_t n) {
    Beams *self = (Beams *)object;
    const int d = self->beam.d;
    if (n != 3) return PyErr_Format(PyExc_TypeError, "time, commanded, shown");
    const double time = PyFloat_AsDouble(args[0]), *commanded = kept(&self->slots[0], args[1], d, 0);
    double *shown = kept(&self->slots[1], args[2], SHOWN * d, 1);
    if (PyErr_Occurred()) return NULL;
    if (!commanded || !shown) return PyErr_Format(PyExc_ValueError, "commanded is (%d,) and shown (%d, %d), float64", d, SHOWN, d);
    return PyBool_FromLong(period(&self->beam, time, commanded, shown));
}

/* The next normal numbers (d, NOISE_BLOCK); asked for when `advance` says False. */
static PyObject *beam_feed(PyObject *object, PyObject *numbers) {
    Beam *b = &((Beams *)object)->beam;
    Arrays arrays = {.n = 0};
    const double *from = NUMBERS(numbers, (Py_ssize_t)b->d * NOISE_BLOCK);
    if (from) memcpy(b->next_block, from, sizeof(double) * b->d * NOISE_BLOCK), b->spare = 1;
    release(&arrays);
    if (PyErr_Occurred()) return NULL;
    Py_RETURN_NONE;
}

/* What a run has made of a Beam, for a copy made with the same arguments: (numbers in front of `past` of each End, and its places in
 * the rings; how many numbers of the noise are left, and whether there are more; all its memory). */
enum { IN_END = offsetof(End, past) / 8, KEPT = IN_END + 2 };

static size_t run_of(Beams *self, double *run, int recall) {
    Beam *b = &self->beam;
    const size_t d = b->d, noise = d * NOISE_BLOCK, rings = d * (2 * b->person_late + b->sensor_late + 1);
    double *const ring = (double *)b->ends[0].past;
    if (run) {
        double *at = run;
        for (size_t i = 0; i < d; i++, at += KEPT) {
            End *e = &b->ends[i];
            if (recall) memcpy(e, at, sizeof(double) * IN_END), e->oldest = (int)at[IN_END], e->next = (int)at[IN_END + 1];
            else memcpy(at, e, sizeof(double) * IN_END), at[IN_END] = e->oldest, at[IN_END + 1] = e->next;
        }
        if (recall) b->left = (int)at[0], b->spare = (int)at[1];
        else at[0] = b->left, at[1] = b->spare;
        at += 2;
        double *const parts[] = {b->block, b->next_block, ring};
        for (int n = 0; n < 3; n++) {
            const size_t size = n < 2 ? noise : rings;
            memcpy(recall ? parts[n] : at, recall ? at : parts[n], sizeof(double) * size);
            at += size;
        }
    }
    return d * KEPT + 2 + 2 * noise + rings;
}

static PyObject *beam_run(PyObject *self, PyObject *nothing) {
    (void)nothing;
    PyObject *bytes = PyBytes_FromStringAndSize(NULL, (Py_ssize_t)(run_of((Beams *)self, NULL, 0) * sizeof(double)));
    if (bytes) run_of((Beams *)self, (double *)PyBytes_AsString(bytes), 0);
    return bytes;
}

static PyObject *beam_recall(PyObject *self, PyObject *run) {
    Arrays arrays = {.n = 0};
    double *from = take(&arrays, run, 0, (Py_ssize_t)run_of((Beams *)self, NULL, 1), 8, "run");
    if (from) run_of((Beams *)self, from, 1);
    release(&arrays);
    if (PyErr_Occurred()) return NULL;
    Py_RETURN_NONE;
}

static PyMethodDef beam_methods[] = {
    {"advance", (PyCFunction)(void (*)(void))beam_advance, METH_FASTCALL, "One control period; False, with nothing changed, without noise."},
    {"feed", beam_feed, METH_O, "The next block of normal numbers."},
    {"run", beam_run, METH_NOARGS, "Bytes of all that a run has made of it."},
    {"recall", beam_recall, METH_O, "Goes on from such bytes, of a beam made with the same arguments."},
    {NULL, NULL, 0, NULL},
};
static PyType_Slot beam_slots[] = {{Py_tp_new, beam_new}, {Py_tp_dealloc, beam_dealloc}, {Py_tp_methods, beam_methods}, {0, NULL}};
static PyType_Spec beam_spec = {"comanip.kernels._native.Beam", sizeof(Beams), 0, Py_TPFLAGS_DEFAULT, beam_slots};
#endif
