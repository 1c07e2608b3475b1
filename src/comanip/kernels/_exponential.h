/* exp and log by a fixed sequence of IEEE operations, as in signals/exponential.py: those of <math.h> differ in the last bit from one
 * C library to the next, and a robot's tick shall be the same everywhere. Both are within one unit in the last place.
 */

#define LN2_HIGH 6.93147180369123816490e-01 /* ln 2, of which k multiples are exact, and what is left of it */
#define LN2_LOW 1.90821492927058770002e-10
#define PER_LN2 1.44269504088896338700e+00
#define ROUNDS 6755399441055744.0 /* 1.5 * 2^52: added and taken off, it leaves the nearest whole number */
#define SQRT_HALF 0.70710678118654752440

typedef union { double number; unsigned long long bits; } Bits;

static inline double power_of_two(int k) { /* of a normal number */
    Bits b;
    b.bits = (unsigned long long)(k + 1023) << 52;
    return b.number;
}

static inline double exponential(double x) {
    if (!(x > -745.2)) return x != x ? x : 0.0;
    if (x > 709.8) return INFINITY;
    const double times = (x * PER_LN2 + ROUNDS) - ROUNDS, high = x - times * LN2_HIGH, low = times * LN2_LOW;
    const double r = high - low, lost = (high - r) - low, r2 = r * r, r4 = r2 * r2;
    const double first = (1.0 / 2.0 + r * (1.0 / 6.0)) + r2 * (1.0 / 24.0 + r * (1.0 / 120.0));
    const double second = (1.0 / 720.0 + r * (1.0 / 5040.0)) + r2 * (1.0 / 40320.0 + r * (1.0 / 362880.0));
    const double third = (1.0 / 3628800.0 + r * (1.0 / 39916800.0)) + r2 * (1.0 / 479001600.0 + r * (1.0 / 6227020800.0));
    const double y = 1.0 + (r + (r2 * (first + r4 * (second + r4 * third)) + lost));
    const int k = (int)times;
    if (k > 1023) return y * power_of_two(1023) * power_of_two(k - 1023);
    if (k < -1022) return y * power_of_two(k + 64) * power_of_two(-64); /* rounded once, into what is left of its digits */
    return y * power_of_two(k);
}

static inline double logarithm(double x) {
    if (!(x > 0.0)) return x == 0.0 ? -INFINITY : NAN;
    if (x == INFINITY) return x;
    int k = -1022;
    if (x < 2.2250738585072014e-308) x *= 18014398509481984.0, k -= 54; /* 2^54, or it has no exponent of its own */
    Bits b;
    b.number = x;
    k += (int)(b.bits >> 52);
    b.bits = (b.bits & 0xfffffffffffffULL) | 0x3fe0000000000000ULL; /* in [0.5, 1) */
    if (b.number < SQRT_HALF) b.number *= 2.0, k--;
    const double f = b.number - 1.0, s = f / (2.0 + f), z = s * s, half = 0.5 * f * f;
    const double near = 2.0 / 3.0 + z * (2.0 / 5.0 + z * (2.0 / 7.0 + z * (2.0 / 9.0 + z * (2.0 / 11.0))));
    const double far = 2.0 / 13.0 + z * (2.0 / 15.0 + z * (2.0 / 17.0 + z * (2.0 / 19.0 + z * (2.0 / 21.0))));
    const double rest = z * (near + z * z * z * z * z * far);
    return k * LN2_HIGH - ((half - (s * (half + rest) + k * LN2_LOW)) - f);
}
