/* The node in virtual time: it is woken at its deadline and finds there what has arrived. */
#include <string.h>

#include "lockstep.h"
#include "node.h"

/* Move a whole record; return 0 at the end of the input. Each machine has its own. */
int read_record(struct lockstep_record *record);
int write_record(const struct lockstep_record *record);

static struct node node;
static struct lockstep_record record, answer;

static void take(const struct lockstep_frame *arrived)
{
    struct frame frame = {arrived->can_id, arrived->length, arrived->format, {0}};

    memcpy(frame.data, arrived->data, sizeof frame.data);
    node_on_frame(&node, &frame, arrived->time_ns);
}

static void send(const struct frame *frame)
{
    struct lockstep_frame *sent = &answer.frames[answer.count++];

    sent->can_id = frame->can_id;
    sent->length = frame->length;
    sent->format = frame->format;
    memcpy(sent->data, frame->data, sizeof frame->data);
}

int main(void)
{
    struct frame frames[SENT_MAX];

    answer.mark = LOCKSTEP_MARK;
    while (read_record(&record)) {
        if (record.flags & LOCKSTEP_START)
            node_start(&node, record.time_ns);
        for (unsigned i = 0; i < record.count; i++)
            take(&record.frames[i]);
        answer.count = 0;
        if ((record.flags & (LOCKSTEP_START | LOCKSTEP_DEADLINE)) && !node.has_finished) {
            const int count = node_on_tick(&node, record.time_ns, frames);

            for (int i = 0; i < count; i++)
                send(&frames[i]);
        }
        answer.time_ns = node.has_finished ? LOCKSTEP_NEVER : node.deadline_ns;
        if (!write_record(&answer))
            return 1;
    }
    return 0;
}
