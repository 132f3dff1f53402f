#include "sequence.h"

#include <string.h>

enum known { UNKNOWN, SKIPPED, KNOWN }; /* of came_as: SKIPPED has not come */
enum { NO_COUNTER = -1, GAPS = 8, COUNTER_BYTE = 2, QUARTER = COUNTERS / 4 };

#define PERIOD_NS_MIN INT64_C(1000000)
#define CAUTION_NS INT64_C(10000000000)
#define GAP_NS_MAX INT64_C(100000000)
#define FOREIGN_NS INT64_C(1000000000)
#define QUIET_NS INT64_C(100000000)

struct arrived { /* a frame: how far ahead of the one in use, when it came, and what it is */
    int counter, forward;
    int64_t at_ns;
    const uint8_t *content;
};

static int64_t larger(int64_t one, int64_t other)
{
    return one > other ? one : other;
}

static int64_t smaller(int64_t one, int64_t other)
{
    return one < other ? one : other;
}

/* The period of a sender that sent for so many, within what is possible. */
static int64_t measured_ns(int64_t span_ns, int64_t periods, int64_t longest_ns)
{
    return smaller(larger(span_ns / periods, PERIOD_NS_MIN), longest_ns);
}

static int wrapped(int counter)
{
    return (counter + COUNTERS) % COUNTERS;
}

static uint8_t *at(const struct sequence *x, uint8_t *payloads, int counter)
{
    return payloads + counter * x->length;
}

static bool is_same(const struct sequence *x, const uint8_t *one, const uint8_t *other)
{
    return memcmp(one, other, (size_t)x->length) == 0;
}

static void keep(struct sequence *x, int counter, const uint8_t *content, int64_t at_ns)
{
    x->known_as[counter] = KNOWN;
    memcpy(at(x, x->contents, counter), content, (size_t)x->length);
    x->arrivals_ns[counter] = at_ns;
}

void sequence_start(struct sequence *x, int length, int64_t cycle_ns, uint8_t *contents,
                    uint8_t *came)
{
    memset(x, 0, sizeof *x);
    x->length = length;
    x->contents = contents;
    x->came = came;
    x->period_ns = x->period_ns_max = larger(cycle_ns, PERIOD_NS_MIN);
    x->next = x->last_refused = x->last_late = NO_COUNTER;
    x->is_alone = true;
}

const uint8_t *sequence_content(const struct sequence *x)
{
    return x->known_as[x->counter] == KNOWN ? at(x, x->contents, x->counter) : NULL;
}

static void begin_caution(struct sequence *x, int64_t wait_ns, int64_t until_ns)
{
    struct caution *caution = &x->caution;

    caution->is_on = true;
    caution->wait_ns = wait_ns;
    caution->until_ns = until_ns;
    caution->quiet_until_ns = 0;
    caution->count = 0;
    memset(caution->came_as, SKIPPED, sizeof caution->came_as);
}

static void note_second(struct sequence *x, int64_t now_ns)
{
    x->caution.until_ns = now_ns + CAUTION_NS;
    x->had_second = true;
    x->second_sender_ns = now_ns;
}

/* Use a frame in sequence, from now_ns on. */
static void use(struct sequence *x, const struct arrived *frame, int64_t now_ns)
{
    const int before = x->counter, counter = wrapped(before + frame->forward);

    for (int skipped = before + 1; skipped < before + frame->forward; skipped++)
        x->known_as[wrapped(skipped)] = SKIPPED;
    x->lost += frame->forward - 1;
    if (counter < before) {
        const int passed = COUNTERS - x->wrapped_at + counter;

        /* A few leaps measure nothing, and one that goes back may pass the wrap twice. */
        if (!x->caution.is_on && passed >= HALF && x->lost - x->wrapped_lost <= passed / 2)
            x->period_ns = measured_ns(frame->at_ns - x->wrapped_ns, passed, x->period_ns_max);
        x->wrapped_ns = frame->at_ns;
        x->wrapped_at = counter;
        x->wrapped_lost = x->lost;
    }
    keep(x, counter, frame->content, frame->at_ns);
    x->counter = counter;
    x->has_arrived = true;
    x->arrival_ns = now_ns;
}

