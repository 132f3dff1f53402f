/* One run of plant and pd_ddob in plain C: the arithmetic of the project's step functions, operation
   by operation, for a transparent actuator, no noise and no disturbance but the path. It is what the
   compiled batch is measured against, and has to give the same bits (no fast-math, no contraction). */

#include <math.h>
#include <stdint.h>

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

typedef struct {
    double speed_m_s, steer_rad_max, step_rad_max, error_resolution_m, error_m_max,
        steer_resolution_rad;
    double path_length_m;
    int64_t motion_start_ns, end_ns;
    int64_t pieces, ticks, commands, samples;
} Run;

typedef struct { double beta, r, psi, y, delta, rho, rho_rate; } Vehicle;

typedef struct {
    Vehicle z;
    int64_t time_ns, place_end_ns, piece, lap;
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

static void propagate(const double *table, Vehicle *z, int64_t dt_ns)
{
    double beta = z->beta, r = z->r, psi = z->psi, y = z->y;
    double delta = z->delta, rho = z->rho, rho_rate = z->rho_rate;
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
        y = y + (f[20] * beta + f[21] * r + f[22] * psi) + (f[23] * delta + f[24] * 0.0)
            + (f[25] * rho + f[26] * rho_rate) + (f[27] * 0.0 + f[28] * 0.0);
        psi = psi + (f[12] * beta + f[13] * r) + (f[14] * delta + f[15] * 0.0)
            + (f[16] * rho + f[17] * rho_rate) + (f[18] * 0.0 + f[19] * 0.0);
        double new_beta = (f[0] * beta + f[1] * r) + (f[2] * delta + f[3] * 0.0)
            + (f[4] * 0.0 + f[5] * 0.0);
        r = (f[6] * beta + f[7] * r) + (f[8] * delta + f[9] * 0.0) + (f[10] * 0.0 + f[11] * 0.0);
        beta = new_beta;
        rho = rho + f[31] * rho_rate;
    }
    z->beta = beta, z->r = r, z->psi = psi, z->y = y, z->rho = rho;
}

static void enter_piece(const Run *p, const double *start_m, const double *curvature_1_m,
                        const double *slope_1_m2, Motion *x)
{
    x->z.rho = curvature_1_m[x->piece];
    x->z.rho_rate = slope_1_m2[x->piece] * p->speed_m_s;
    double end_m = x->piece + 1 < p->pieces ? x->lap * p->path_length_m + start_m[x->piece + 1]
                                            : (x->lap + 1) * p->path_length_m;
    x->place_end_ns = llrint(end_m / p->speed_m_s * 1e9);
}

static void advance(const Run *p, const double *table, const double *start_m,
                    const double *curvature_1_m, const double *slope_1_m2, Motion *x, int64_t to_ns)
{
    while (x->place_end_ns <= to_ns) {
        propagate(table, &x->z, x->place_end_ns - x->time_ns);
        x->time_ns = x->place_end_ns;
        if (x->piece + 1 < p->pieces) {
            x->piece++;
        } else {
            x->piece = 0;
            x->lap++;
        }
        enter_piece(p, start_m, curvature_1_m, slope_1_m2, x);
    }
    propagate(table, &x->z, to_ns - x->time_ns);
    x->time_ns = to_ns;
}

/* Fills error_m (samples) and sent_rad (ticks). */
void run_pair(const Run *p, const Law *law, const double *table, const double *start_m,
              const double *path_1_m, const double *slope_1_m2, const int64_t *tick_ns,
              const int64_t *tick_sample, const int64_t *command_due_ns,
              const int64_t *command_tick, const int64_t *sample_ns, const double *noise_m,
              double *error_m, double *heading_rad, double *yaw_rate_rad_s, double *wheel_rad,
              double *curvature_1_m, double *measured_m, int64_t *in_effect, double *sent_rad,
              double *output)
{
    Motion x = {0};
    LawState state = {0};
    double sent = 0.0;
    int64_t sample = 0, command = 0;
    enter_piece(p, start_m, path_1_m, slope_1_m2, &x);
    for (int64_t tick = 0; tick <= p->ticks; tick++) {
        int64_t to_ns = tick < p->ticks ? tick_ns[tick] : p->end_ns;
        for (;;) {
            int64_t command_ns = to_ns + 1, next_sample_ns = to_ns + 1;
            if (command < p->commands && command_tick[command] < tick)
                command_ns = command_due_ns[command];
            if (sample < p->samples)
                next_sample_ns = sample_ns[sample];
            if (command_ns > to_ns && next_sample_ns > to_ns)
                break;
            int64_t at_ns = command_ns <= next_sample_ns ? command_ns : next_sample_ns;
            int64_t motion_ns = at_ns - p->motion_start_ns;
            advance(p, table, start_m, path_1_m, slope_1_m2, &x, motion_ns > 0 ? motion_ns : 0);
            if (command_ns <= next_sample_ns) {
                double raw = rint(sent_rad[command_tick[command]] / p->steer_resolution_rad);
                x.z.delta = raw * p->steer_resolution_rad;
                command++;
            } else {
                double reading_m = x.z.y + noise_m[sample];
                error_m[sample] = x.z.y;
                heading_rad[sample] = x.z.psi;
                yaw_rate_rad_s[sample] = x.z.r;
                wheel_rad[sample] = x.z.delta;
                curvature_1_m[sample] = x.z.rho;
                in_effect[sample] = command - 1;
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
        double low = fmax(-p->steer_rad_max, sent - p->step_rad_max);
        double high = fmin(p->steer_rad_max, sent + p->step_rad_max);
        sent = fmin(fmax(wanted, low), high);
        sent_rad[tick] = sent;
    }
}
