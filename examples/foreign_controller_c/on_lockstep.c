/* The controller in virtual time: woken by every frame, it has no deadline of its own. */
#include <stddef.h>
#include <string.h>

#include "controller.h"
#include "lockstep.h"

/* Move a whole record; return 0 at the end of the input. Each machine has its own. */
int read_record(struct lockstep_record *record);
int write_record(const struct lockstep_record *record);

int main(void)
{
    static struct controller x;
    static struct lockstep_record record, answer;

    while (read_record(&record)) {
        answer.mark = LOCKSTEP_MARK;
        answer.flags = LOCKSTEP_WAKE_ON_FRAMES;
        answer.count = 0;
        answer.time_ns = LOCKSTEP_NEVER;
        for (unsigned i = 0; i < record.count; i++) {
            struct lockstep_frame *out = &answer.frames[answer.count];
            struct frame frame, command;

            if (record.frames[i].format != 0 || record.frames[i].length > sizeof frame.data)
                continue;
            frame.can_id = record.frames[i].can_id;
            frame.length = record.frames[i].length;
            memcpy(frame.data, record.frames[i].data, sizeof frame.data);
            if (!controller_on_frame(&x, &frame, &command))
                continue;
            out->can_id = command.can_id;
            out->length = command.length;
            memcpy(out->data, command.data, sizeof command.data);
            answer.count++;
        }
        if (!write_record(&answer))
            return 1;
    }
    return 0;
}
