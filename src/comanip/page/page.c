/* The page's world: a person's hand on the handle, the exact beam, the robot behind it; and the force estimate of loop and page.
 *
 * The beam is kernels/_beam.h itself; what the robot does with a learned skill is behind `skill_*` (robot.h). The rest is written
 * twice: page/person.py has the same operations in the same order, and a test holds the two together. Nothing here draws or waits:
 * whoever calls `page_advance` says how many milliseconds have passed.
 */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define MOST_AXES 6
#define PI 3.14159265358979323846
#include "../kernels/_layout.h"
#include "../kernels/_beam.h"

#define EXPORT(name) __attribute__((export_name(#name))) name

enum { MOST_LATE = 64, MOST_FILTERED = 16 };

/* One number each; the page and Python know them by these names, see `page_names`. */
#define NUMBERS(X) \
    X(axes) X(dt_s) X(step_s) X(mass_kg) X(length_m) X(wrist_stiffness_nm_per_rad) X(wrist_damping_nms_per_rad) X(actuator_lag_s) \
    X(noise_n) X(bias_n) X(delay_s) X(expected_delay_s) X(stated_mass_kg) X(share) X(seed) \
    X(hand_n_per_m) X(hand_ns_per_m) X(hand_kg) X(hand_cap_n) X(grip_n_per_m) X(grip_ns_per_m) X(smooth_s) X(grip_s) \
    X(robot) X(robot_kg) X(robot_ns_per_m) X(robot_attraction_per_s) X(robot_onset_s) X(robot_duration_s) X(v_max_m_per_s) X(a_max_m_per_s2) \
    X(holds) X(time_s) X(ticks) X(grip) X(payload_kg) \
    X(mode) X(reason) X(reason_value) X(passes) X(acts) X(tank_j) X(confidence) X(phase_s) X(clock_rate) X(blend)
/* One number an axis. `position` to `force` are what the robot knows at its last tick, `hand_*` and `end_*` are true now. */
#define VECTORS(X) \
    X(gravity) X(axial) X(start) X(moves_m) X(pointer) X(aim) X(aim_speed) X(place) X(place_speed) X(stretch_n) X(pull_n) \
    X(position) X(velocity) X(sensor_force) X(force) X(true_force) X(tilt) X(expected_force) X(command_position) X(command_velocity) \
    X(command_acceleration) X(end_position) X(end_velocity) X(carried_n)

#define A_NUMBER(name) double name;
#define A_VECTOR(name) double name[MOST_AXES];
#define A_NAME(name) #name " "

enum { ROBOT_SKILL, ROBOT_MASS_DAMPER, ROBOT_PLANNED, ROBOT_HOLDS };

typedef struct { /* TaringInteractionForce and CausalInteractionForce, of finite numbers */
    int ticks, left, count, begun, late, averages;
    double sum[MOST_AXES], blend, mass, offset[MOST_AXES], velocity[MOST_AXES], force[MOST_AXES];
    int known[MOST_AXES], filtering[MOST_AXES];
    double past[MOST_AXES][MOST_FILTERED];
    double b0, b1, b2, a1, a2, s1[MOST_AXES], s2[MOST_AXES];
} Estimate;

typedef struct {
    NUMBERS(A_NUMBER)
    VECTORS(A_VECTOR)
    Beam beam;
    Estimate estimate;
    double line[MOST_AXES][MOST_LATE], total[MOST_AXES], reference[MOST_AXES], compliance[MOST_AXES];
    int substeps, substep;
    uint64_t noise;
    double *numbers; /* of the skill, and its memory */
    void *skill;
} World;

#include "robot.h"

/* person.noise: splitmix64, and the sum of twelve uniform numbers less six, which every machine adds up to the same bits. */
static double uniform(uint64_t *state) {
    uint64_t z = *state += 0x9e3779b97f4a7c15u;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return (double)((z ^ z >> 31) >> 11) * 0x1p-53;
}

static double normal(uint64_t *state) {
    double sum = 0.0;
    for (int n = 0; n < 12; n++) sum += uniform(state);
    return sum - 6.0;
}

/* signals.second_order.second_order_step of the beam on its wrist */
static void solve(Wrist *w, double k, double c, double h) {
    const double a = 0.5 * c, w2 = k - a * a;
    double co, si;
    if (w2 > 1e-12) {
        const double r = sqrt(w2);
        co = exp(-a * h) * cos(r * h), si = exp(-a * h) * sin(r * h) / r;
    } else if (w2 < -1e-12) {
        const double r = sqrt(-w2);
        co = exp(-a * h) * cosh(r * h), si = exp(-a * h) * sinh(r * h) / r;
    } else co = exp(-a * h), si = h * exp(-a * h);
    const double yu = k * h * h > 1e-6 ? (1.0 - co - a * si) / k : c * h > 1e-6 ? (h + expm1(-c * h) / c) / c : 0.5 * h * h;
    w->yy = co + a * si, w->yv = si, w->yu = yu, w->vy = -k * si, w->vv = co - a * si, w->vu = si;
}

