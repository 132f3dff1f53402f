/* The node in virtual time: it is woken at its deadline and finds there what has arrived. */
#include <string.h>

#include "lockstep.h"
#include "node.h"

static struct node node;

static void take(const struct lockstep_frame *arrived)
{
    struct frame frame = {arrived->can_id, arrived->length, arrived->format, {0}};

    memcpy(frame.data, arrived->data, sizeof frame.data);
    node_on_frame(&node, &frame, arrived->time_ns);
}

static void send(struct lockstep_frame *sent, const struct frame *frame)
{
    *sent = (struct lockstep_frame){0, frame->can_id, frame->length, frame->format, {0}, {0}};
    memcpy(sent->data, frame->data, sizeof frame->data);
}

void lockstep_exchange(struct lockstep_record *record)
{
    const bool is_due = record->flags & (LOCKSTEP_START | LOCKSTEP_DEADLINE);
    struct frame frames[SENT_MAX];

    if (record->flags & LOCKSTEP_START)
        node_start(&node, record->time_ns);
    for (unsigned i = 0; i < record->count; i++)
        take(&record->frames[i]);
    record->count = 0;
    if (is_due && !node.has_failed)
        record->count = (uint16_t)node_on_tick(&node, record->time_ns, frames);
    for (unsigned i = 0; i < record->count; i++)
        send(&record->frames[i], &frames[i]);
    record->flags = 0;
    record->time_ns = node.has_failed ? LOCKSTEP_NEVER : node.deadline_ns;
}
