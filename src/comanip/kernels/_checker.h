/* safety/checker.py once more: the second opinion on every command, with own memory. It shares no function with _envelope.h. */

typedef struct { double v_max, a_max, dt, low[MOST_AXES], high[MOST_AXES]; } Rules;

typedef struct { double at[MOST_AXES], last[MOST_AXES]; } Commanded;

#define SLACK 1e-9

/* 1, with `c` moved on, when `velocity` after a timely period breaks no rule. */
static int allowed(const Rules *r, Commanded *c, int d, double period, const double *velocity) {
    const double gain = r->a_max * (period < r->dt ? r->dt : period);
    Commanded next = *c;
    for (int n = 0; n < d; n++) {
        const double new = velocity[n], old = c->last[n];
        next.at[n] += old * period;
        next.last[n] = new;
        if (!(-r->v_max - SLACK <= new && new <= r->v_max + SLACK)) return 0; /* also when it is not a number */
        if (!(old - gain - SLACK <= new && new <= old + gain + SLACK)) return 0;
        const double stop = next.at[n] + new * fabs(new) / (2.0 * r->a_max);
        if (stop > r->high[n] + SLACK && new > 0.0 && new > old - gain + SLACK) return 0;
        if (stop < r->low[n] - SLACK && new < 0.0 && new < old + gain - SLACK) return 0;
    }
    *c = next;
    return 1;
}
