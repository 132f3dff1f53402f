/* The node in virtual time: it is woken at its deadline and finds there what has arrived. */
#include <string.h>

#include "lockstep.h"
#include "node.h"

/* Move a whole record; return 0 at the end of the input. Each machine has its own. */
int read_record(struct lockstep_record *record);
int write_record(const struct lockstep_record *record);

static struct node node;
static struct lockstep_record record;

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

int main(void)
{
    struct frame frames[SENT_MAX];

    while (read_record(&record)) {
        const bool is_due = record.flags & (LOCKSTEP_START | LOCKSTEP_DEADLINE);

        if (record.flags & LOCKSTEP_START)
            node_start(&node, record.time_ns);
        for (unsigned i = 0; i < record.count; i++)
            take(&record.frames[i]);
        record.count = 0;
        if (is_due && !node.has_failed)
            record.count = (uint16_t)node_on_tick(&node, record.time_ns, frames);
        for (unsigned i = 0; i < record.count; i++)
            send(&record.frames[i], &frames[i]);
        record.flags = 0;
        record.time_ns = node.has_failed ? LOCKSTEP_NEVER : node.deadline_ns;
        if (!write_record(&record))
            return 1;
    }
    return 0;
}
