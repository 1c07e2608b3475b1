/* skills/foresight.py once more: the same operations in the same order. */

typedef struct { /* Foresight.memory and what its plans share; `plans` 0: nothing is foreseen */
    int plans, alike; /* plans of each size */
    double keep;
    const double *sizes, *paces, *late, *prior;
    double *start, *felt, *velocity, *acceleration, *told, *phase, *p;
} Foresight;

enum { STILL_S_OF, TRIED, RESTLESSNESS, AWAKE, SURE, DEPARTS, NONE, WHICH, TOLD }; /* of `told` */
#define STIFFNESS 300.0
#define DAMPING 40.0
#define PLACE_M 0.006
#define PLACE_SHARE 0.04
#define SLOW_SPEED 0.02
#define SPEED_SHARE 0.10
#define PLANS_MEMORY 0.10
#define NONE_SIGMAS 1.6
#define NONE_FIRST 0.10
#define NONE_COMES_S 5.0
#define GIVEN_UP 0.8
#define BEGINS_M 0.006
#define TRIES 3
#define RISES_S 0.5
#define FADES_S 4.0
#define RESTLESS 2.0
#define MOST_BEGINS_M 0.02
#define FIRST_M 0.0045
#define ON_WAY 0.7
#define AT_START 0.02
#define PLAN_RESTS 0.015
#define PLAN_RESTS_S 0.4

static inline void lay_foresight(Foresight *f, int d, double *memory) {
    f->start = memory, f->felt = memory + d, f->velocity = f->felt + d, f->acceleration = f->velocity + d, f->told = memory + 4 * d;
    f->phase = f->told + TOLD, f->p = f->phase + f->plans;
}

static inline void nothing_foreseen(const Foresight *f, int d) {
    fill(f->velocity, 0.0, d);
    fill(f->acceleration, 0.0, d);
    f->told[DEPARTS] = 0.0;
}

static inline void give_up(const Foresight *f, int d, double tries) {
    f->told[AWAKE] = 0.0, f->told[TRIED] = tries, f->told[SURE] = 0.0;
    nothing_foreseen(f, d);
}

/* Foresight.reset */
static inline void foresight_reset(const Foresight *f, int d, const double *position, int begins) {
    copy(f->start, position, d);
    fill(f->felt, 0.0, d);
    fill(f->told, 0.0, TOLD);
    fill(f->phase, 0.0, f->plans);
    fill(f->p, 0.0, f->plans);
    nothing_foreseen(f, d);
    f->told[TRIED] = begins ? 0.0 : TRIES, f->told[RESTLESSNESS] = FIRST_M;
}

/* Plans.begun */
static inline double begun_at(const Table *t, double along) {
    const double *way = t->plan_way;
    int low = 0, high = t->rows;
    if (along >= way[t->rows - 1]) return t->step_s * (t->rows - 1);
    while (low < high) { /* bisect_right */
        const int middle = (low + high) / 2;
        if (along < way[middle]) high = middle;
        else low = middle + 1;
    }
    const int n = low > 1 ? low - 1 : 0;
    return t->step_s * (n + most(along - way[n], 0.0) / (way[n + 1] - way[n]));
}

/* Foresight._wake */
static inline void wake(const Foresight *f, const Table *t, int d, double dt, int goal, const double *x, const double *v) {
    static const double FARTHER[TRIES] = {1.0, 2.5, 6.25};
    double *told = f->told;
    Axes off;
    for (int i = 0; i < d; i++) off[i] = x[i] - f->start[i] + f->felt[i] / STIFFNESS;
    const double along = dot(off, t->heading, d), size = length(off, d);
    told[RESTLESSNESS] += dt / (size > told[RESTLESSNESS] ? RISES_S : FADES_S) * (size - told[RESTLESSNESS]);
    const double needs = most(BEGINS_M * FARTHER[(int)told[TRIED]], least(RESTLESS * told[RESTLESSNESS], MOST_BEGINS_M));
    if (along < needs || dot(v, t->heading, d) <= 0.0 || along < ON_WAY * size) return;
    double begun = 0.0;
    for (int n = 0; n < f->plans; n++) {
        if (n % f->alike == 0) begun = begun_at(t, along / f->sizes[n]);
        f->phase[n] = begun + f->paces[n] * f->late[n];
        f->p[n] = f->prior[n];
    }
    told[NONE] = NONE_FIRST, told[SURE] = told[DEPARTS] = 1.0 - NONE_FIRST, told[AWAKE] = 1.0, told[WHICH] = goal;
}

