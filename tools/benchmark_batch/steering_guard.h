/* The steering's guard in plain C: plant_emulator/steering/hold_and_fallback.py and command_limits.py, operation
   by operation. */

#include <math.h>
#include <stdint.h>

enum { NO_COMMAND, FOLLOWING, HOLDING, FALLBACK, SAFE_STATE };
enum { LIMITS = 4, NOT_FINITE = 5 };

#define SLOT_NS INT64_C(250000000)
#define RAMP_PERIOD_NS INT64_C(10000000)
#define OFF_NS (INT64_C(1) << 62)

typedef struct {
    double reach_rad[LIMITS], sweep_rad[LIMITS];
    double tolerance_rad, stop_rad, ramp_rad_s, ramp_step_rad;
    int64_t follow_ns, silence_ns, hold_ns, recovery_frames, override_ns;
} GuardParams;

typedef struct {
    double steer_rad, low_rad, high_rad, low_1_rad, high_1_rad, low_2_rad, high_2_rad, fade_rad;
    int64_t cause, slot, followed_ns, mode, arrived_ns, deadline_ns, good_run;
} Guard;

static inline double lesser(double a, double b)
{
    return b < a ? b : a;
}

static inline double greater(double a, double b)
{
    return b > a ? b : a;
}

static inline int64_t earlier(int64_t a, int64_t b)
{
    return b < a ? b : a;
}

static double towards_zero(double value, double step)
{
    return value - lesser(greater(value, -step), step);
}

static void limit_steer(const GuardParams *p, Guard *x, double wanted_rad, int64_t time_ns)
{
    int64_t slot = time_ns / SLOT_NS;
    for (int64_t passed = 1; passed <= 3; passed++) {
        if (slot - x->slot >= passed) {
            x->low_2_rad = x->low_1_rad, x->high_2_rad = x->high_1_rad;
            x->low_1_rad = x->low_rad, x->high_1_rad = x->high_rad;
            x->low_rad = x->high_rad = x->steer_rad;
        }
    }
    double lowest = lesser(lesser(x->low_rad, x->low_1_rad), x->low_2_rad);
    double highest = greater(greater(x->high_rad, x->high_1_rad), x->high_2_rad);
    double steer = wanted_rad;
    int64_t cause = 0;
    if (!isfinite(wanted_rad)) {
        steer = x->steer_rad;
        cause = NOT_FINITE;
    }
    for (int row = 0; row < LIMITS; row++) {
        double minimum = greater(-p->reach_rad[row], highest - p->sweep_rad[row]);
        double maximum = lesser(p->reach_rad[row], lowest + p->sweep_rad[row]);
        if (steer < minimum) {
            steer = minimum;
            cause = row + 1;
        } else if (steer > maximum) {
            steer = maximum;
            cause = row + 1;
        }
    }
    x->low_rad = lesser(x->low_rad, steer);
    x->high_rad = greater(x->high_rad, steer);
    x->steer_rad = steer;
    x->cause = cause;
    x->slot = slot;
}

/* Returns whether the command is followed. */
static int guard_command(const GuardParams *p, Guard *x, double steer_rad, int64_t time_ns)
{
    if (x->mode == SAFE_STATE)
        return 0;
    int64_t silence_ns = time_ns - x->arrived_ns, heard_ns = earlier(silence_ns, p->silence_ns);
    int64_t run_before = x->good_run, mode_before = x->mode;
    x->arrived_ns = time_ns;
    x->good_run = silence_ns < p->silence_ns ? run_before + 1 : 1;
    if (mode_before <= FOLLOWING || x->good_run >= p->recovery_frames) {
        x->mode = FOLLOWING;
        x->good_run = 0;
        x->deadline_ns = earlier(time_ns + p->silence_ns, p->override_ns);
    } else if (mode_before == FALLBACK) {
        x->fade_rad = 0.0;
        return 0;
    } else if (run_before > 0) {
        x->deadline_ns = earlier(x->deadline_ns + heard_ns, p->override_ns);
    }
    double fade_rad = towards_zero(x->fade_rad, p->ramp_rad_s * ((double)heard_ns * 1e-9));
    double wanted_rad = steer_rad + fade_rad;
    if (mode_before == FALLBACK || (mode_before == HOLDING && silence_ns >= p->silence_ns)) {
        wanted_rad = x->steer_rad + (fade_rad - x->fade_rad);
        fade_rad = wanted_rad - steer_rad;
    }
    x->fade_rad = fade_rad;
    limit_steer(p, x, wanted_rad, time_ns);
    return 1;
}

/* Returns whether the target is set anew. */
static int guard_timer(const GuardParams *p, Guard *x, int64_t time_ns)
{
    if (time_ns >= p->override_ns) {
        x->mode = SAFE_STATE;
    } else if (x->mode == FOLLOWING) {
        x->deadline_ns = earlier(time_ns + p->hold_ns, p->override_ns);
        x->mode = HOLDING;
        x->good_run = 1;
        return 0;
    } else if (x->mode == HOLDING) {
        x->mode = FALLBACK;
    }
    x->fade_rad = 0.0;
    limit_steer(p, x, towards_zero(x->steer_rad, p->ramp_step_rad), time_ns);
    x->deadline_ns = OFF_NS;
    if (x->steer_rad != 0.0 && p->ramp_step_rad > 0.0)
        x->deadline_ns = time_ns + RAMP_PERIOD_NS;
    if (x->mode != SAFE_STATE)
        x->deadline_ns = earlier(x->deadline_ns, p->override_ns);
    return 1;
}

static void guard_wheel(const GuardParams *p, Guard *x, double wheel_rad, int64_t time_ns)
{
    double target_rad = lesser(greater(x->steer_rad, -p->stop_rad), p->stop_rad);
    if (fabs(wheel_rad - target_rad) <= p->tolerance_rad) {
        x->followed_ns = time_ns;
    } else if (time_ns - x->followed_ns > p->follow_ns && x->mode != SAFE_STATE) {
        x->mode = SAFE_STATE;
        x->deadline_ns = time_ns;
        x->good_run = 0;
        x->fade_rad = 0.0;
    }
}
