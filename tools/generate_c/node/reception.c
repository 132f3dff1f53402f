#include "reception.h"

#include <string.h>

#define NOTICE_NS INT64_C(1000000000)

enum { SENT_COUNT = 6, SECURED_LENGTH = 20 };

static const struct message *const RECEIVED[RECEIVED_COUNT] = {
    &LATERAL_ERROR, &STEERING_STATUS, &VEHICLE_STATE, &PATH_AHEAD,
};
static const struct message *const SENT[SENT_COUNT] = {
    &STEERING_COMMAND, &STEERING_PLAN, &CONTROLLER_STATUS, &CONTROLLER_SAFETY, &DELAY_STATUS,
    &MODEL_STATUS,
};

void reception_start(struct reception *x)
{
    memset(x, 0, sizeof *x);
    for (int i = 0; i < RECEIVED_COUNT; i++) {
        /* An optional message comes with another, in the other's cycle. */
        const bool is_path = i == A_PATH_AHEAD;

        sequence_start(&x->checks[i], RECEIVED[is_path ? A_VEHICLE_STATE : i]->cycle_ns);
    }
}

int64_t reception_lost(const struct reception *x)
{
    int64_t lost = 0;

    for (int i = 0; i < RECEIVED_COUNT; i++)
        lost += x->checks[i].lost;
    return lost;
}

int reception_second_sender(const struct reception *x, int64_t now_ns)
{
    int number = x->has_own && now_ns - x->own_ns < NOTICE_NS ? 1 : 0;

    for (int i = 0; i < RECEIVED_COUNT; i++)
        if (x->checks[i].had_second && now_ns - x->checks[i].second_sender_ns < NOTICE_NS)
            number |= 2;
    return number;
}

/* Whether a frame is one that only this node sends; a CAN controller returns no echo of its own. */
static bool is_own(struct reception *x, const struct frame *frame, int64_t now_ns)
{
    for (int i = 0; i < SENT_COUNT; i++) {
        if (SENT[i]->can_id != frame->can_id)
            continue;
        x->has_own = true;
        x->own_ns = now_ns;
        return true;
    }
    return false;
}

static enum received refused(struct reception *x, bool is_damaged_error)
{
    x->refused++;
    return is_damaged_error ? A_DAMAGED_ERROR : NOTHING;
}

enum received reception_take(struct reception *x, const struct frame *frame, int64_t now_ns,
                             int32_t *raws)
{
    int kind = 0;

    if (is_own(x, frame, now_ns))
        return refused(x, false);
    while (kind < RECEIVED_COUNT && RECEIVED[kind]->can_id != frame->can_id)
        kind++;
    if (kind == RECEIVED_COUNT)
        return NOTHING;
    const struct message *message = RECEIVED[kind];
    if (!unpacked(message, frame, raws)) {
        /* An authenticated frame is intact, but this node has no key. */
        const bool is_secured = (frame->format & ~FORMAT_BITRATE_SWITCH) == FORMAT_FD
            && frame->length == SECURED_LENGTH;

        return refused(x, kind == A_LATERAL_ERROR && !is_secured);
    }
    return sequence_check(&x->checks[kind], frame->data, now_ns) ? (enum received)kind
                                                                 : refused(x, false);
}
