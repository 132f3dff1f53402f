#include "sequence.h"

#include <string.h>

#define PERIOD_NS_MIN INT64_C(1000000)
#define LASTING_NS INT64_C(700000000)
#define PAUSE_NS INT64_C(300000000)
#define SILENCE_NS INT64_C(2000000000)

enum { COUNTER_BYTE = 2, TIMES_MIN = 8 };

static int forward_of(int before, int counter)
{
    return (counter - before + COUNTERS) % COUNTERS;
}

void sequence_start(struct sequence *x, int64_t cycle_ns)
{
    memset(x, 0, sizeof *x);
    x->period_ns = x->period_ns_max = cycle_ns > PERIOD_NS_MIN ? cycle_ns : PERIOD_NS_MIN;
}

/* The counter rule */

static void keep(struct sequence *x, int counter, int64_t now_ns)
{
    x->counter = counter;
    x->arrival_ns = now_ns;
    x->has_arrived = true;
    x->run = 0;
    x->last_refused = 0;
}

static void measure_from(struct sequence *x, int counter, int64_t now_ns)
{
    x->since = counter;
    x->since_ns = now_ns;
    x->lost_before = x->lost;
}

static void next_of_sequence(struct sequence *x, int counter, int forward, int64_t now_ns)
{
    const int passed = COUNTERS - x->since + counter;

    x->lost += forward - 1;
    if (counter <= x->counter) {
        if (passed >= HALF && 2 * (x->lost - x->lost_before) <= passed) {
            const int64_t period_ns = (now_ns - x->since_ns) / passed;

            x->period_ns = period_ns < PERIOD_NS_MIN ? PERIOD_NS_MIN
                : period_ns > x->period_ns_max ? x->period_ns_max : period_ns;
        }
        measure_from(x, counter, now_ns);
    }
    keep(x, counter, now_ns);
}

static bool counter_step(struct sequence *x, int counter, int64_t now_ns)
{
    const int forward = forward_of(x->counter, counter);
    const int64_t elapsed_ns = now_ns - x->arrival_ns;

    if (x->has_arrived && 0 < forward && forward < HALF
        && (forward - 1) * x->period_ns <= LEAD_NS + elapsed_ns) {
        next_of_sequence(x, counter, forward, now_ns);
        return true;
    }
    x->run = x->run > 0 && counter == (x->last_refused + 1) % COUNTERS ? x->run + 1 : 1;
    x->last_refused = counter;
    if (x->has_arrived && (x->run <= RESYNC_RUN || elapsed_ns < RESYNC_NS))
        return false;
    keep(x, counter, now_ns);
    measure_from(x, counter, now_ns);
    return true;
}

/* The alarm of a second sender */

static bool sender_step(struct sender_state *x, int counter, bool is_second_content, int64_t now_ns)
{
    const int forward = forward_of(x->newest, counter);
    const struct sender_state before = *x;
    bool shows = false;

    if (is_second_content) {
        if (now_ns - x->content_ns > PAUSE_NS)
            x->changes = 0;
        shows = !x->is_behind && x->changes >= TIMES_MIN && now_ns - x->change_ns >= LASTING_NS;
        x->content_ns = now_ns;
        x->is_behind = true;
    } else if (0 < forward && forward <= HALF && x->is_behind) {
        x->change_ns = x->changes == 0 ? now_ns : x->change_ns;
        x->changes++;
        x->is_behind = false;
    }
    if (0 < forward && forward <= HALF)
        x->newest = counter;
    x->counter = counter;
    x->last_ns = now_ns;
    if (counter == (before.counter + 1) % COUNTERS) {
        x->run++;
        return shows;
    }
    x->other = before.counter;
    x->other_ns = before.last_ns;
    if (counter == (before.other + 1) % COUNTERS && now_ns - before.other_ns <= SILENCE_NS) {
        x->run = before.other_run + 1;
        x->other_run = before.run;
        return shows || (x->run >= TIMES_MIN && x->other_run >= TIMES_MIN
                         && before.last_ns - x->since_ns >= LASTING_NS);
    }
    x->run = x->other_run = 0;
    x->since_ns = now_ns;
    return shows;
}

static void watch(struct sequence *x, int counter, uint16_t content, int64_t now_ns)
{
    const int forward = forward_of(x->senders.newest, counter), slot = counter % HALF;
    const bool is_ahead = 0 < forward && forward <= HALF;
    const bool is_known = !is_ahead && x->is_known[slot];

    if (is_known && x->contents[slot] == content)
        return;
    for (int skipped = 1; is_ahead && skipped < forward; skipped++)
        x->is_known[forward_of(skipped, counter) % HALF] = false;
    x->is_known[slot] = true;
    x->contents[slot] = content;
    if (sender_step(&x->senders, counter, is_known, now_ns)) {
        x->had_second = true;
        x->second_sender_ns = now_ns;
    }
}

bool sequence_check(struct sequence *x, const uint8_t *content, int64_t now_ns)
{
    const int counter = content[COUNTER_BYTE];
    const bool is_first = !x->has_arrived, is_accepted = counter_step(x, counter, now_ns);

    if (is_first) {
        const struct sender_state first = {
            .newest = counter, .counter = counter, .other = counter, .last_ns = now_ns,
            .other_ns = now_ns, .since_ns = now_ns, .content_ns = now_ns, .change_ns = now_ns,
        };

        x->senders = first;
    }
    watch(x, counter, (uint16_t)(content[0] | content[1] << 8), now_ns);
    return is_accepted;
}