/* Whether a frame is known, and has neither overtaken that of ``counter`` nor its counter. */
static bool is_clear(const struct sequence *x, int one, int counter)
{
    const bool is_older = wrapped(one - counter) >= HALF;

    return x->known_as[one] == KNOWN
        && (is_older || x->arrivals_ns[one] > x->arrivals_ns[counter]);
}

/* The newest clear counter that came up to ``time_ns``, and the longest gap before it. */
static int newest_until(const struct sequence *x, int counter, int64_t time_ns, int64_t *gap_ns)
{
    int newest = NO_COUNTER, last = NO_COUNTER, found = 0;

    *gap_ns = 0;
    for (int behind = 0; behind < HALF && found < GAPS; behind++) {
        const int one = wrapped(x->counter - behind);

        if (x->arrivals_ns[one] > time_ns || !is_clear(x, one, counter))
            continue;
        if (found++ == 0) {
            newest = one;
        } else {
            const int64_t this_ns = x->arrivals_ns[last] - x->arrivals_ns[one];

            *gap_ns = found == 2 ? this_ns : larger(*gap_ns, this_ns);
        }
        last = one;
    }
    return newest;
}

/* The oldest clear counter, and the sender's period by those that are clear, if shorter. */
static int oldest_clear(const struct sequence *x, int counter, int64_t now_ns, int64_t *period_ns)
{
    int newest = NO_COUNTER, oldest = NO_COUNTER;

    for (int behind = 0; behind < HALF; behind++) {
        const int one = wrapped(x->counter - behind);

        if (x->arrivals_ns[one] > now_ns || !is_clear(x, one, counter))
            continue;
        newest = newest == NO_COUNTER ? one : newest;
        oldest = one;
    }
    *period_ns = x->period_ns;
    if (oldest != NO_COUNTER && wrapped(newest - oldest) >= GAPS) {
        const int64_t span_ns = x->arrivals_ns[newest] - x->arrivals_ns[oldest];

        *period_ns = measured_ns(span_ns, wrapped(newest - oldest), x->period_ns);
    }
    return oldest;
}

static int64_t median_low(const int64_t *values, int count)
{
    for (int i = 0; i < count; i++) {
        int below = 0, equal = 0;

        for (int j = 0; j < count; j++) {
            below += values[j] < values[i] ? 1 : 0;
            equal += values[j] == values[i] ? 1 : 0;
        }
        if (below <= (count - 1) / 2 && (count - 1) / 2 < below + equal)
            return values[i];
    }
    return 0; /* of none */
}

/* How much later the frame in use came than the earliest of the last HALF counters. */
static int64_t held_up_ns(const struct sequence *x)
{
    int64_t gaps_ns[HALF], agos_ns[HALF], held_ns = 0;
    int count = 0, last = NO_COUNTER;

    for (int behind = 0; behind < HALF; behind++) {
        const int one = wrapped(x->counter - behind);

        agos_ns[behind] = x->arrivals_ns[x->counter] - x->arrivals_ns[one];
        if (x->known_as[one] != KNOWN)
            agos_ns[behind] = NO_COUNTER;
        if (agos_ns[behind] < 0)
            continue;
        if (last != NO_COUNTER) { /* rounded down */
            const int64_t change_ns = agos_ns[behind] - agos_ns[last];
            const int64_t gap_ns = change_ns / (behind - last);

            gaps_ns[count++] = gap_ns - (change_ns % (behind - last) < 0 ? 1 : 0);
        }
        last = behind;
    }
    const int64_t period_ns = larger(x->period_ns, median_low(gaps_ns, count));
    for (int behind = 0; behind < HALF; behind++)
        if (agos_ns[behind] >= 0)
            held_ns = larger(held_ns, agos_ns[behind] - behind * period_ns);
    return held_ns;
}

