/* Whether the vehicle fits the box of [validity]: as controller/node/model_fit.py. */
#ifndef MODEL_FIT_H
#define MODEL_FIT_H

#include <stdbool.h>
#include <stdint.h>

struct motion { /* sums of the VEHICLE_STATEs since the last judgement, or their means */
    double lasted_s, speed_m_s, yaw_rate_rad_s, wheel_rad;
};

struct model_fit { /* the fields of ModelFit, in its order; w and b are share and bias */
    double late_rad, wheel_rad, yaw_rate_rad_s;
    double w, b, p_ww, p_wb, p_bb;
    double least_rad_s, left_rad2_s2, steps;
    double speed_m_s, yaw_lag_s, lasted_s;
    bool fits;
};

void model_fit_start(struct model_fit *x);
void model_fit_step(struct model_fit *x, const struct motion *motion);

#endif
