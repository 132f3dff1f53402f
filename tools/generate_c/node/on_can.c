/* The node on a CAN interface of Linux, until the plant has been silent for three seconds. */
#define _GNU_SOURCE
#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <sys/socket.h>

#include "node.h"

enum { FRAMES_PER_WAKE_UP_MAX = 256 };

#define NS_PER_S INT64_C(1000000000)

static struct node node;

static int64_t now_ns(void)
{
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * NS_PER_S + now.tv_nsec;
}

static int opened(const char *interface)
{
    struct sockaddr_can address = {.can_family = AF_CAN};
    const int bus = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK, CAN_RAW), is_on = 1;

    address.can_ifindex = (int)if_nametoindex(interface);
    if (bus < 0 || address.can_ifindex == 0
        || setsockopt(bus, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &is_on, sizeof is_on) != 0
        || bind(bus, (struct sockaddr *)&address, sizeof address) != 0) {
        perror(interface);
        return -1;
    }
    return bus;
}

/* Take what has arrived; returns 0 once the bus is gone. */
static int receive(int bus)
{
    struct canfd_frame read_frame;
    ssize_t size = 0;

    for (int i = 0; i < FRAMES_PER_WAKE_UP_MAX; i++) {
        struct frame frame = {0};

        size = read(bus, &read_frame, sizeof read_frame);
        if (size != CAN_MTU && size != CANFD_MTU)
            break;
        if (read_frame.can_id & CAN_ERR_FLAG)
            continue;
        frame.can_id = read_frame.can_id & CAN_EFF_MASK;
        frame.length = read_frame.len;
        frame.format = (uint8_t)((read_frame.can_id & CAN_EFF_FLAG ? FORMAT_EXTENDED : 0)
            | (read_frame.can_id & CAN_RTR_FLAG ? FORMAT_REMOTE : 0)
            | (size == CANFD_MTU ? FORMAT_FD : 0)
            | (size == CANFD_MTU && read_frame.flags & CANFD_BRS ? FORMAT_BITRATE_SWITCH : 0));
        memcpy(frame.data, read_frame.data, sizeof frame.data);
        node_on_frame(&node, &frame, now_ns());
    }
    if (size < 0 && errno != EAGAIN)
        perror("the bus");
    return size >= 0 || errno == EAGAIN;
}

/* Send what is due; a bus without room loses it, as the receiver's counters show. */
static void tick(int bus)
{
    struct frame frames[SENT_MAX];
    const int count = node_on_tick(&node, now_ns(), frames);

    for (int i = 0; i < count; i++) {
        struct can_frame sent = {.can_id = frames[i].can_id, .can_dlc = frames[i].length};

        memcpy(sent.data, frames[i].data, sizeof sent.data);
        if (write(bus, &sent, sizeof sent) != (ssize_t)sizeof sent)
            perror("not sent");
    }
}

int main(int count, char **arguments)
{
    struct pollfd waiting = {.events = POLLIN};

    if (count != 2) {
        fprintf(stderr, "usage: %s INTERFACE\n", arguments[0]);
        return 2;
    }
    waiting.fd = opened(arguments[1]);
    if (waiting.fd < 0)
        return 1;
    node_start(&node, now_ns());
    node.ends_with_plant = true;
    printf("ready\n");
    fflush(stdout);
    while (!node.has_finished) {
        const int64_t left_ns = node.deadline_ns - now_ns();
        const struct timespec left = {left_ns > 0 ? left_ns / NS_PER_S : 0,
                                      left_ns > 0 ? left_ns % NS_PER_S : 0};

        if (ppoll(&waiting, 1, &left, NULL) > 0 && !receive(waiting.fd))
            return 1;
        if (node.deadline_ns <= now_ns())
            tick(waiting.fd);
    }
    printf("%lld commands sent\n", (long long)node.commands);
    return 0;
}