static int64_t largest_step(const struct sequence *x, int64_t elapsed_ns)
{
    return smaller(1 + (LEAD_NS + elapsed_ns) / x->period_ns, HALF - 1);
}

/* The same during caution; 0 once a newer counter may be an older one. */
static int64_t cautious_step(const struct sequence *x, int64_t elapsed_ns)
{
    const int64_t period_ns = x->caution.period_ns;
    const int64_t lead_ns = smaller(LEAD_NS, QUARTER / 2 * period_ns);
    const int64_t step_max = 1 + (lead_ns + elapsed_ns) / period_ns;

    return step_max < HALF - 1 ? step_max : 0;
}

/* Whether time explains that the counters have come round to an old one again. */
static bool may_have_wrapped(const struct sequence *x, const struct arrived *frame)
{
    const int64_t elapsed_ns = frame->at_ns - x->arrivals_ns[x->counter] + held_up_ns(x);

    return elapsed_ns + LEAD_NS >= (frame->forward > 0 ? frame->forward : COUNTERS) * x->period_ns;
}

/* Be cautious after a frame that contradicts an accepted one, and go back to before it. */
static enum sequence_result doubt(struct sequence *x, int counter, int64_t now_ns)
{
    const int64_t longest_ns = RESYNC_NS / 2 > 0 ? RESYNC_NS / 2 : GAP_NS_MAX;
    struct caution *caution = &x->caution;
    int64_t period_ns, gap_ns;

    if (caution->is_on) {
        caution->until_ns = now_ns + CAUTION_NS;
        if (now_ns < caution->quiet_until_ns)
            caution->quiet_until_ns = now_ns + QUIET_NS;
        if (!x->is_alone)
            note_second(x, now_ns);
        x->is_alone = true;
        return CONTRADICTED;
    }
    x->next = NO_COUNTER;
    x->is_alone = true;
    const int oldest = oldest_clear(x, counter, now_ns, &period_ns);
    /* A frame that came no later cannot be forged: its true one would have come by now. */
    const int64_t old_ns = smaller(LEAD_NS + longest_ns, QUARTER * period_ns);
    int before = newest_until(x, counter, now_ns - old_ns, &gap_ns);
    if (before == NO_COUNTER) /* shortly after the start */
        before = oldest;
    const int last = before == NO_COUNTER ? x->counter : before;
    gap_ns = larger(x->period_ns, smaller(gap_ns, longest_ns));
    const int64_t half = 3 * gap_ns / 2; /* to the nearest, halves to even */
    begin_caution(x, half + (3 * gap_ns % 2 != 0 && half % 2 != 0 ? 1 : 0), now_ns + CAUTION_NS);
    caution->period_ns = period_ns;
    for (int step = 1; step <= wrapped(x->counter - last); step++) {
        const int newer = wrapped(last + step);

        caution->came_as[newer] = x->known_as[newer];
        memcpy(at(x, x->came, newer), at(x, x->contents, newer), (size_t)x->length);
    }
    if (before == NO_COUNTER)
        return CONTRADICTED;
    x->counter = last;
    x->has_arrived = true;
    x->arrival_ns = now_ns;
    x->taken_back++;
    return TAKEN_BACK;
}

/* Let a frame wait; CONFIRMED: it confirms ``ripe``, which is to be used now. */
static enum sequence_result take(struct sequence *x, const struct arrived *frame,
                                 struct arrived *ripe)
{
    struct caution *caution = &x->caution;
    const int counter = frame->counter;
    const bool has_come = caution->came_as[counter] != SKIPPED;
    int older = 0, count = 0;

