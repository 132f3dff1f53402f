/* requester CHANNEL PERIOD_NS COUNT FRAMES LOG: sends a frame each period, notes all on the bus.
 *
 * FRAMES: the frames that are sent in turn, each a struct can_frame.
 * LOG: of each frame on the bus, its own and others', a struct passage. The kernel stamps own frames
 * and others' at the same place, on their way to the receivers, so the distance of two stamps is
 * what the answering program took, and nothing of what this one takes. */
#define _GNU_SOURCE
#include "yardstick.h"
#include <poll.h>

#define AFTER_NS 100000000LL /* how long the last answers are waited for */
#define PASSAGES_PER_REQUEST 8

struct passage {
    int64_t stamp_ns; /* wall clock */
    uint32_t can_id;
    uint8_t is_own, length, unused[2];
    uint8_t data[8];
};

struct log {
    struct passage *passages;
    size_t room, used;
};

static int open_bus(const char *channel)
{
    int bus = open_can(channel, 0, 0), on = 1;
    if (setsockopt(bus, SOL_CAN_RAW, CAN_RAW_RECV_OWN_MSGS, &on, sizeof on) ||
        setsockopt(bus, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on))
        die("a socket option");
    return bus;
}

static struct can_frame *read_frames(const char *path, size_t *frames)
{
    static struct can_frame table[256];
    FILE *file = fopen(path, "rb");
    if (!file || (*frames = fread(table, sizeof *table, 256, file)) == 0)
        die(path);
    fclose(file);
    return table;
}

/* Takes every frame that waits. */
static void drain(int bus, struct log *log)
{
    for (;;) {
        struct can_frame frame;
        char control[CMSG_SPACE(sizeof(struct timespec))];
        struct iovec vector = {&frame, sizeof frame};
        struct msghdr message = {.msg_iov = &vector, .msg_iovlen = 1,
                                 .msg_control = control, .msg_controllen = sizeof control};
        if (recvmsg(bus, &message, MSG_DONTWAIT) < 0) {
            if (errno == EAGAIN)
                return;
            die("recvmsg");
        }
        struct cmsghdr *header = CMSG_FIRSTHDR(&message);
        if (log->used == log->room || !header || header->cmsg_type != SCM_TIMESTAMPNS)
            continue;
        struct timespec stamp;
        memcpy(&stamp, CMSG_DATA(header), sizeof stamp);
        struct passage passage = {.stamp_ns = stamp.tv_sec * NS_PER_S + stamp.tv_nsec,
                                  .can_id = frame.can_id, .length = frame.can_dlc,
                                  .is_own = (message.msg_flags & MSG_CONFIRM) != 0};
        memcpy(passage.data, frame.data, sizeof passage.data);
        log->passages[log->used++] = passage;
    }
}

static void listen_until(int bus, int64_t until_ns, struct log *log)
{
    int64_t left_ns;
    while ((left_ns = until_ns - now_ns(CLOCK_MONOTONIC)) > 0) {
        struct pollfd wanted = {.fd = bus, .events = POLLIN};
        struct timespec left = timespec_of(left_ns);
        if (ppoll(&wanted, 1, &left, NULL) > 0)
            drain(bus, log);
    }
}

int main(int count, char **arguments)
{
    if (count != 6)
        die("requester CHANNEL PERIOD_NS COUNT FRAMES LOG");
    int64_t period_ns = number(arguments[2]), requests = number(arguments[3]);
    size_t frames;
    const struct can_frame *table = read_frames(arguments[4], &frames);
    int bus = open_bus(arguments[1]);
    struct log log = {.room = (size_t)requests * PASSAGES_PER_REQUEST + 1024};
    log.passages = malloc(log.room * sizeof *log.passages);
    if (!log.passages)
        die("memory");
    memset(log.passages, 0xff, log.room * sizeof *log.passages); /* its pages are there from now on */
    prepare();
    say_ready();
    wait_for_go();
    int64_t start_ns = now_ns(CLOCK_MONOTONIC);
    for (int64_t request = 0; request < requests; request++) {
        listen_until(bus, start_ns + (request + 1) * period_ns, &log);
        if (write(bus, &table[(size_t)request % frames], sizeof *table) != (ssize_t)sizeof *table)
            die("write");
    }
    listen_until(bus, now_ns(CLOCK_MONOTONIC) + AFTER_NS, &log);
    write_log(arguments[5], log.passages, sizeof *log.passages, log.used);
    return 0;
}
