/* PD with a filtered derivative. */
#include "controller.h"

static const double GAIN_RAD_M = 1.5, DERIVATIVE_RAD_S_M = 0.07, FILTER_RAD_S = 25.0;
static const double PERIOD_S = 0.01, STEER_RAD_MAX = 0.6;

double decide(double error_m, double steer_rad, int is_first)
{
    static double last_error_m, derivative_m_s;
    double change_m = is_first ? 0.0 : error_m - last_error_m;
    double decay = 1.0 / (1.0 + FILTER_RAD_S * PERIOD_S);

    derivative_m_s = decay * (derivative_m_s + FILTER_RAD_S * change_m);
    last_error_m = error_m;
    steer_rad = -GAIN_RAD_M * error_m - DERIVATIVE_RAD_S_M * derivative_m_s;
    if (steer_rad > STEER_RAD_MAX)
        return STEER_RAD_MAX;
    return steer_rad < -STEER_RAD_MAX ? -STEER_RAD_MAX : steer_rad;
}
