/* The counters and contents of one message, as they arrive.
 *
 * The rules are those of dbc/codec/counter_rule.py and dbc/codec/second_sender.py, which give the
 * reasons, under the same names. Of each content its CRC is kept.
 */
#ifndef SEQUENCE_H
#define SEQUENCE_H

#include "messages.h"
#include "node_settings.h"

enum { COUNTERS = 256, HALF = COUNTERS / 2 };

struct sender_state {
    int newest, counter, other;
    int64_t last_ns, other_ns, since_ns, content_ns, change_ns;
    int64_t run, other_run, changes;
    bool is_behind;
};

struct sequence {
    int64_t period_ns, period_ns_max, since_ns, lost_before;
    int since, last_refused;
    int64_t run;
    uint16_t contents[HALF];
    bool is_known[HALF];
    struct sender_state senders;
    /* The counter of the newest accepted frame, and when it came; frames skipped; when a second
       sender was seen. */
    int counter;
    bool has_arrived, had_second;
    int64_t arrival_ns, lost, second_sender_ns;
};

void sequence_start(struct sequence *x, int64_t cycle_ns);

/* Whether a frame with this payload is accepted. */
bool sequence_check(struct sequence *x, const uint8_t *content, int64_t now_ns);

#endif
