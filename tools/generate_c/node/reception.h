/* Which received frames the node accepts, and whether it has been refused others.
 *
 * As dbc/reception.py: intact and in their ranges, then by their counters.
 */
#ifndef RECEPTION_H
#define RECEPTION_H

#include "sequence.h"

enum received { /* what a frame was: a message, with its raws, or */
    A_LATERAL_ERROR, A_STEERING_STATUS, A_VEHICLE_STATE, A_PATH_AHEAD, RECEIVED_COUNT,
    A_DAMAGED_ERROR, NOTHING
};

struct reception {
    struct sequence checks[RECEIVED_COUNT];
    bool has_own;
    int64_t own_ns;
    int64_t refused;
};

void reception_start(struct reception *x);
enum received reception_take(struct reception *x, const struct frame *frame, int64_t now_ns,
                             int32_t *raws);
int64_t reception_lost(const struct reception *x);

/* Whose messages have come from a second sender lately: 1 own ones, 2 a peer's, 3 both. */
int reception_second_sender(const struct reception *x, int64_t now_ns);

#endif