    if (has_come && caution->came_as[counter] == KNOWN
        && is_same(x, at(x, x->came, counter), frame->content))
        return REFUSED;
    if (!has_come) {
        caution->came_as[counter] = KNOWN;
        memcpy(at(x, x->came, counter), frame->content, (size_t)x->length);
    }
    while (older < caution->count && caution->waiting[older].forward < frame->forward)
        older++;
    if (has_come || older < caution->count) {
        caution->count = older;
        return CONTRADICTED;
    }
    while (count < older && frame->at_ns >= caution->quiet_until_ns
           && caution->waiting[count].arrived_ns <= frame->at_ns - caution->wait_ns)
        count++;
    const int passed = count > 0 ? caution->waiting[count - 1].forward : 0;
    const int base = counter - frame->forward;
    if (count > 0) {
        ripe->counter = wrapped(base + passed);
        ripe->forward = passed;
        ripe->at_ns = caution->waiting[count - 1].arrived_ns;
        ripe->content = at(x, x->came, ripe->counter);
    }
    for (int i = count; i < older; i++) {
        caution->waiting[i - count].arrived_ns = caution->waiting[i].arrived_ns;
        caution->waiting[i - count].forward = caution->waiting[i].forward - passed;
    }
    caution->waiting[older - count].arrived_ns = frame->at_ns;
    caution->waiting[older - count].forward = frame->forward - passed;
    caution->count = older - count + 1;
    for (int behind = 1; behind <= passed; behind++)
        caution->came_as[wrapped(base + behind)] = SKIPPED;
    return count > 0 ? CONFIRMED : WAITING_FRAME;
}

/* Let a frame in sequence wait; CONTRADICTED: it contradicts another. */
static enum sequence_result waits(struct sequence *x, const struct arrived *frame)
{
    struct arrived ripe;
    const enum sequence_result taken = take(x, frame, &ripe);

    if (taken == WAITING_FRAME || taken == CONFIRMED) {
        x->run = 0;
        x->is_alone = false;
        x->waited_ns = frame->at_ns;
    }
    if (taken == CONFIRMED)
        use(x, &ripe, frame->at_ns);
    return taken;
}

/* Take the first frame of a stream of counters. */
static enum sequence_result start(struct sequence *x, const struct arrived *frame)
{
    memset(x->known_as, UNKNOWN, sizeof x->known_as);
    x->wrapped_ns = frame->at_ns;
    x->wrapped_at = frame->counter;
    x->wrapped_lost = x->lost;
    x->run = 0;
    if (x->caution.is_on) { /* the frame is to wait, and none is in use */
        const struct arrived first = {frame->counter, 1, frame->at_ns, frame->content};

        x->counter = wrapped(frame->counter - 1);
        x->arrivals_ns[x->counter] = frame->at_ns;
        begin_caution(x, x->caution.wait_ns, x->caution.until_ns);
        return waits(x, &first); /* no other has come, so it contradicts none */
    }
    x->foreign_count = 0;
    keep(x, frame->counter, frame->content, frame->at_ns);
    x->counter = frame->counter;
    x->has_arrived = true;
    x->arrival_ns = frame->at_ns;
    x->next = frame->counter + 1;
    return ACCEPTED;
}

/* Count a refused frame; start anew if it shows that the sender has restarted. */
static enum sequence_result restarted(struct sequence *x, const struct arrived *frame)
{
    const bool is_on = x->caution.is_on;

    if (x->run == 0 || frame->counter != wrapped(x->last_refused + 1)) {
        if (is_on && x->run > 0 && !is_same(x, frame->content, x->last_content))
            note_second(x, frame->at_ns);
        x->run = 0;
        x->run_since_ns = frame->at_ns;
    }
    x->run++;
    x->last_refused = frame->counter;
    memcpy(x->last_content, frame->content, (size_t)x->length);
    /* During caution a true frame must have had the time to interrupt the run. */
    if (x->run <= RESYNC_RUN
        || frame->at_ns - x->run_since_ns < (is_on ? x->caution.wait_ns : 0)
        || frame->at_ns - x->arrival_ns < RESYNC_NS)
        return NOT_RESTARTED;
    if (is_on) { /* too few frames were known to measure it, so the run does */
        const int64_t span_ns = frame->at_ns - x->run_since_ns;

        x->caution.period_ns = measured_ns(span_ns, x->run - 1, x->caution.period_ns);
    }
    return start(x, frame);
}