static void lowpass(Estimate *e, double cutoff_hz, double dt) {
    const double k = tan(PI * cutoff_hz * dt), norm = 1.0 / (1.0 + sqrt(2.0) * k + k * k);
    e->b0 = k * k * norm, e->b1 = 2.0 * e->b0, e->b2 = e->b0;
    e->a1 = 2.0 * (k * k - 1.0) * norm, e->a2 = (1.0 - sqrt(2.0) * k + k * k) * norm;
}

static void estimate_begin(World *w) {
    Estimate *e = &w->estimate;
    memset(e, 0, sizeof *e);
    e->ticks = e->left = (int)nearbyint(0.25 / w->dt_s);
    const double delay = w->expected_delay_s + 0.5 * w->dt_s;
    e->averages = delay < 0.5 * w->dt_s;
    const double wait = (e->averages ? delay : delay - 0.5 * w->dt_s) / w->dt_s;
    e->late = (int)wait, e->blend = wait - e->late;
    lowpass(e, fmin(40.0, 0.4 / w->dt_s), w->dt_s);
}

/* TaringInteractionForce._weighed */
static void weighed(World *w) {
    Estimate *e = &w->estimate;
    double g2 = 0.0, along = 0.0, bias[MOST_AXES] = {0};
    e->mass = w->stated_mass_kg;
    for (int i = 0; i < w->axes; i++) g2 += w->gravity[i] * w->gravity[i];
    if (e->count >= 3 && g2 > 0.0) {
        for (int i = 0; i < w->axes; i++) along += e->sum[i] / e->count * w->gravity[i];
        along /= g2;
        e->mass = fmax(along / w->share, 0.0);
        for (int i = 0; i < w->axes; i++) bias[i] = e->sum[i] / e->count - w->share * e->mass * w->gravity[i];
    }
    w->payload_kg = e->mass;
    for (int i = 0; i < w->axes; i++) e->offset[i] = -(w->share * e->mass) * w->gravity[i] - bias[i];
    e->begun = 1;
}

static void estimate_step(World *w) {
    Estimate *e = &w->estimate;
    if (!e->begun) {
        int rests = 1;
        for (int i = 0; i < w->axes; i++) rests &= fabs(w->velocity[i]) < 0.01;
        e->left--;
        if (e->left >= 0 && rests) {
            for (int i = 0; i < w->axes; i++) e->sum[i] += w->sensor_force[i], w->force[i] = 0.0;
            e->count++;
            return;
        }
        weighed(w);
    }
    for (int i = 0; i < w->axes; i++) {
        double *past = e->past[i], force = w->sensor_force[i];
        const double before = force, a = e->known[i] ? (w->velocity[i] - e->velocity[i]) / w->dt_s : 0.0;
        memmove(past + 1, past, sizeof *past * (e->late + 1));
        past[0] = a;
        const double acceleration = past[e->late] + e->blend * (past[e->late + 1] - past[e->late]);
        if (e->averages && e->known[i]) force = 0.5 * (force + e->force[i]);
        e->velocity[i] = w->velocity[i], e->force[i] = before, e->known[i] = 1;
        const double value = force + w->share * e->mass * acceleration + e->offset[i];
        if (!e->filtering[i]) e->filtering[i] = 1, e->s1[i] = value * (1.0 - e->b0), e->s2[i] = value * (e->b2 - e->a2);
        const double out = e->b0 * value + e->s1[i];
        e->s1[i] = e->b1 * value - e->a1 * out + e->s2[i];
        e->s2[i] = e->b2 * value - e->a2 * out;
        w->force[i] = out;
    }
}

/* BeamPlant.read */
static void read_sensors(World *w) {
    for (int i = 0; i < w->axes; i++) {
        const End *e = &w->beam.ends[i];
        w->position[i] = e->position, w->velocity[i] = e->velocity, w->tilt[i] = e->tilt;
        w->sensor_force[i] = e->sampled + w->bias_n + w->noise_n * normal(&w->noise);
        w->true_force[i] = e->sensor_force + 0.5 * w->mass_kg * (w->beam.along[i].gravity + e->acceleration);
    }
}

