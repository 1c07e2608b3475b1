/* What safety/envelope.py knows and remembers, and the bounds that it sets; its ticks are in _ordinary.h and _guard.h. */

#define LIMITS(X) \
    X(v_max, v_max_m_per_s) X(a_max, a_max_m_per_s2) X(force_limit, force_limit_n) X(energy, energy_j) X(stuck_s, stuck_s) \
    X(stuck_m, stuck_m) X(moving, moving_m_per_s) X(position_jump, position_jump_m) X(drift, drift_m) X(blocked_n, blocked_n) \
    X(blocked_s, blocked_s) X(alone_n, alone_n) X(alone_s, alone_s) X(steady_n_s, steady_n_s) X(stands, stands_m_per_s) \
    X(sink_m, sink_m) X(pushed_n, pushed_n) X(pushed_j, pushed_j) X(let_go_n, let_go_n) X(let_go_s, let_go_s) X(held_n, held_n) \
    X(let_go_speed, let_go_m_per_s) X(tare_n, tare_n) X(jump_n, jump_n) X(jump_rest_s, jump_rest_s) \
    X(jump_stays_s, jump_stays_s) X(comply_damping, comply_damping_ns_per_m) X(fade_s, fade_s) X(rest, rest_m_per_s) \
    X(pull_n, pull_n) X(impact_s, impact_s) X(impact_n, impact_n) X(load_n, load_n) X(feel_s, feel_s) X(passed_s, passed_s) \
    X(offer_s, offer_s) X(offer_n, offer_n) X(shake_n, shake_n) X(dt, _dt) X(late, _late) X(stale, _stale)
typedef struct { LIMITS(ONE_NUMBER) } Limits;

#define SCALARS(X) \
    X(period, _period) X(time, _time) X(stamp, _stamp) X(age, _age) X(elapsed, _elapsed) X(impact_s, _impact_s) \
    X(blocked_ns, _blocked_ns) X(rest_s, _rest_s) X(energy, _energy) X(leads, _leads) X(sinks_s, _sinks_s) \
    X(zero_ticks, _missing.known) X(held, _missing.held) X(met, _missing.met) X(missed_s, _missing.alone_s) X(mistakes, _missing.mistakes) \
    X(for_s, _let_go._for_s) X(weighed, _let_go._weighed) X(sunk, _sinking.sunk) X(lack_peak, _sinking._peak) \
    X(again_s, _sinking._again_s) X(led, _sinking.led) X(since_up_s, _sinking._since_up_s) X(work, _pushed.work) X(push_peak, _pushed._peak) \
    X(jump_usual, _jump._usual) X(heard_s, _jump._heard_s) X(still_s, _jump._still_s) X(mean, _shaking._mean) \
    X(amplitude, _shaking.amplitude) X(dragged, _drag.ticks) X(drag_speeds, _drag.speeds) \
    X(drag_squares, _drag.squares) X(drag_pulls, _drag.pulls) X(drag_products, _drag.products) \
    X(drag_error, _drag.error)
#define VECTORS(X) \
    X(x, _x) X(sent, _sent) X(at, _at) X(v, _v) X(force, _force) X(wanted, _wanted) X(asked, _asked) X(rate, _rate) \
    X(felt, _felt) X(senses, _senses) X(zero, _missing.zero) X(pull, _missing.pull) X(weight, _let_go.weight) X(reading, _stuck.last) X(same_s, _stuck.same_s) \
    X(same_m, _stuck._same_m) X(changes, _stuck._changes) X(smallest, _stuck._least) X(usual, _stuck._usual) \
    X(dead, _stuck._dead) X(sensed, _jump.last) X(slow, _shaking._slow)
#define CHECKED(X) X(at, _checker.at) X(last, _checker.last)
#define ITS_AXES(field, name) Axes field;
typedef struct { /* SCALARS, how many rows there are in the two memories of LetGo, VECTORS */
    SCALARS(ONE_NUMBER)
    double n_pulls, n_before;
    VECTORS(ITS_AXES)
    Commanded commanded; /* CHECKED */
} Ledger;

