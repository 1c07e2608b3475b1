/* Arithmetic on a few axes in plain order, as in signals/vectors.py. Nothing here or in what is built on it allocates, keeps anything
 * of its own, or calls more of <math.h> than sqrt and fabs: it compiles as C99 anywhere, and `comanip export` writes it out.
 */

#define MOST_AXES 6
#define PI 3.14159265358979323846
#define ABSURD 1e6 /* no robot is so far away, so fast or so strong, in any unit */

typedef double Axes[MOST_AXES];

static inline double least(double a, double b) { return b < a ? b : a; }
static inline double most(double a, double b) { return b > a ? b : a; }
static inline double within(double x, double low, double high) { return least(most(x, low), high); }

static inline double dot(const double *a, const double *b, int d) {
    double sum = 0.0;
    for (int i = 0; i < d; i++) sum += a[i] * b[i];
    return sum;
}

static inline double length(const double *a, int d) { return sqrt(dot(a, a, d)); }

static inline double apart(const double *a, const double *b, int d) {
    double total = 0.0;
    for (int i = 0; i < d; i++) total += (a[i] - b[i]) * (a[i] - b[i]);
    return sqrt(total);
}

static inline void copy(double *to, const double *from, int n) {
    for (int i = 0; i < n; i++) to[i] = from[i];
}

static inline void fill(double *to, double value, int n) {
    for (int i = 0; i < n; i++) to[i] = value;
}

static inline int is_finite(double x) { return x - x == 0.0; }

static inline int all_finite(const double *a, int d) {
    for (int i = 0; i < d; i++)
        if (!is_finite(a[i])) return 0;
    return 1;
}