/* baselines.MassDamper, and a robot with a plan of its own that gives way: what stands in where no skill runs */
static void plain_robot(World *w) {
    double wanted[MOST_AXES], changed = 0.0, speed = 0.0, unit[3];
    const double t = w->time_s - w->robot_onset_s, planned = w->robot == ROBOT_PLANNED && t > 0.0;
    minimum_jerk(t / w->robot_duration_s, unit);
    estimate_step(w);
    for (int i = 0; i < w->axes; i++) {
        w->compliance[i] = (w->robot_kg * w->compliance[i] + w->dt_s * w->force[i]) / (w->robot_kg + w->dt_s * w->robot_ns_per_m);
        wanted[i] = w->robot == ROBOT_HOLDS ? 0.0 : w->compliance[i];
        if (planned) {
            const double aim = w->start[i] + w->moves_m[i] * unit[0];
            wanted[i] += w->moves_m[i] * unit[1] / w->robot_duration_s + w->robot_attraction_per_s * (aim - w->position[i]);
        } else if (w->robot == ROBOT_PLANNED) wanted[i] = 0.0;
        speed += wanted[i] * wanted[i];
    }
    speed = sqrt(speed);
    for (int i = 0; i < w->axes; i++) {
        if (speed > w->v_max_m_per_s) wanted[i] *= w->v_max_m_per_s / speed;
        changed += (wanted[i] - w->command_velocity[i]) * (wanted[i] - w->command_velocity[i]);
    }
    const double most = w->a_max_m_per_s2 * w->dt_s, share = sqrt(changed) > most ? most / sqrt(changed) : 1.0;
    for (int i = 0; i < w->axes; i++) {
        w->command_velocity[i] += (wanted[i] - w->command_velocity[i]) * share;
        w->command_position[i] = w->position[i] + w->dt_s * w->command_velocity[i];
    }
}

/* person.Handle.force: the pointer pulls the hand through a capped spring, the hand's mass pulls the object through its grip. */
static void hand(World *w) {
    const double h = w->step_s, mix = h / w->smooth_s;
    double stretch[MOST_AXES], size = 0.0;
    w->grip += fmin(fmax(w->holds - w->grip, -h / w->grip_s), h / w->grip_s);
    for (int i = 0; i < w->axes; i++) {
        const double before = w->aim[i];
        w->aim[i] += mix * (w->pointer[i] - w->aim[i]);
        w->aim_speed[i] = (w->aim[i] - before) / h;
        stretch[i] = w->hand_n_per_m * (w->aim[i] - w->place[i]) + w->hand_ns_per_m * (w->aim_speed[i] - w->place_speed[i]);
        size += stretch[i] * stretch[i];
    }
    size = sqrt(size);
    for (int i = 0; i < w->axes; i++) {
        const double far = w->beam.ends[i].far_position, speed = w->beam.ends[i].far_velocity;
        if (size > w->hand_cap_n) stretch[i] *= w->hand_cap_n / size;
        const double grips = w->grip * (w->grip_n_per_m * (w->place[i] - far) + w->grip_ns_per_m * (w->place_speed[i] - speed));
        w->stretch_n[i] = stretch[i];
        w->place_speed[i] += h * (stretch[i] - grips) / w->hand_kg;
        w->place[i] += h * w->place_speed[i];
        w->pull_n[i] = grips + w->grip * w->carried_n[i];
    }
}

/* BeamPlant.advance, a sub-step of it */
static void move(World *w) {
    hand(w);
    for (int i = 0; i < w->axes; i++) {
        End *e = &w->beam.ends[i];
        e->pull = w->pull_n[i];
        carry(&w->beam, i, w->command_velocity[i]);
        e->line[e->next] = e->sensor_force;
        e->next = (e->next + 1) % (w->beam.sensor_late + 1);
        w->total[i] += e->line[e->next];
        w->end_position[i] = e->far_position, w->end_velocity[i] = e->far_velocity;
    }
    if (++w->substep < w->substeps) return;
    for (int i = 0; i < w->axes; i++) w->beam.ends[i].sampled = w->total[i] / w->substeps, w->total[i] = 0.0;
    w->substep = 0, w->time_s += w->dt_s, w->ticks += 1.0;
    read_sensors(w);
}

/* ------------------------------------------------------------------------------------------------ for page and Python */

const char *EXPORT(page_names)(void) { return NUMBERS(A_NAME) "|" VECTORS(A_NAME); }
int EXPORT(page_most_axes)(void) { return MOST_AXES; }
double *EXPORT(page_room)(int numbers) { return calloc(numbers > 0 ? numbers : 1, sizeof(double)); }
World *EXPORT(page_new)(void) { return calloc(1, sizeof(World)); }
void EXPORT(page_free)(World *w) { skill_free(w), free(w); }

