/* Whether the node keeps its rate, by its own timer: as runtime/node/overruns.py and periodic.py. */
#ifndef OVERRUNS_H
#define OVERRUNS_H

#include <stdbool.h>
#include <stdint.h>

#include "node_settings.h"

struct timer { /* deadlines at start_ns + index * period_ns; an overrun keeps phase */
    int64_t start_ns, period_ns, deadline_ns, index, skipped;
};

struct overruns {
    int64_t ticks, skipped_before, counted, missed;
    int64_t recent[OVERRUN_WINDOW_TICKS + 1]; /* rings: ticks that overran */
    int recent_first, recent_count;
    struct { int64_t end, counted; } stalls[MISSED_WINDOW_PERIODS + 1];
    int stalls_first, stalls_count;
    bool has_failed;
};

void timer_start(struct timer *x, int64_t start_ns, int64_t period_ns);
void timer_advance(struct timer *x, int64_t now_ns);

/* Process the tick that a timer has advanced for; sets has_failed for good. */
void overruns_on_tick(struct overruns *x, const struct timer *timer);

#endif
