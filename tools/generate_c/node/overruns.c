#include "overruns.h"

enum { RECENT_SIZE = OVERRUN_WINDOW_TICKS + 1, STALLS_SIZE = MISSED_WINDOW_PERIODS + 1 };

void timer_start(struct timer *x, int64_t start_ns, int64_t period_ns)
{
    x->start_ns = x->deadline_ns = start_ns;
    x->period_ns = period_ns;
    x->index = x->skipped = 0;
}

void timer_advance(struct timer *x, int64_t now_ns)
{
    const int64_t served = x->index;

    x->index = (now_ns - x->start_ns) / x->period_ns + 1;
    x->deadline_ns = x->start_ns + x->index * x->period_ns;
    x->skipped += x->index - served - 1;
}

/* Count the periods missed in the window; returns whether they are too many. */
static bool misses_too_many(struct overruns *x, int64_t missed)
{
    const int64_t counted = missed < STALL_PERIODS_MAX ? missed : STALL_PERIODS_MAX;

    x->counted += counted;
    const int64_t periods = x->ticks + x->counted, begin = periods - MISSED_WINDOW_PERIODS;
    if (counted > 0) {
        const int last = (x->stalls_first + x->stalls_count++) % STALLS_SIZE;

        x->missed += counted;
        x->stalls[last].end = periods;
        x->stalls[last].counted = counted;
    }
    while (x->stalls_count > 0 && x->stalls[x->stalls_first].end <= begin) {
        x->missed -= x->stalls[x->stalls_first].counted;
        x->stalls_first = (x->stalls_first + 1) % STALLS_SIZE;
        x->stalls_count--;
    }
    int64_t before = 0;
    if (x->stalls_count > 0)
        before = begin - (x->stalls[x->stalls_first].end - x->stalls[x->stalls_first].counted);
    return x->missed - (before > 0 ? before : 0) > MISSED_PERIODS_MAX;
}

void overruns_on_tick(struct overruns *x, const struct timer *timer)
{
    const int64_t missed = timer->skipped - x->skipped_before;

    x->ticks++;
    if (missed > 0) {
        x->skipped_before = timer->skipped;
        x->recent[(x->recent_first + x->recent_count++) % RECENT_SIZE] = x->ticks;
    }
    if (x->recent_count > 0 && x->recent[x->recent_first] <= x->ticks - OVERRUN_WINDOW_TICKS) {
        x->recent_first = (x->recent_first + 1) % RECENT_SIZE;
        x->recent_count--;
    }
    if (misses_too_many(x, missed) || x->recent_count > OVERRUNS_MAX)
        x->has_failed = true;
}
