/* One run of plant and pd_ddob in plain C: the arithmetic of the project's step functions, operation
   by operation, with the steering's guard, actuator, disturbances, path, noise, limits and the
   resolution of the wire. It is what the compiled batch is measured against, and has to give the
   same bits (no fast-math, no contraction). Only the controller's mode is always ACTIVE. */

#include <math.h>
#include <stdint.h>

#include "steering_guard.h"

enum { DIGIT_BITS = 12, DIGIT_VALUES = 1 << DIGIT_BITS, ROW = 32 };

typedef struct { double b0, b1, b2, a1, a2; } Section;
typedef struct { double x1, x2; } SectionState;

typedef struct {
    Section compensator;
    Section dob_command[2], dob_error[3];
    Section cdob_command, cdob_error[2], cdob_compensation[2];
} Law;

typedef struct {
    SectionState compensator;
    SectionState dob_command[2], dob_error[3];
    SectionState cdob_command, cdob_error[2], cdob_compensation[2];
    double disturbance_rad;
} LawState;

enum { HELD, RAMPING, SETTLING };

#define NEVER_NS INT64_MAX

typedef struct { int64_t start_ns; double w_beta, w_r, friction; } Interval;

typedef struct {
    double speed_m_s, lag_s, angle_limit_rad, rate_limit_rad_s, dead_band_rad;
    double steer_rad_max, step_rad_max, ramp_step_rad, error_resolution_m, error_m_max;
    double steer_resolution_rad, path_length_m;
    int64_t motion_start_ns, end_ns;
    int64_t pieces, closed, intervals, ticks, commands, samples;
} Run;

typedef struct {
    const double *table, *start_m, *curvature_1_m, *slope_1_m2;
    const int64_t *first_rows;
    const Interval *intervals;
} Rig;

typedef struct { double beta, r, psi, y, delta, delta_rate, rho, rho_rate, w_beta, w_r; } Linear;

typedef struct {
    Linear z;
    double goal_rad;
    int64_t phase, clipped, time_ns, wheel_end_ns, place_end_ns, interval_end_ns;
    int64_t piece, lap, interval;
} Motion;

static double section_step(const Section *p, SectionState *x, double u)
{
    double y = p->b0 * u + x->x1;
    double x1 = p->b1 * u - p->a1 * y + x->x2;
    x->x2 = p->b2 * u - p->a2 * y;
    x->x1 = x1;
    return y;
}

static double law_step(const Law *p, LawState *x, double error_m, double sent_rad, double *output)
{
    double demand_sent_rad = sent_rad + x->disturbance_rad;
    double v = section_step(&p->dob_command[0], &x->dob_command[0], sent_rad);
    double from_command = section_step(&p->dob_command[1], &x->dob_command[1], v);
    v = section_step(&p->dob_error[0], &x->dob_error[0], error_m);
    v = section_step(&p->dob_error[1], &x->dob_error[1], v);
    double from_error = section_step(&p->dob_error[2], &x->dob_error[2], v);
    double disturbance_rad = from_error - from_command;
    from_command = section_step(&p->cdob_command, &x->cdob_command, demand_sent_rad);
    v = section_step(&p->cdob_error[0], &x->cdob_error[0], error_m);
    from_error = section_step(&p->cdob_error[1], &x->cdob_error[1], v);
    double network_rad = from_command - from_error;
    v = section_step(&p->cdob_compensation[0], &x->cdob_compensation[0], network_rad);
    double feedback_m = error_m + section_step(&p->cdob_compensation[1], &x->cdob_compensation[1], v);
    double demand_rad = -section_step(&p->compensator, &x->compensator, feedback_m);
    x->disturbance_rad = disturbance_rad;
    output[0] = demand_rad - disturbance_rad;
    output[1] = disturbance_rad;
    output[2] = network_rad;
    output[3] = feedback_m;
    return output[0];
}

