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

#include "../kernels/_layout.h"
#include "../kernels/_exponential.h"
#include "../kernels/_vectors.h"
#include "../kernels/_path.h"
#include "../kernels/_foresight.h"
#include "../kernels/_filter.h"
#define TICK(law, filter, xi) filter_tick(filter, xi)
#include "../kernels/_law.h"
#include "../kernels/_enter.h"
#include "../kernels/_roles.h"
#include "../kernels/_checker.h"
#include "../kernels/_envelope.h"
#include "../kernels/_guard.h"
#include "../kernels/_estimate.h"
#include "../kernels/_whole.h"
#include "../kernels/_beam.h"

#define EXPORT(name) __attribute__((export_name(#name))) name

enum { MOST_LATE = 64, MOST_FILTERED = 16 };

/* One number each; the page and Python know them by these names, see `page_names`. */
#define WORLD_NUMBERS(X) \
    X(axes) X(dt_s) X(step_s) X(mass_kg) X(length_m) X(wrist_stiffness_nm_per_rad) X(wrist_damping_nms_per_rad) X(actuator_lag_s) \
    X(noise_n) X(bias_n) X(delay_s) X(expected_delay_s) X(stated_mass_kg) X(share) X(seed) \
    X(hand_n_per_m) X(hand_ns_per_m) X(hand_kg) X(hand_cap_n) X(grip_n_per_m) X(grip_ns_per_m) X(smooth_s) X(hand_m_per_s) X(grip_s) \
    X(robot) X(robot_kg) X(robot_ns_per_m) X(robot_attraction_per_s) X(plan_runs) X(v_max_m_per_s) X(a_max_m_per_s2) \
    X(holds) X(time_s) X(ticks) X(grip) X(payload_kg) \
    X(mode) X(reason) X(reason_value) X(passes) X(acts) X(tank_j) X(confidence) X(phase_s) X(clock_rate) X(blend)
/* One number an axis. `position` to `force` are what the robot knows at its last tick, `hand_*` and `end_*` are true now; `plan_*` is
 * where a robot with a plan means to be, which the page says before each tick. */
#define WORLD_VECTORS(X) \
    X(gravity) X(axial) X(start) X(plan_position) X(plan_velocity) X(pointer) X(drawn) X(aim) X(aim_speed) X(place) X(place_speed) X(stretch_n) X(pull_n) \
    X(position) X(velocity) X(sensor_force) X(force) X(true_force) X(tilt) X(expected_force) X(command_position) X(command_velocity) \
    X(command_acceleration) X(end_position) X(end_velocity) X(carried_n)

#define A_NUMBER(name) double name;
#define A_VECTOR(name) double name[MOST_AXES];
#define A_NAME(name) #name " "

enum { ROBOT_SKILL, ROBOT_MASS_DAMPER, ROBOT_PLANNED, ROBOT_HOLDS };