/* Takes a skill's numbers, which stay the caller's; 0, or why not (robot.h). */
int EXPORT(page_skill)(World *w, double *numbers, int n) { return skill_take(w, numbers, n); }

/* From rest at `start`, held by both; 0 where a number is not allowed. Everything but what was set before is forgotten. */
int EXPORT(page_begin)(World *w) {
    const int d = (int)w->axes;
    if (d < 1 || d > MOST_AXES || !(w->dt_s > 0.0) || !(w->step_s > 0.0) || !(w->mass_kg > 0.0) || !(w->hand_kg > 0.0)) return 0;
    Beam *b = &w->beam;
    w->substeps = (int)nearbyint(w->dt_s / w->step_s), w->substep = 0;
    const int late = (int)nearbyint(w->delay_s / w->step_s);
    if (w->substeps < 1 || late < 0 || late >= MOST_LATE) return 0;
    *b = (Beam){.d = d, .substeps = w->substeps, .sensor_late = late};
    Wrist *wrist = &b->wrist;
    wrist->mass = w->mass_kg, wrist->length = w->length_m, wrist->lag = w->actuator_lag_s, wrist->step = w->step_s;
    wrist->wrist_stiffness = w->wrist_stiffness_nm_per_rad, wrist->wrist_damping = w->wrist_damping_nms_per_rad;
    wrist->inertia = w->mass_kg * (w->length_m * w->length_m) / 3.0;
    wrist->decay = exp(-w->step_s / w->actuator_lag_s);
    solve(wrist, w->wrist_stiffness_nm_per_rad / wrist->inertia, w->wrist_damping_nms_per_rad / wrist->inertia, w->step_s);
    w->noise = (uint64_t)w->seed;
    w->time_s = w->ticks = 0.0, w->grip = w->holds;
    for (int i = 0; i < d; i++) {
        End *e = &b->ends[i];
        *e = (End){0};
        b->along[i] = (Along){.axial = w->axial[i], .gravity = 0.0 - w->gravity[i], .start = w->start[i]};
        e->position = e->far_position = w->start[i];
        e->sensor_force = w->axial[i] != 0.0 ? 0.0 : -0.5 * w->mass_kg * b->along[i].gravity;
        e->line = w->line[i], e->sampled = e->sensor_force;
        for (int n = 0; n <= late; n++) e->line[n] = e->sensor_force;
        w->carried_n[i] = -(1.0 - w->share) * w->mass_kg * w->gravity[i];
        w->pointer[i] = w->aim[i] = w->place[i] = w->end_position[i] = w->start[i];
        w->aim_speed[i] = w->place_speed[i] = w->stretch_n[i] = w->end_velocity[i] = 0.0;
        w->pull_n[i] = w->carried_n[i];
        w->total[i] = w->compliance[i] = w->force[i] = w->expected_force[i] = 0.0;
        w->command_velocity[i] = w->command_acceleration[i] = 0.0, w->command_position[i] = w->start[i];
    }
    w->mode = w->reason = w->passes = w->acts = w->phase_s = w->clock_rate = w->blend = 0.0, w->confidence = 1.0;
    estimate_begin(w);
    read_sensors(w);
    skill_begin(w);
    return 1;
}

/* So many sub-steps; the robot's tick comes before the first of each period, as in loop.run. */
void EXPORT(page_advance)(World *w, int substeps) {
    for (int n = 0; n < substeps; n++) {
        if (w->substep == 0) {
            if (w->robot == ROBOT_SKILL && w->skill) skill_tick(w);
            else plain_robot(w);
        }
        move(w);
    }
}

/* The robot runs again after a HOLD; 0, or the number of the reason why not. */
int EXPORT(page_rearm)(World *w) { return w->skill ? skill_rearm_world(w) : 0; }
const char *EXPORT(page_reason)(int reason) { return skill_reason(reason); }
int EXPORT(page_shown)(World *w, int what, double *out) { return skill_shown(w, what, out); }

/* A whole trace (n, axes) of the pointer, one row a sub-step, and what came of it: rows of `width` at each tick. For tests. */
int EXPORT(page_replay)(World *w, const double *trace, int n, double *rows) {
    const int d = (int)w->axes;
    int ticks = 0;
    for (int at = 0; at < n; at++) {
        memcpy(w->pointer, trace + at * d, sizeof(double) * d);
        const int first = w->substep == 0;
        page_advance(w, 1);
        if (!first) continue;
        double *row = rows + ticks++ * 5 * d;
        for (int i = 0; i < d; i++) {
            row[i] = w->position[i], row[d + i] = w->velocity[i], row[2 * d + i] = w->sensor_force[i];
            row[3 * d + i] = w->force[i], row[4 * d + i] = w->command_velocity[i];
        }
    }
    return ticks;
}