typedef struct {
    int d, most_pulls, most_before, swing; /* samples of one swing of the object */
    Limits limits;
    Rules rules;
    Axes low, high;
    Ledger *now;          /* in Python's array, and behind it: */
    double *pulls, *before; /* [most_pulls][d], [most_before][d], oldest first */
    double *tank;
} Envelope;

/* as in safety/detectors.py and safety/envelope.py */
#define WEIGHED_TICKS 25
#define STILL_S 0.15 /* most_before, less one, and SLOW_SWING_S is most_pulls */
#define QUIET_S 0.5
#define LIGHT_N 1.25
#define ZERO_TICKS 50
#define PULL_S 0.06
#define LED_ALONE_N 0.6
#define LED_ALONE_S 0.25
#define HANGS_N 4.0
#define ALONE_SHARE 0.35
#define PULLS 0.3
#define LACK_PEAK_S 4.0
#define YIELDS 0.8
#define PEAK_S 0.5
#define TURNS_S 2.0
#define LED_DOWN 2.0
#define HELPS 0.5
#define LETS 0.9
#define LED_UP_M_S 0.05
#define AGAIN_S 0.1
#define DRAGGED_M_S 0.02
#define DIFFERS_M_S 0.01
#define FORGOTTEN_S 1.5
#define TOLD_N 0.8
#define TOLD_S 0.1
#define UNTOLD_N 2.0
#define RUBS 0.5
#define LIVELY 8
#define FINE 0.25
#define SUNK 0.9
#define SINKS_S 0.6
#define CREEP_M_S 0.025
#define SINK_M_S2 1.0
#define SAME_SAMPLE 1e-3
#define GRAVITY 9.80665

static const double LACKS[2] = {0.02, 0.12}, TURNS[2] = {0.15, 0.3};
static const double AGAIN_AS_LONG[3] = {1.0, 3.0, 20.0}; /* AGAIN of safety/detectors.py */

static inline double load_of(const Ledger *l, int d) { return l->weighed >= WEIGHED_TICKS ? length(l->weight, d) : 0.0; }

static inline void remember(double *rows, double *n, int most_rows, int d, const double *row) {
    if (*n == most_rows) copy(rows, rows + d, d * (most_rows - 1)); /* forwards, so they may overlap */
    else *n += 1.0;
    copy(rows + ((int)*n - 1) * d, row, d);
}

static inline double cap(const Limits *limits, double room) {
    const double a = limits->a_max;
    return room > 0.0 ? most(0.0, sqrt(2.0 * a * room) - 0.5 * a * limits->late) : 0.0;
}

/* Envelope._fastest */
static inline double fastest(const Envelope *e, const Ledger *l, const double *velocity) {
    const double speed = length(velocity, e->d);
    double room = l->energy / e->limits.force_limit;
    for (int i = 0; i < e->d; i++) {
        const double v = velocity[i], x = l->x[i], at = l->at[i];
        const double left = v > 0.0 ? e->high[i] - most(x, at) : least(x, at) - e->low[i];
        if (v != 0.0) room = least(room, most(left, 0.0) * (speed / fabs(v)));
    }
    return least(e->limits.v_max, cap(&e->limits, room));
}

