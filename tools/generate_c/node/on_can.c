/* The node on a CAN interface of Linux, until no measurement has come for three seconds. */
#define _GNU_SOURCE
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

#define NS_PER_S INT64_C(1000000000)

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
    setsockopt(bus, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &is_on, sizeof is_on);
    if (address.can_ifindex != 0 && bind(bus, (struct sockaddr *)&address, sizeof address) == 0)
        return bus;
    perror(interface);
    return -1;
}

static void take(struct node *node, const struct canfd_frame *it, bool is_fd)
{
    struct frame frame = {.can_id = it->can_id & CAN_EFF_MASK, .length = it->len};

    frame.format = (uint8_t)((it->can_id & CAN_EFF_FLAG ? FORMAT_EXTENDED : 0)
        | (it->can_id & CAN_RTR_FLAG ? FORMAT_REMOTE : 0) | (is_fd ? FORMAT_FD : 0)
        | (is_fd && it->flags & CANFD_BRS ? FORMAT_BITRATE_SWITCH : 0));
    memcpy(frame.data, it->data, sizeof frame.data);
    node_on_frame(node, &frame, now_ns());
}

int main(int count, char **arguments)
{
    static struct node node;
    struct frame frames[SENT_MAX];
    struct canfd_frame arrived;
    int64_t silence_ns = 0;
    struct pollfd bus = {.fd = count == 2 ? opened(arguments[1]) : -1, .events = POLLIN};

    if (bus.fd < 0) {
        fprintf(stderr, "usage: %s INTERFACE\n", arguments[0]);
        return 2;
    }
    node_start(&node, now_ns());
    puts("ready");
    fflush(stdout);
    while (!node.has_failed && !(node.sent_rad == 0.0 && silence_ns >= 3 * NS_PER_S)) {
        const int64_t left_ns = node.deadline_ns > now_ns() ? node.deadline_ns - now_ns() : 0;
        const struct timespec left = {left_ns / NS_PER_S, left_ns % NS_PER_S};
        const bool has_come = ppoll(&bus, 1, &left, NULL) > 0;
        const ssize_t size = has_come ? read(bus.fd, &arrived, CANFD_MTU) : 0;

        if (size < 0) {
            perror(arguments[1]);
            return 1;
        }
        if (size > 0)
            take(&node, &arrived, size == CANFD_MTU);
        const int sent = node.deadline_ns <= now_ns() ? node_on_tick(&node, now_ns(), frames) : 0;
        for (int i = 0; i < sent; i++) {
            struct can_frame frame = {.can_id = frames[i].can_id, .can_dlc = frames[i].length};

            memcpy(frame.data, frames[i].data, sizeof frame.data);
            if (write(bus.fd, &frame, sizeof frame) < 0) /* the receiver's counters show the loss */
                perror("not sent");
        }
        if (node.evidence.arrival_ns != INT64_MIN)
            silence_ns = now_ns() - node.evidence.arrival_ns;
    }
    printf("%lld commands sent\n", (long long)node.commands);
    return 0;
}
