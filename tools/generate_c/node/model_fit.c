#include "model_fit.h"

#include "node_settings.h"

static const double DEVIATIONS = 3.0, MARGIN = 0.03, DEBOUNCE_S = 3.0, WIDTH_MIN = 0.05;
static const double DEVIATION_MAX = 0.1;
static const double SMOOTHED_S = 0.3, NOISE_FORGETS_S = 20.0, NOISE_RAD2_S2_MIN = 5e-4 * 5e-4;
static const double TIMING = 0.25, TRANSIENT = 0.03;
static const double W_WALKS_PER_S = 1e-4, B_WALKS_PER_S = 2.5e-5;
static const double W_VARIANCE_MAX = 25.0, B_VARIANCE_MAX = 0.01;
static const double LOG_2 = 0.693147180559945309, NEGLIGIBLE = -700.0;

static double larger(double one, double other)
{
    return one > other ? one : other;
}

static double smaller(double one, double other)
{
    return one < other ? one : other;
}

static double magnitude(double value)
{
    return value < 0.0 ? -value : value;
}

/* e^x for x <= 0, to some 1e-15: no machine's library, so that all machines agree. */
static double exponential(double x)
{
    double sum = 1.0, scale = 1.0;
    int halvings = 0;

    if (x < NEGLIGIBLE)
        return 0.0;
    for (; x < -0.5 * LOG_2; x += LOG_2)
        halvings++;
    for (int n = 16; n > 0; n--)
        sum = 1.0 + sum * x / n;
    while (halvings-- > 0)
        scale *= 0.5;
    return scale * sum;
}

/* The lag of the yaw rate behind a turning wheel. */
static double lag_s(double speed_m_s)
{
    const double m = VIRTUAL_MASS_KG, j = YAW_INERTIA_KG_M2;
    const double c_f = FRONT_CORNERING_STIFFNESS_N_RAD, c_r = REAR_CORNERING_STIFFNESS_N_RAD;
    const double l_f = FRONT_AXLE_DISTANCE_M, l_r = REAR_AXLE_DISTANCE_M;
    const double v = larger(speed_m_s, 0.1);
    const double a_11 = -(c_r + c_f) / (m * v);
    const double a_12 = -1.0 + (c_r * l_r - c_f * l_f) / (m * v * v);
    const double a_21 = (c_r * l_r - c_f * l_f) / j;
    const double a_22 = -(c_r * (l_r * l_r) + c_f * (l_f * l_f)) / (j * v);
    const double b_1 = c_f / (m * v), b_2 = c_f * l_f / j;
    const double zero = b_2 / (a_21 * b_1 - a_11 * b_2);

    return larger(-(a_11 + a_22) / (a_11 * a_22 - a_12 * a_21) - zero, 1e-3);
}

void model_fit_start(struct model_fit *x)
{
    const struct model_fit at_rest = {
        .w = 0.5, .p_ww = W_VARIANCE_MAX, .p_bb = B_VARIANCE_MAX, .yaw_lag_s = 1.0, .fits = true,
    };

    *x = at_rest;
}

/* The Kalman filter of w and b: value = h w + b + noise. */
static void regress(struct model_fit *x, double h, double value, double noise_variance)
{
    const double w = x->w, b = x->b, p_ww = x->p_ww, p_wb = x->p_wb, p_bb = x->p_bb;
    const double to_w = p_ww * h + p_wb, to_b = p_wb * h + p_bb;
    const double variance = noise_variance + h * to_w + to_b;
    const double error = value - (w * h + b);

    x->w = w + to_w / variance * error;
    x->b = b + to_b / variance * error;
    x->p_ww = p_ww - to_w * to_w / variance;
    x->p_wb = p_wb - to_w * to_b / variance;
    x->p_bb = p_bb - to_b * to_b / variance;
}

static void judge(struct model_fit *x, double lasted_s)
{
    const double over = larger(x->w - 1.0, -x->w) - MARGIN;
    const bool is_outside = over > 0.0 && over * over > DEVIATIONS * DEVIATIONS * x->p_ww;

    x->lasted_s = is_outside == x->fits ? x->lasted_s + lasted_s : 0.0;
    if (x->lasted_s >= DEBOUNCE_S) {
        x->fits = !x->fits;
        x->lasted_s = 0.0;
    }
}

void model_fit_step(struct model_fit *x, const struct motion *motion)
{
    const double lasted_s = motion->lasted_s, v = motion->speed_m_s, v2 = v * v;

    if (v != x->speed_m_s) {
        x->speed_m_s = v;
        x->yaw_lag_s = lag_s(v);
    }
    double taken = 1.0 - exponential(-lasted_s / x->yaw_lag_s);
    x->late_rad += taken * (motion->wheel_rad - x->late_rad);
    taken = 1.0 - exponential(-lasted_s / SMOOTHED_S);
    x->wheel_rad += taken * (x->late_rad - x->wheel_rad);
    x->yaw_rate_rad_s += taken * (motion->yaw_rate_rad_s - x->yaw_rate_rad_s);
    const double r = x->yaw_rate_rad_s;
    const double least_rad_s = v * x->wheel_rad / (LENGTH_M + GRADIENT_LEAST_S2_M * v2);
    const double largest_rad_s = v * x->wheel_rad / (LENGTH_M + GRADIENT_LARGEST_S2_M * v2);
    const double turning_rad_s = least_rad_s - x->least_rad_s;
    x->least_rad_s = least_rad_s;
    const double timing_rad_s = TIMING * turning_rad_s;
    const double transient_rad_s = TRANSIENT * least_rad_s;
    double noise_rad2_s2 = larger(x->left_rad2_s2, NOISE_RAD2_S2_MIN);
    noise_rad2_s2 += timing_rad_s * timing_rad_s + transient_rad_s * transient_rad_s;
    x->p_ww = smaller(x->p_ww + W_WALKS_PER_S * lasted_s, W_VARIANCE_MAX);
    x->p_bb = smaller(x->p_bb + B_WALKS_PER_S * lasted_s, B_VARIANCE_MAX);
    const double width_rad_s = largest_rad_s - least_rad_s, over_rad_s = r - least_rad_s;
    regress(x, width_rad_s, over_rad_s, noise_rad2_s2);
    const double left_rad_s = over_rad_s - x->w * width_rad_s - x->b;
    x->steps += 1.0;
    const double weight = larger(1.0 / x->steps, smaller(lasted_s / NOISE_FORGETS_S, 1.0));
    x->left_rad2_s2 += weight * (left_rad_s * left_rad_s - x->left_rad2_s2);
    const bool is_wide = magnitude(width_rad_s) >= WIDTH_MIN * magnitude(least_rad_s);
    if (is_wide && x->p_ww <= DEVIATION_MAX * DEVIATION_MAX)
        judge(x, lasted_s);
}
