/* A law of the paper, which `steer-by-wire generate-c` writes. */
#include "controller.h"
#include "steering_law.h"

double decide(double error_m, double steer_rad, int is_first)
{
    static struct law law;

    if (is_first)
        law_start(&law, error_m);
    return limit_step(&STEER_LIMITS, steer_rad, law_step(&law, error_m, steer_rad).steer_rad);
}
