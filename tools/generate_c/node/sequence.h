/* Which received counters of a message are believed, and what follows from two senders of it.
 *
 * The rule is that of dbc/codec/sequence_and_second_sender.py, which gives the reasons, under the same names.
 */
#ifndef SEQUENCE_H
#define SEQUENCE_H

#include "messages.h"
#include "node_settings.h"

enum { COUNTERS = 256, HALF = COUNTERS / 2 };

enum sequence_result {
    NOT_RESTARTED, ACCEPTED, CONFIRMED, TAKEN_BACK, WAITING_FRAME, CONTRADICTED, REFUSED
};

struct caution { /* the frames that wait, in order of arrival, which is that of their counters */
    bool is_on;
    int64_t period_ns; /* by the frames that are known */
    int64_t wait_ns, until_ns, quiet_until_ns; /* the last one 0 before a second stream */
    struct { int64_t arrived_ns; int forward; } waiting[HALF];
    int count;
    uint8_t came_as[COUNTERS];
};

struct sequence {
    int64_t period_ns, period_ns_max;
    uint8_t *contents, *came; /* COUNTERS payloads of ``length`` bytes each */
    int length;
    uint8_t known_as[COUNTERS];
    int64_t arrivals_ns[COUNTERS];
    int64_t wrapped_ns, wrapped_lost, run_since_ns, waited_ns;
    int next, wrapped_at, last_refused, last_late, run, late_run;
    uint8_t last_content[PAYLOAD_MAX];
    int64_t foreign_ns[RESYNC_RUN];
    int foreign_count;
    struct caution caution;
    bool is_alone;
    /* The counter in use, and when it came into use; frames skipped; when a second sender was seen;
       how often an earlier frame came into use again. */
    int counter;
    bool has_arrived, had_second;
    int64_t arrival_ns, lost, second_sender_ns, taken_back;
};

void sequence_start(struct sequence *x, int length, int64_t cycle_ns, uint8_t *contents,
                    uint8_t *came);
enum sequence_result sequence_check(struct sequence *x, const uint8_t *content, int64_t now_ns);

/* The payload in use; null if it is unknown. */
const uint8_t *sequence_content(const struct sequence *x);

#endif