/* Whether a frame of another stream is one of many, beside frames in sequence. */
static bool is_second(struct sequence *x, int64_t now_ns)
{
    if (x->foreign_count == RESYNC_RUN) {
        x->foreign_count--;
        for (int i = 0; i < x->foreign_count; i++)
            x->foreign_ns[i] = x->foreign_ns[i + 1];
    }
    x->foreign_ns[x->foreign_count++] = now_ns;
    return x->foreign_count == RESYNC_RUN && now_ns - x->foreign_ns[0] <= FOREIGN_NS
        && larger(x->arrivals_ns[x->counter], x->waited_ns) > x->foreign_ns[0];
}

/* Whether a frame out of sequence contradicts one that has come; it may fill a gap. */
static bool contradicts(struct sequence *x, const struct arrived *frame)
{
    const int counter = frame->counter;

    if (x->known_as[counter] == SKIPPED) {
        x->late_run = counter == wrapped(x->last_late + 1) ? x->late_run + 1 : 1;
        x->last_late = counter;
        keep(x, counter, frame->content, frame->at_ns);
        return x->late_run >= RESYNC_RUN && x->known_as[wrapped(counter + 1)] == SKIPPED;
    }
    return x->known_as[counter] == KNOWN
        && !is_same(x, at(x, x->contents, counter), frame->content);
}

/* Refuse a frame, unless it shows that the sender has restarted. */
static enum sequence_result refuse(struct sequence *x, const struct arrived *frame)
{
    const enum sequence_result started = restarted(x, frame);
    const int64_t now_ns = frame->at_ns;
    const int counter = frame->counter, forward = frame->forward;

    if (started != NOT_RESTARTED)
        return started;
    const bool is_ahead = 0 < forward && forward < HALF;
    const int64_t late_ns = wrapped(-forward) * x->period_ns;
    const bool is_explained = x->known_as[counter] == KNOWN
        ? is_same(x, at(x, x->contents, counter), frame->content)
        : late_ns <= larger(LEAD_NS, RESYNC_NS);
    if ((is_ahead || !is_explained)
        && (is_second(x, now_ns) || (x->caution.is_on && x->caution.quiet_until_ns > 0))) {
        const enum sequence_result result = doubt(x, counter, now_ns);

        x->caution.quiet_until_ns = now_ns + QUIET_NS;
        note_second(x, now_ns);
        return result;
    }
    if (is_ahead)
        return REFUSED;
    const bool is_contradiction = contradicts(x, frame);
    return is_contradiction && !may_have_wrapped(x, frame) ? doubt(x, counter, now_ns) : REFUSED;
}

enum sequence_result sequence_check(struct sequence *x, const uint8_t *content, int64_t now_ns)
{
    const int counter = content[COUNTER_BYTE];
    const struct arrived frame = {counter, wrapped(counter - x->counter), now_ns, content};

    if (counter == x->next) { /* nearly all frames; not after 255, so that a wrap is noticed */
        x->counter = counter;
        x->has_arrived = true;
        x->arrival_ns = now_ns;
        x->run = 0;
        x->next = counter + 1;
        keep(x, counter, content, now_ns);
        return ACCEPTED;
    }
    if (!x->has_arrived)
        return start(x, &frame);
    if (now_ns >= x->caution.until_ns)
        x->caution.is_on = false;
    const int64_t elapsed_ns = now_ns - x->arrivals_ns[x->counter];
    int64_t step_max = x->caution.is_on ? cautious_step(x, elapsed_ns)
                                        : largest_step(x, elapsed_ns);
    if (!x->caution.is_on && step_max < frame.forward && frame.forward < HALF)
        step_max = largest_step(x, elapsed_ns + held_up_ns(x));
    if (frame.forward < 1 || frame.forward > step_max)
        return refuse(x, &frame);
    if (x->caution.is_on) {
        enum sequence_result result = waits(x, &frame);

        if (result == CONTRADICTED)
            result = restarted(x, &frame);
        return result == NOT_RESTARTED ? doubt(x, counter, now_ns) : result;
    }
    x->run = 0;
    use(x, &frame, now_ns);
    x->next = counter + 1;
    return ACCEPTED;
}
