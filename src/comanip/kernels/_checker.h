/* safety/checker.py once more: the second opinion on every command, with own memory. It shares no function with _envelope.h. */

typedef struct { double v_max, a_max, dt, low[MOST_AXES], high[MOST_AXES]; } Rules;

typedef struct { double at[MOST_AXES], last[MOST_AXES]; } Commanded;

#define SLACK 1e-9

/* 1, with `c` moved on, when `velocity` after a timely period breaks no rule. */
static inline int allowed(const Rules *r, Commanded *c, int d, double period, const double *velocity) {
    const double gain = r->a_max * period;
    double was = 0.0, now = 0.0, change = 0.0;
    Commanded next = *c;
    for (int n = 0; n < d; n++) {
        const double new = velocity[n], old = c->last[n];
        was += old * old;
        now += new * new;
        change += (new - old) * (new - old);
        next.at[n] += old * period;
        next.last[n] = new;
    }
    was = sqrt(was), now = sqrt(now), change = sqrt(change);
    if (!(now <= r->v_max + SLACK)) return 0; /* also when it is not a number */
    if (!(change <= gain + SLACK)) return 0;
    for (int n = 0; n < d && now > was - gain + SLACK; n++) {
        const double new = velocity[n], stop = next.at[n] + new * now / (2.0 * r->a_max);
        if ((stop > r->high[n] + SLACK && new > 0.0) || (stop < r->low[n] - SLACK && new < 0.0)) return 0;
    }
    *c = next;
    return 1;
}

/* Checker.judge, whole: 0, or the rule that `velocity` breaks, and then `velocity` holds what to command instead. */
enum { ALLOWED, TOO_FAST, TOO_SUDDEN, NO_ROOM };
static inline int judge(const Rules *r, Commanded *c, int d, double period, double *velocity, int late) {
    const double gain = r->a_max * period;
    double was = 0.0, now = 0.0, change = 0.0, held = period;
    int verdict = ALLOWED;
    for (int n = 0; n < d; n++) {
        const double new = velocity[n], old = c->last[n];
        was += old * old;
        now += new * new;
        change += (new - old) * (new - old);
    }
    was = sqrt(was), now = sqrt(now), change = sqrt(change);
    if (late && was > 0.0) {
        double coast = period - r->dt > 0.0 ? period - r->dt : 0.0;
        if (was / r->a_max < coast) coast = was / r->a_max;
        held = r->dt + coast - 0.5 * r->a_max * coast * coast / was;
    }
    for (int n = 0; n < d; n++) c->at[n] += c->last[n] * held;
    if (!(now <= r->v_max + SLACK)) verdict = TOO_FAST; /* also when it is not a number */
    else if (!(change <= gain + SLACK)) verdict = TOO_SUDDEN;
    for (int n = 0; n < d && !verdict && now > was - gain + SLACK; n++) {
        const double new = velocity[n], stop = c->at[n] + new * now / (2.0 * r->a_max);
        if ((stop > r->high[n] + SLACK && new > 0.0) || (stop < r->low[n] - SLACK && new < 0.0)) verdict = NO_ROOM;
    }
    if (verdict) {
        const double left = was > 0.0 ? (was - gain > 0.0 ? was - gain : 0.0) / was : 0.0;
        for (int n = 0; n < d; n++) velocity[n] = c->last[n] * left;
    }
    for (int n = 0; n < d; n++) c->last[n] = velocity[n];
    return verdict;
}
