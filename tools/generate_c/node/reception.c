#include "reception.h"

#include <string.h>

#define NOTICE_NS INT64_C(1000000000)
#define PAUSE_NS INT64_C(50000000)

enum { SENT_COUNT = 6, SECURED_LENGTH = 20, CLASSIC_MAX = 8 };

static const struct message *const RECEIVED[RECEIVED_COUNT] = {
    &LATERAL_ERROR, &STEERING_STATUS, &VEHICLE_STATE, &PATH_AHEAD,
};
static const struct message *const SENT[SENT_COUNT] = {
    &STEERING_COMMAND, &STEERING_PLAN, &CONTROLLER_STATUS, &CONTROLLER_SAFETY, &DELAY_STATUS,
    &MODEL_STATUS,
};
/* The contents of each counter, and in caution those that came. */
static uint8_t classic[A_PATH_AHEAD][2][COUNTERS * CLASSIC_MAX], path[2][COUNTERS * PAYLOAD_MAX];

void reception_start(struct reception *x)
{
    memset(x, 0, sizeof *x);
    for (int i = 0; i < RECEIVED_COUNT; i++) {
        /* An optional message comes with another, in the other's cycle. */
        const bool is_path = i == A_PATH_AHEAD;
        const int64_t cycle_ns = RECEIVED[is_path ? A_VEHICLE_STATE : i]->cycle_ns;
        uint8_t *contents = is_path ? path[0] : classic[i][0];

        sequence_start(&x->checks[i], RECEIVED[i]->length, cycle_ns, contents,
                       is_path ? path[1] : classic[i][1]);
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

/* Whether a frame is one that only this node sends; an intact one begins a pause. */
static bool is_own(struct reception *x, const struct frame *frame, int64_t now_ns)
{
    int32_t raws[SIGNALS_MAX];

    for (int i = 0; i < SENT_COUNT; i++) {
        if (SENT[i]->can_id != frame->can_id)
            continue;
        x->has_own = true;
        x->own_ns = now_ns;
        if (x->sends && unpacked(SENT[i], frame, raws)) {
            x->is_paused = true;
            x->paused_until_ns = now_ns + PAUSE_NS;
        }
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
    if (x->is_paused && now_ns < x->paused_until_ns)
        return refused(x, kind == A_LATERAL_ERROR);
    x->is_paused = false;
    const struct message *message = RECEIVED[kind];
    if (!unpacked(message, frame, raws)) {
        /* An authenticated frame is intact, but this node has no key. */
        const bool is_secured = (frame->format & ~FORMAT_BITRATE_SWITCH) == FORMAT_FD
            && frame->length == SECURED_LENGTH;

        return refused(x, kind == A_LATERAL_ERROR && !is_secured);
    }
    switch (sequence_check(&x->checks[kind], frame->data, now_ns)) {
    case ACCEPTED:
        return (enum received)kind;
    case WAITING_FRAME:
        return NOTHING;
    case TAKEN_BACK:
        x->refused++;
        break;
    case CONFIRMED:
        break;
    default:
        return refused(x, false);
    }
    struct frame in_use = {frame->can_id, frame->length, frame->format, {0}};
    memcpy(in_use.data, sequence_content(&x->checks[kind]), message->length);
    return unpacked(message, &in_use, raws) ? (enum received)kind : NOTHING;
}