static void propagate(const double *table, Linear *z, int64_t dt_ns)
{
    double beta = z->beta, r = z->r, psi = z->psi, y = z->y, delta = z->delta;
    double delta_rate = z->delta_rate, rho = z->rho, rho_rate = z->rho_rate;
    double w_beta = z->w_beta, w_r = z->w_r;
    while (dt_ns > 0) {
        int64_t coarse = dt_ns >> DIGIT_BITS;
        const double *f;
        if (coarse == 0) {
            f = table + ROW * dt_ns;
            dt_ns = 0;
        } else {
            if (coarse >= DIGIT_VALUES)
                coarse = DIGIT_VALUES - 1;
            f = table + ROW * (DIGIT_VALUES + coarse);
            dt_ns -= coarse << DIGIT_BITS;
        }
        y = y + (f[20] * beta + f[21] * r + f[22] * psi) + (f[23] * delta + f[24] * delta_rate)
            + (f[25] * rho + f[26] * rho_rate) + (f[27] * w_beta + f[28] * w_r);
        psi = psi + (f[12] * beta + f[13] * r) + (f[14] * delta + f[15] * delta_rate)
            + (f[16] * rho + f[17] * rho_rate) + (f[18] * w_beta + f[19] * w_r);
        double new_beta = (f[0] * beta + f[1] * r) + (f[2] * delta + f[3] * delta_rate)
            + (f[4] * w_beta + f[5] * w_r);
        r = (f[6] * beta + f[7] * r) + (f[8] * delta + f[9] * delta_rate)
            + (f[10] * w_beta + f[11] * w_r);
        beta = new_beta;
        delta = delta + f[29] * delta_rate;
        delta_rate = f[30] * delta_rate;
        rho = rho + f[31] * rho_rate;
    }
    z->beta = beta, z->r = r, z->psi = psi, z->y = y;
    z->delta = delta, z->delta_rate = delta_rate, z->rho = rho;
}

static void coast(const Rig *rig, Motion *x, int64_t to_ns)
{
    const double *table = rig->table + ROW * rig->first_rows[3 * x->interval + x->phase];
    propagate(table, &x->z, to_ns - x->time_ns);
    x->time_ns = to_ns;
}

static void after_ramp(const Run *p, Motion *x, double wheel_rad, double goal_rad)
{
    if (p->lag_s > 0.0) {
        x->z.delta_rate = (goal_rad - wheel_rad) / p->lag_s;
        x->z.delta = wheel_rad;
        x->phase = SETTLING;
    } else {
        x->z.delta_rate = 0.0;
        x->z.delta = goal_rad;
        x->phase = HELD;
    }
    x->goal_rad = goal_rad;
    x->wheel_end_ns = NEVER_NS;
}

static void command_wheel(const Run *p, Motion *x, double steer_rad)
{
    double wheel_rad = x->z.delta, goal_rad = wheel_rad;
    double target = lesser(greater(steer_rad, -p->angle_limit_rad), p->angle_limit_rad);
    x->clipped = target != steer_rad;
    if (wheel_rad < target - p->dead_band_rad)
        goal_rad = target - p->dead_band_rad;
    else if (wheel_rad > target + p->dead_band_rad)
        goal_rad = target + p->dead_band_rad;
    double distance_rad = fabs(goal_rad - wheel_rad);
    if (p->rate_limit_rad_s == INFINITY || distance_rad <= p->rate_limit_rad_s * p->lag_s) {
        after_ramp(p, x, wheel_rad, goal_rad);
        return;
    }
    double ramp_s = distance_rad / p->rate_limit_rad_s - p->lag_s;
    x->z.delta = wheel_rad;
    x->z.delta_rate = copysign(p->rate_limit_rad_s, goal_rad - wheel_rad);
    x->phase = RAMPING;
    x->goal_rad = goal_rad;
    x->wheel_end_ns = x->time_ns + (int64_t)ceil(ramp_s * 1e9);
}

static void enter_place(const Run *p, const Rig *rig, Motion *x)
{
    x->z.rho = rig->curvature_1_m[x->piece];
    x->z.rho_rate = rig->slope_1_m2[x->piece] * p->speed_m_s;
    double end_m = INFINITY;
    if (x->piece + 1 < p->pieces)
        end_m = x->lap * p->path_length_m + rig->start_m[x->piece + 1];
    else if (p->closed)
        end_m = (x->lap + 1) * p->path_length_m;
    double end_s = end_m / p->speed_m_s;
    x->place_end_ns = end_s == INFINITY ? NEVER_NS : llrint(end_s * 1e9);
}

static void enter_interval(const Run *p, const Rig *rig, Motion *x, int64_t interval)
{
    x->interval = interval;
    x->z.w_beta = rig->intervals[interval].w_beta;
    x->z.w_r = rig->intervals[interval].w_r;
    int more = interval + 1 < p->intervals;
    x->interval_end_ns = more ? rig->intervals[interval + 1].start_ns : NEVER_NS;
}

