/* timer_loop PERIOD_NS DURATION_NS LOG: wakes up at absolute deadlines, and does nothing else.
 *
 * LOG: of each wake-up its deadline and when it was, two int64 [ns] on the monotonic clock. Periods
 * that have passed meanwhile are left out, and never made up: the deadlines stay on their grid. */
#include "yardstick.h"

struct wake_up {
    int64_t deadline_ns, woke_ns;
};

int main(int count, char **arguments)
{
    if (count != 4)
        die("timer_loop PERIOD_NS DURATION_NS LOG");
    int64_t period_ns = number(arguments[1]), duration_ns = number(arguments[2]);
    size_t room = (size_t)(duration_ns / period_ns) + 2, used = 0;
    struct wake_up *log = calloc(room, sizeof *log);
    if (!log)
        die("memory");
    memset(log, 0xff, room * sizeof *log); /* its pages are there from now on */
    prepare();
    say_ready();
    wait_for_go();
    int64_t start_ns = now_ns(CLOCK_MONOTONIC), deadline_ns = start_ns + period_ns;
    while (deadline_ns <= start_ns + duration_ns && used < room) {
        struct timespec deadline = timespec_of(deadline_ns);
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &deadline, NULL))
            ;
        int64_t woke_ns = now_ns(CLOCK_MONOTONIC);
        log[used++] = (struct wake_up){deadline_ns, woke_ns};
        deadline_ns += ((woke_ns - deadline_ns) / period_ns + 1) * period_ns;
    }
    write_log(arguments[3], log, sizeof *log, used);
    return 0;
}