/* Envelope._clip of what is `asked`; 0 where it has to brake. */
static inline int clipped(const Envelope *e, const Ledger *l, const double *asked, double *v) {
    const Limits *limits = &e->limits;
    const int d = e->d;
    const double load = load_of(l, d);
    copy(v, asked, d);
    if (l->again_s < AGAIN_S && load > LIGHT_N) { /* Envelope._unsunk */
        const double may = most(sqrt(2.0 * SINK_M_S2 * most(limits->sink_m - l->sunk, 0.0)), CREEP_M_S) + l->led;
        const double beyond = dot(asked, l->weight, d) / load - may;
        for (int i = 0; i < d && beyond > 0.0; i++) v[i] = asked[i] - beyond * (l->weight[i] / load);
    }
    for (int i = 0; i < d; i++) {
        const double x = l->x[i], at = l->at[i];
        v[i] = within(v[i], -cap(limits, least(x, at) - e->low[i]), cap(limits, e->high[i] - most(x, at)));
    }
    const double speed = length(v, d), top = fastest(e, l, v), most_change = limits->a_max * l->period;
    if (speed > top)
        for (int i = 0; i < d; i++) v[i] *= top / speed;
    const double far = apart(v, l->v, d);
    if (far <= most_change) return 1;
    for (int i = 0; i < d; i++) v[i] = l->v[i] + (v[i] - l->v[i]) * (most_change / far);
    return length(v, d) <= fastest(e, l, v) + 1e-12;
}

/* Envelope._readings and Stuck.step */
static inline int stands_still(const Envelope *e, Ledger *l, const double *sensed, const double *force, double speed, double period) {
    int stuck = 0;
    for (int i = 0; i < e->d; i++) {
        if (sensed[i] == sensed[i]) l->senses[i] = 1.0;
        const double reading = sensed[i] == sensed[i] ? sensed[i] : l->senses[i] != 0.0 ? l->reading[i] : force[i];
        const double change = fabs(reading - l->reading[i]);
        l->reading[i] = reading;
        if (change == 0.0) {
            l->same_s[i] += period;
            l->same_m[i] += speed * period;
            const int fine = l->changes[i] >= LIVELY && l->smallest[i] < FINE * l->usual[i] && reading != l->dead[i];
            stuck |= l->same_m[i] > e->limits.stuck_m || (fine && l->same_s[i] > e->limits.stuck_s + 1e-9);
            if (!fine && l->same_s[i] > 0.5 * e->limits.stuck_s) l->dead[i] = reading;
            continue;
        }
        l->same_s[i] = l->same_m[i] = 0.0;
        if (is_finite(change)) {
            l->changes[i] += 1.0;
            l->smallest[i] = least(l->smallest[i], change);
            l->usual[i] += (change - l->usual[i]) / least(l->changes[i], 100.0);
        }
    }
    return stuck;
}

/* Drag.at */
static inline double resists(const Ledger *l, double speed) {
    if (l->dragged == 0.0) return 0.0;
    const double mean = l->drag_speeds / l->dragged, pull = l->drag_pulls / l->dragged;
    const double varies = l->drag_squares / l->dragged - mean * mean;
    if (varies < DIFFERS_M_S * DIFFERS_M_S) return pull;
    return pull + (l->drag_products / l->dragged - mean * pull) / varies * (speed - mean);
}

/* Drag.explains */
static inline int explains(const Ledger *l, double load) { return l->drag_error < TOLD_N && resists(l, 0.0) < RUBS * load; }

/* Drag.step */
static inline void dragging(Ledger *l, int d, double period) {
    const double speed = length(l->v, d);
    if (speed < DRAGGED_M_S) return;
    const double told = resists(l, speed), against = -dot(l->force, l->v, d) / speed, keep = most(1.0 - period / FORGOTTEN_S, 0.0);
    Axes beside;
    for (int i = 0; i < d; i++) beside[i] = l->force[i] + told * (l->v[i] / speed);
    l->drag_error += least(period / TOLD_S, 1.0) * (length(beside, d) - l->drag_error);
    l->dragged = keep * l->dragged + 1.0;
    l->drag_speeds = keep * l->drag_speeds + speed;
    l->drag_squares = keep * l->drag_squares + speed * speed;
    l->drag_pulls = keep * l->drag_pulls + against;
    l->drag_products = keep * l->drag_products + speed * against;
}