static void advance(const Run *p, const Rig *rig, Motion *x, int64_t to_ns)
{
    for (;;) {
        int64_t event_ns = earlier(x->wheel_end_ns, earlier(x->place_end_ns, x->interval_end_ns));
        if (event_ns > to_ns)
            break;
        coast(rig, x, event_ns);
        if (x->wheel_end_ns == event_ns)
            after_ramp(p, x, x->z.delta, x->goal_rad);
        if (x->place_end_ns == event_ns) {
            if (x->piece + 1 < p->pieces) {
                x->piece++;
            } else {
                x->piece = 0;
                x->lap++;
            }
            enter_place(p, rig, x);
        }
        if (x->interval_end_ns == event_ns)
            enter_interval(p, rig, x, x->interval + 1);
    }
    coast(rig, x, to_ns);
}

static double ramp_step(double step_rad, double value_rad)
{
    if (value_rad > step_rad)
        return value_rad - step_rad;
    if (value_rad < -step_rad)
        return value_rad + step_rad;
    return 0.0;
}

/* Fills the arrays behind noise_m: seven of one entry a sample, two of one row a tick. */
void run_pair(const Run *p, const GuardParams *guard_params, const Law *law, const LawState *start, const Rig *rig, const int64_t *tick_ns,
              const int64_t *tick_sample, const int64_t *command_due_ns,
              const int64_t *command_tick, const int64_t *sample_ns, const double *noise_m,
              double *error_m, double *heading_rad, double *yaw_rate_rad_s, double *wheel_rad,
              double *curvature_1_m, double *measured_m, int64_t *in_effect, double *sent_rad,
              double *output)
{
    Motion x = {.wheel_end_ns = NEVER_NS};
    LawState state = *start;
    Guard guard = {.deadline_ns = guard_params->override_ns};
    double sent = 0.0, fade = 0.0;
    int64_t sample = 0, command = 0, followed = -1;
    enter_place(p, rig, &x);
    enter_interval(p, rig, &x, 0);
    for (int64_t tick = 0; tick <= p->ticks; tick++) {
        int64_t to_ns = tick < p->ticks ? tick_ns[tick] : p->end_ns;
        for (;;) {
            int64_t command_ns = to_ns + 1, next_sample_ns = to_ns + 1;
            if (command < p->commands && command_tick[command] < tick)
                command_ns = command_due_ns[command];
            if (sample < p->samples)
                next_sample_ns = sample_ns[sample];
            int64_t guard_ns = p->motion_start_ns + guard.deadline_ns;
            if (command_ns > to_ns && next_sample_ns > to_ns && guard_ns > to_ns)
                break;
            int64_t at_ns = command_ns <= next_sample_ns ? command_ns : next_sample_ns;
            int64_t motion_ns = at_ns > p->motion_start_ns ? at_ns - p->motion_start_ns : 0;
            if (command_ns <= next_sample_ns && command_ns <= guard_ns) {
                advance(p, rig, &x, motion_ns);
                double raw = rint(sent_rad[command_tick[command]] / p->steer_resolution_rad);
                if (guard_command(guard_params, &guard, raw * p->steer_resolution_rad, motion_ns)) {
                    command_wheel(p, &x, guard.steer_rad);
                    followed = command;
                }
                command++;
            } else if (guard_ns <= next_sample_ns) {
                motion_ns = guard.deadline_ns;
                if (guard_timer(guard_params, &guard, motion_ns)) {
                    advance(p, rig, &x, motion_ns);
                    command_wheel(p, &x, guard.steer_rad);
                }
            } else {
                advance(p, rig, &x, motion_ns);
                guard_wheel(guard_params, &guard, x.z.delta, motion_ns);
                double reading_m = x.z.y + noise_m[sample];
                error_m[sample] = x.z.y;
                heading_rad[sample] = x.z.psi;
                yaw_rate_rad_s[sample] = x.z.r;
                wheel_rad[sample] = x.z.delta;
                curvature_1_m[sample] = x.z.rho;
                in_effect[sample] = followed;
                if (!(fabs(reading_m) <= p->error_m_max))
                    return;
                measured_m[sample] = rint(reading_m / p->error_resolution_m) * p->error_resolution_m;
                sample++;
            }
        }
        if (tick == p->ticks)
            return;
        double wanted = law_step(law, &state, measured_m[tick_sample[tick]], sent, output + 4 * tick);
        if (!isfinite(wanted))
            return;
        fade = ramp_step(p->ramp_step_rad, fade);
        wanted = wanted + fade;
        double low = greater(-p->steer_rad_max, sent - p->step_rad_max);
        double high = lesser(p->steer_rad_max, sent + p->step_rad_max);
        sent = lesser(greater(wanted, low), high);
        sent_rad[tick] = sent;
    }
}
