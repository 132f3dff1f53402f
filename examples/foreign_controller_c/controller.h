/* The controller: it knows no bus, no clock and no operating system. */
#ifndef CONTROLLER_H
#define CONTROLLER_H

#include <stdint.h>

struct frame {
    uint32_t can_id;
    uint8_t length;
    uint8_t data[8];
};

struct controller { /* begins as zeros */
    double steer_rad; /* the last command */
    uint8_t counter;
    unsigned long sent;
};

/* Return whether a frame is a measurement, to which ``answer`` is the command. */
int controller_on_frame(struct controller *x, const struct frame *frame, struct frame *answer);

/* Return the steer for a lateral error [rad]; ``steer_rad`` is the last command, 0 before the first. */
double decide(double error_m, double steer_rad, int is_first);

#endif