/* Sinking.step and Envelope._sink */
static inline int sinks(const Envelope *e, Ledger *l, const double *taught, double period) {
    const int d = e->d;
    const double load = load_of(l, d);
    if (load > LIGHT_N) {
        const double more = dot(l->force, l->weight, d) / (load * load), down = dot(l->v, l->weight, d) / load;
        l->since_up_s = down < -LED_UP_M_S ? 0.0 : l->since_up_s + period;
        const double *lacks = l->since_up_s < TURNS_S ? TURNS : LACKS;
        l->lack_peak = most(more, l->lack_peak - period / LACK_PEAK_S * l->lack_peak);
        const int answers = l->lack_peak > PULLS && more < YIELDS * l->lack_peak;
        const int doubtful = more < 1.0 + e->limits.alone_n / load && !answers;
        const double counts = doubtful ? least(most((more - lacks[0]) / (lacks[1] - lacks[0]), 0.0), 1.0) : 0.0;
        l->again_s = counts > 0.0 ? 0.0 : l->again_s + period;
        l->led = LED_DOWN * most(dot(taught, l->weight, d) / load, 0.0) * least(most((LETS - more) / (LETS - HELPS), 0.0), 1.0);
        l->sunk = l->again_s < AGAIN_S ? l->sunk + counts * most(down - l->led, 0.0) * period : 0.0;
    }
    l->sinks_s = l->again_s < AGAIN_S && l->sunk > SUNK * e->limits.sink_m ? l->sinks_s + period : 0.0;
    return l->sinks_s > SINKS_S;
}

/* Missing.step */
static inline int missed(const Envelope *e, Ledger *l, const double *sensed, double speed, double period) {
    const Limits *limits = &e->limits;
    const int d = e->d, leads = l->leads >= 1.0;
    const double size = length(l->force, d), share = least(period / PULL_S, 1.0);
    Axes felt;
    for (int i = 0; i < d; i++) felt[i] = is_finite(sensed[i]) ? 2.0 * l->force[i] - sensed[i] : l->force[i];
    if (speed < limits->moving) {
        l->held = 0.0;
        if (l->zero_ticks < ZERO_TICKS && 0.0 < size && size < limits->tare_n) {
            l->zero_ticks += 1.0;
            for (int i = 0; i < d; i++) l->zero[i] += (felt[i] - l->zero[i]) / l->zero_ticks;
        }
    }
    for (int i = 0; i < d; i++) l->pull[i] += share * (felt[i] - l->zero[i] - l->pull[i]);
    const int nobody = leads ? length(l->pull, d) < LED_ALONE_N : size < limits->let_go_n;
    l->held = l->held != 0.0 || size > limits->held_n, l->met = l->met != 0.0 || size > limits->held_n;
    l->missed_s = (leads ? l->met : l->held) != 0.0 && nobody && speed > limits->let_go_speed ? l->missed_s + period : 0.0;
    return l->missed_s > (leads ? LED_ALONE_S * AGAIN_AS_LONG[(int)least(l->mistakes, 2.0)] : limits->let_go_s);
}

/* Pushed.step */
static inline void pushing(const Envelope *e, Ledger *l, double period) {
    const double speed = length(l->v, e->d), along = speed > 0.0 ? dot(l->force, l->v, e->d) / speed : 0.0;
    l->push_peak = most(along, l->push_peak - period / PEAK_S * l->push_peak);
    const double beyond = along > YIELDS * l->push_peak ? along - e->limits.pushed_n : -e->limits.pushed_n;
    l->work = most(l->work + beyond * speed * period, 0.0);
}

/* Shaking.step */
static inline void shaken(const Envelope *e, Ledger *l, double period) {
    const double share = 1.0 - exponential(-2.0 * PI * period);
    for (int i = 0; i < e->d; i++) l->slow[i] += share * (l->force[i] - l->slow[i]);
    l->mean += least(period / 0.5, 1.0) * (apart(l->force, l->slow, e->d) - l->mean);
    l->amplitude = 1.57 * l->mean;
}
