/* What the C programs of the benchmark share. Every one of them prints "ready" when nothing is left
 * to prepare, and where it has a duration, begins it with the first byte on standard input. */
#ifndef YARDSTICK_H
#define YARDSTICK_H

#include <errno.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#define NS_PER_S 1000000000LL

static inline void die(const char *what)
{
    fprintf(stderr, "%s: %s\n", what, errno ? strerror(errno) : "wrong arguments");
    exit(1);
}

/* The same as the programs get from the host without rights, and the memory lock where it is granted. */
static inline void prepare(void)
{
    prctl(PR_SET_TIMERSLACK, 1UL, 0UL, 0UL, 0UL);
    mlockall(MCL_CURRENT);
}

static inline void say_ready(void)
{
    if (printf("ready\n") < 0 || fflush(stdout))
        die("standard output");
}

static inline void wait_for_go(void)
{
    char go;
    if (read(STDIN_FILENO, &go, 1) != 1)
        die("standard input");
}

static inline int64_t now_ns(clockid_t clock)
{
    struct timespec now;
    clock_gettime(clock, &now);
    return now.tv_sec * NS_PER_S + now.tv_nsec;
}

static inline struct timespec timespec_of(int64_t ns)
{
    struct timespec time = {.tv_sec = ns / NS_PER_S, .tv_nsec = ns % NS_PER_S};
    return time;
}

static inline int64_t number(const char *text)
{
    char *end;
    errno = 0;
    int64_t value = strtoll(text, &end, 0);
    if (*end || end == text || value < 0)
        die(text);
    return value;
}

/* A raw socket that receives the frames of one 11-bit identifier; id_mask 0 receives everything. */
static inline int open_can(const char *channel, canid_t can_id, canid_t id_mask)
{
    struct can_filter filter = {.can_id = can_id, .can_mask = id_mask};
    struct sockaddr_can address = {.can_family = AF_CAN};
    int bus = socket(AF_CAN, SOCK_RAW, CAN_RAW);
    if (bus < 0)
        die("a CAN socket");
    address.can_ifindex = (int)if_nametoindex(channel);
    if (!address.can_ifindex)
        die(channel);
    if (setsockopt(bus, SOL_CAN_RAW, CAN_RAW_FILTER, &filter, sizeof filter) ||
        bind(bus, (struct sockaddr *)&address, sizeof address))
        die(channel);
    return bus;
}

static inline void write_log(const char *path, const void *records, size_t size, size_t count)
{
    FILE *log = fopen(path, "wb");
    if (!log || fwrite(records, size, count, log) != count || fclose(log))
        die(path);
}

#endif
