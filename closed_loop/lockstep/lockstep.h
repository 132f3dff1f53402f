/* The lockstep protocol of a controller in virtual time, version 1.
 *
 * The controller reads one record from standard input, does what is due, and writes one record to
 * standard output; and so on until its input ends. Every record has the same size and layout.
 * Numbers are little-endian. Nothing else may be written to standard output; standard error is free.
 *
 *            to the controller                         from the controller
 *   mark     LOCKSTEP_MARK                             LOCKSTEP_MARK
 *   flags    why it is woken: LOCKSTEP_START,          LOCKSTEP_WAKE_ON_FRAMES to be woken by every
 *            LOCKSTEP_DEADLINE or LOCKSTEP_FRAMES      frame, 0 to find them at the next deadline
 *   count    frames that have arrived since the        frames to send now, in this order
 *            last record
 *   time_ns  now                                       next deadline, after now;
 *                                                      LOCKSTEP_NEVER for none
 *
 * The first record has the flag LOCKSTEP_START and no frames. Without LOCKSTEP_WAKE_ON_FRAMES the
 * controller is woken before its deadline only when LOCKSTEP_FRAMES_MAX frames wait for it.
 * With LOCKSTEP_FRAMES the answer may be the deadline as it was.
 *
 * A shared library has no input and output. It has the function lockstep_exchange, which does what
 * is due and turns the record into the answer; main.c makes a program of the same function.
 */
#ifndef LOCKSTEP_H
#define LOCKSTEP_H

#include <stdint.h>

#define LOCKSTEP_MARK 0x3150534Cu /* the bytes "LSP1" */
#define LOCKSTEP_FRAMES_MAX 16
#define LOCKSTEP_NEVER INT64_MAX
/* Whether a record may be read: one that is not counts as the end of the input. */
#define LOCKSTEP_IS_SOUND(record) \
    ((record)->mark == LOCKSTEP_MARK && (record)->count <= LOCKSTEP_FRAMES_MAX)

enum { LOCKSTEP_START = 1, LOCKSTEP_DEADLINE = 2, LOCKSTEP_FRAMES = 4 };
enum { LOCKSTEP_WAKE_ON_FRAMES = 1 };

/* Formats of a frame; a sum of them is in format. */
enum { LOCKSTEP_EXTENDED = 1, LOCKSTEP_REMOTE = 2, LOCKSTEP_FD = 8, LOCKSTEP_BITRATE_SWITCH = 16 };

struct lockstep_frame {      /* 80 bytes */
    int64_t time_ns;         /* of its arrival; ignored in an answer */
    uint32_t can_id;         /* without format bits */
    uint8_t length;          /* bytes of data: 0 to 8, with LOCKSTEP_FD up to 64 */
    uint8_t format;
    uint8_t reserved[2];     /* 0 */
    uint8_t data[64];
};

struct lockstep_record {     /* 1296 bytes */
    uint32_t mark;
    uint16_t flags;
    uint16_t count;          /* 0 to LOCKSTEP_FRAMES_MAX */
    int64_t time_ns;
    struct lockstep_frame frames[LOCKSTEP_FRAMES_MAX];
};

void lockstep_exchange(struct lockstep_record *record);

#endif
