/* The controller on a CAN interface of Linux, until the plant has been silent for two seconds. */
#define _DEFAULT_SOURCE
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <sys/socket.h>

#include "controller.h"

enum { PATIENCE_MS = 60000, SILENCE_MS = 2000 };

static int opened(const char *interface)
{
    struct sockaddr_can address = {.can_family = AF_CAN};
    int bus = socket(PF_CAN, SOCK_RAW, CAN_RAW);

    address.can_ifindex = (int)if_nametoindex(interface);
    if (bus < 0 || address.can_ifindex == 0
        || bind(bus, (struct sockaddr *)&address, sizeof address) != 0) {
        perror(interface);
        return -1;
    }
    return bus;
}

int main(int count, char **arguments)
{
    struct controller x = {0};
    struct can_frame received, sent = {0};

    if (count != 2) {
        fprintf(stderr, "usage: %s INTERFACE\n", arguments[0]);
        return 2;
    }
    struct pollfd waiting = {.fd = opened(arguments[1]), .events = POLLIN};
    if (waiting.fd < 0)
        return 1;
    printf("ready\n");
    fflush(stdout);
    while (poll(&waiting, 1, x.sent == 0 ? PATIENCE_MS : SILENCE_MS) > 0) {
        struct frame frame, answer;

        if (read(waiting.fd, &received, sizeof received) != (ssize_t)sizeof received)
            return 1;
        frame.can_id = received.can_id;
        frame.length = received.can_dlc;
        memcpy(frame.data, received.data, sizeof frame.data);
        if (!controller_on_frame(&x, &frame, &answer))
            continue;
        sent.can_id = answer.can_id;
        sent.can_dlc = answer.length;
        memcpy(sent.data, answer.data, sizeof sent.data);
        if (write(waiting.fd, &sent, sizeof sent) != (ssize_t)sizeof sent)
            return 1;
    }
    printf("%lu commands sent\n", x.sent);
    return 0;
}