typedef struct {
    WORLD_NUMBERS(A_NUMBER)
    WORLD_VECTORS(A_VECTOR)
    Beam beam;
    Weighing weighing; /* for robots without a skill; a skill has its own */
    Weighed estimate;
    double past[MOST_AXES * MOST_FILTERED];
    double line[MOST_AXES][MOST_LATE], total[MOST_AXES], reference[MOST_AXES], compliance[MOST_AXES];
    int substeps, substep;
    uint64_t noise;
    struct Robot *robot_with_skill;
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

/* The estimate of a robot without a skill: interaction.TaringInteractionForce as loop and trials make it */
static void estimate_begin(World *w) {
    Weighing *e = &w->weighing;
    const double delay = w->expected_delay_s + 0.5 * w->dt_s, k = tan(PI * least(40.0, 0.4 / w->dt_s) * w->dt_s);
    const double norm = 1.0 / (1.0 + sqrt(2.0) * k + k * k);
    *e = (Weighing){.dt = w->dt_s, .mass = w->stated_mass_kg, .share = w->share, .moving = 0.01, .d = (int)w->axes};
    e->ticks = (int)nearbyint(0.25 / w->dt_s), e->average = delay < 0.5 * w->dt_s;
    const double wait = (e->average ? delay : delay - 0.5 * w->dt_s) / w->dt_s;
    e->late = (int)wait < MOST_FILTERED - 2 ? (int)wait : MOST_FILTERED - 2, e->blend = wait - e->late;
    e->b0 = k * k * norm, e->b1 = 2.0 * e->b0, e->b2 = e->b0;
    e->a1 = 2.0 * (k * k - 1.0) * norm, e->a2 = (1.0 - sqrt(2.0) * k + k * k) * norm;
    copy(e->gravity, w->gravity, e->d);
    estimate_reset(e, &w->estimate);
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
    double wanted[MOST_AXES], changed = 0.0, speed = 0.0;
    estimate(&w->weighing, &w->estimate, w->past, w->velocity, w->sensor_force, w->force);
    w->payload_kg = w->estimate.payload;
    for (int i = 0; i < w->axes; i++) {
        w->compliance[i] = (w->robot_kg * w->compliance[i] + w->dt_s * w->force[i]) / (w->robot_kg + w->dt_s * w->robot_ns_per_m);
        wanted[i] = w->robot == ROBOT_HOLDS ? 0.0 : w->compliance[i];
        if (w->robot == ROBOT_PLANNED && w->plan_runs == 0.0) wanted[i] = 0.0;
        else if (w->robot == ROBOT_PLANNED) wanted[i] += w->plan_velocity[i] + w->robot_attraction_per_s * (w->plan_position[i] - w->position[i]);
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

/* person.Handle.force: the pointer, no faster than a hand goes, pulls the hand through a capped spring, the hand's mass pulls the object through its grip. */
static void hand(World *w) {
    const double h = w->step_s, mix = h / w->smooth_s;
    double stretch[MOST_AXES], size = 0.0, far = 0.0;
    for (int i = 0; i < w->axes; i++) far += (w->pointer[i] - w->drawn[i]) * (w->pointer[i] - w->drawn[i]);
    const double asked = mix * sqrt(far), share = asked > w->hand_m_per_s * h ? w->hand_m_per_s * h / asked : 1.0;
    w->grip += fmin(fmax(w->holds - w->grip, -h / w->grip_s), h / w->grip_s);
    for (int i = 0; i < w->axes; i++) {
        const double before = w->aim[i];
        w->drawn[i] += share * mix * (w->pointer[i] - w->drawn[i]);
        w->aim[i] += mix * (w->drawn[i] - w->aim[i]);
        w->aim_speed[i] = (w->aim[i] - before) / h;
        stretch[i] = w->hand_n_per_m * (w->aim[i] - w->place[i]) + w->hand_ns_per_m * (w->aim_speed[i] - w->place_speed[i]);
        size += stretch[i] * stretch[i];
    }
    size = sqrt(size);
    for (int i = 0; i < w->axes; i++) {
        const double end = w->beam.ends[i].far_position, speed = w->beam.ends[i].far_velocity;
        if (size > w->hand_cap_n) stretch[i] *= w->hand_cap_n / size;
        const double grips = w->grip * (w->grip_n_per_m * (w->place[i] - end) + w->grip_ns_per_m * (w->place_speed[i] - speed));
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


const char *EXPORT(page_names)(void) { return WORLD_NUMBERS(A_NAME) "|" WORLD_VECTORS(A_NAME); }
int EXPORT(page_most_axes)(void) { return MOST_AXES; }
double *EXPORT(page_room)(int numbers) { return calloc(numbers > 0 ? numbers : 1, sizeof(double)); }
void EXPORT(page_drop)(double *room) { free(room); }
World *EXPORT(page_new)(void) { return calloc(1, sizeof(World)); }
void EXPORT(page_free)(World *w) { skill_free(w), free(w); }

/* Takes a skill's numbers, which stay where they are; 0, or why not (robot.h). */
int EXPORT(page_skill)(World *w, const double *numbers, int n) { return skill_take(w, numbers, n); }

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
        w->pointer[i] = w->drawn[i] = w->aim[i] = w->place[i] = w->end_position[i] = w->start[i];
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
            if (w->robot == ROBOT_SKILL && w->robot_with_skill) skill_tick(w);
            else plain_robot(w);
        }
        move(w);
    }
}

/* The robot runs again after a HOLD; 0, or the number of the reason why not. */
int EXPORT(page_rearm)(World *w) { return w->robot_with_skill ? skill_rearm(w) : 0; }
const char *EXPORT(page_reason)(int reason) { return skill_reason(reason); }
int EXPORT(page_shown)(World *w, int what, double *out) { return skill_shown(w, what, out); }

/* A whole trace: rows of the pointer (axes) and whether it holds, one a sub-step; a negative `holds` asks to go on after a HOLD. What
 * came of it, one row a tick: position, velocity, sensor, estimate, commanded velocity (axes each), mode, tank, reason. For tests. */
int EXPORT(page_replay)(World *w, const double *trace, int n, double *rows) {
    const int d = (int)w->axes;
    int ticks = 0;
    for (int at = 0; at < n; at++, trace += d + 1) {
        const int first = w->substep == 0;
        copy(w->pointer, trace, d);
        w->holds = fabs(trace[d]);
        if (first && trace[d] < 0.0) (void)page_rearm(w);
        page_advance(w, 1);
        if (!first) continue;
        const double *const shown[] = {w->position, w->velocity, w->sensor_force, w->force, w->command_velocity};
        for (int k = 0; k < 5; k++, rows += d) copy(rows, shown[k], d);
        *rows++ = w->mode, *rows++ = w->tank_j, *rows++ = w->reason;
        ticks++;
    }
    return ticks;
}