/* Foresight.hears; `goal`, whose path is `t`, and the phase on it are those of Whereabouts */
static inline int hears(const Foresight *f, const Table *t, int d, double dt, int goal, double phase, const double *x, const double *v,
                        const double *force) {
    double *told = f->told;
    for (int i = 0; i < d; i++) f->felt[i] = f->keep * f->felt[i] + (1.0 - f->keep) * within(force[i], -50.0, 50.0);
    told[STILL_S_OF] = length(v, d) < PLAN_RESTS ? told[STILL_S_OF] + dt : 0.0;
    if (told[AWAKE] != 0.0) {
        if (told[STILL_S_OF] > PLAN_RESTS_S) give_up(f, d, TRIES);
    } else if (told[TRIED] < TRIES) {
        wake(f, t, d, dt, goal, x, v);
    } else if (told[STILL_S_OF] > PLAN_RESTS_S && phase <= AT_START * t->duration_s) {
        copy(f->start, x, d);
        told[TRIED] = 0.0, told[RESTLESSNESS] = FIRST_M;
    }
    return told[AWAKE] != 0.0;
}

/* Foresight.step; `tables` of all goals */
static inline void foresee(const Foresight *f, const Table *tables, int d, double dt, const double *x, const double *v) {
    double *told = f->told;
    const Table *t = tables + (int)told[WHICH];
    Axes z, u;
    for (int i = 0; i < d; i++) z[i] = x[i] - f->start[i] + f->felt[i] / STIFFNESS, u[i] = v[i] + f->felt[i] / DAMPING;
    const double doubt = PLACE_M + PLACE_SHARE * length(z, d), slow = SLOW_SPEED + SPEED_SHARE * length(u, d);
    const double worth = least(dt / PLANS_MEMORY, 1.0), last = t->rows - 1.001;
    double total = 0.0;
    for (int n = 0; n < f->plans; n++) {
        f->phase[n] += f->paces[n] * dt;
        const double place = within(f->phase[n] / t->step_s, 0.0, last), share = place - (int)place;
        const double *row = t->plan + (int)place * 3 * d, *next = row + 3 * d, fast = f->sizes[n] * f->paces[n];
        double far = 0.0, slip = 0.0;
        for (int i = 0; i < d; i++) {
            const double off = f->sizes[n] * ((1.0 - share) * row[i] + share * next[i]) - z[i];
            const double off_speed = fast * ((1.0 - share) * row[d + i] + share * next[d + i]) - u[i];
            far += off * off;
            slip += off_speed * off_speed;
        }
        far = far / (doubt * doubt) + slip / (slow * slow);
        f->p[n] *= exponential(-0.5 * worth * least(far, 200.0));
        total += f->p[n];
    }
    const double none = (told[NONE] + dt / NONE_COMES_S) * exponential(-0.5 * worth * 2.0 * NONE_SIGMAS * NONE_SIGMAS);
    const double sure = total / (total + none), scale = 1.0 / (total + none);
    if (sure < 1.0 - GIVEN_UP || total < 1e-290) {
        give_up(f, d, told[TRIED] + 1.0);
        return;
    }
    told[NONE] = none * scale, told[SURE] = sure;
    double sum = 0.0, departs = 0.0, ended = 0.0;
    for (int n = 0; n < f->plans; n++) f->p[n] *= scale, sum += f->p[n];
    for (int n = 0; n < f->plans; n++) {
        const double weight = f->p[n] / sum;
        if (f->phase[n] < t->duration_s) departs += weight;
        if (f->phase[n] >= t->duration_s) ended += weight;
    }
    told[DEPARTS] = sure * departs;
    if (ended > GIVEN_UP) {
        give_up(f, d, TRIES);
        return;
    }
    fill(f->velocity, 0.0, d);
    fill(f->acceleration, 0.0, d);
    for (int n = 0; n < f->plans; n++) {
        const double place = within(f->phase[n] / t->step_s, 0.0, last), share = place - (int)place, weight = f->p[n] / sum;
        const double *row = t->plan + (int)place * 3 * d, *next = row + 3 * d, fast = f->sizes[n] * f->paces[n];
        for (int i = 0; i < d; i++) {
            f->velocity[i] += weight * (fast * ((1.0 - share) * row[d + i] + share * next[d + i]));
            f->acceleration[i] += weight * fast * f->paces[n] * ((1.0 - share) * row[2 * d + i] + share * next[2 * d + i]);
        }
    }
}
