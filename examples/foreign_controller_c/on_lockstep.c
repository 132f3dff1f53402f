/* The controller in virtual time: woken by every frame, it has no deadline of its own. */
#include <stddef.h>
#include <string.h>

#include "controller.h"
#include "lockstep.h"

void lockstep_exchange(struct lockstep_record *record)
{
    static struct controller x;
    struct frame frame, command;
    uint16_t answers = 0;

    for (unsigned i = 0; i < record->count; i++) {
        struct lockstep_frame *out = &record->frames[answers];

        if (record->frames[i].format != 0 || record->frames[i].length > sizeof frame.data)
            continue;
        frame.can_id = record->frames[i].can_id;
        frame.length = record->frames[i].length;
        memcpy(frame.data, record->frames[i].data, sizeof frame.data);
        if (!controller_on_frame(&x, &frame, &command))
            continue;
        /* At most as many answers as frames that have been read. */
        out->can_id = command.can_id;
        out->length = command.length;
        out->format = 0; /* the frame that was there may have been one of CAN FD */
        memcpy(out->data, command.data, sizeof command.data);
        answers++;
    }
    record->flags = LOCKSTEP_WAKE_ON_FRAMES;
    record->count = answers;
    record->time_ns = LOCKSTEP_NEVER;
}
