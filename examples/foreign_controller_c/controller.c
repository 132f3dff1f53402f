/* A controller in C from the DBC alone: it answers every LATERAL_ERROR with a STEERING_COMMAND.
 *
 *   python -m cantools generate_c_source dbc/steer_by_wire.dbc
 *   cc -std=c99 -o controller examples/foreign_controller_c/controller.c steer_by_wire.c -lm -I.
 *   ./controller vcan0        until the plant has been silent for two seconds
 *   ./controller -            the same on lines "ID#DATA" from standard input to standard output
 *
 * steer_by_wire.c and .h, which cantools writes, know where each signal is. What they do not know:
 * the CRC of AUTOSAR E2E profile 5, and the Data IDs it covers, an attribute of the DBC.
 * With -DWITHOUT_COUNTER it has a deliberate error, for test_controller.py to find.
 */
#define _DEFAULT_SOURCE
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include "steer_by_wire.h"

enum { COMMAND_DATA_ID = 0x5100, ERROR_DATA_ID = 0x5110, MODE_ACTIVE = 1 };
enum { NOT_AVAILABLE_RAW = -16777216, PATIENCE_MS = 60000, SILENCE_MS = 2000 };

static const double GAIN_RAD_M = 1.5, DERIVATIVE_RAD_S_M = 0.07, FILTER_RAD_S = 25.0;
static const double PERIOD_S = 0.01, STEER_RAD_MAX = 0.6, STEER_RESOLUTION_RAD = 1e-5;

struct controller {
    double error_m, derivative_m_s;
    uint8_t counter;
    unsigned long sent;
};

/* The CRC of what follows it in a payload, and of the Data ID: polynomial 0x1021, start 0xFFFF. */
static uint16_t crc_of(const uint8_t *payload, size_t size, uint16_t data_id)
{
    uint8_t bytes[10];
    size_t count = size - 2;
    uint16_t crc = 0xFFFF;

    memcpy(bytes, payload + 2, count);
    bytes[count++] = (uint8_t)(data_id & 0xFF);
    bytes[count++] = (uint8_t)(data_id >> 8);
    for (size_t i = 0; i < count; i++) {
        crc = (uint16_t)(crc ^ (bytes[i] << 8));
        for (int bit = 0; bit < 8; bit++)
            crc = (uint16_t)((crc << 1) ^ ((crc & 0x8000) ? 0x1021 : 0));
    }
    return crc;
}

/* PD with a filtered derivative; returns the steer [rad]. */
static double decide(struct controller *x, double error_m)
{
    double change_m = x->sent == 0 ? 0.0 : error_m - x->error_m;
    double decay = 1.0 / (1.0 + FILTER_RAD_S * PERIOD_S);

    x->derivative_m_s = decay * (x->derivative_m_s + FILTER_RAD_S * change_m);
    x->error_m = error_m;
    double steer_rad = -GAIN_RAD_M * error_m - DERIVATIVE_RAD_S_M * x->derivative_m_s;
    return fmin(fmax(steer_rad, -STEER_RAD_MAX), STEER_RAD_MAX);
}

/* Return whether a frame is a measurement, to which ``answer`` is the command. */
static int on_frame(struct controller *x, const struct can_frame *frame, struct can_frame *answer)
{
    struct steer_by_wire_lateral_error_t error;
    struct steer_by_wire_steering_command_t command;

    if (frame->can_id != STEER_BY_WIRE_LATERAL_ERROR_FRAME_ID
        || frame->can_dlc != STEER_BY_WIRE_LATERAL_ERROR_LENGTH
        || steer_by_wire_lateral_error_unpack(&error, frame->data, frame->can_dlc) != 0
        || error.lateral_error_crc != crc_of(frame->data, frame->can_dlc, ERROR_DATA_ID)
        || error.lateral_error_lateral_error == NOT_AVAILABLE_RAW
        || (x->sent > 0 && error.lateral_error_counter == x->counter)) /* repeated */
        return 0;
    x->counter = error.lateral_error_counter;
    double error_m = steer_by_wire_lateral_error_lateral_error_lateral_error_decode(
        error.lateral_error_lateral_error);
    double steer_rad = decide(x, error_m);
    steer_by_wire_steering_command_init(&command);
    /* The generated encoder truncates. */
    command.steer = (int32_t)lrint(steer_rad / STEER_RESOLUTION_RAD);
    command.command_counter = (uint16_t)x->sent;
#ifndef WITHOUT_COUNTER
    command.steering_command_counter = (uint8_t)x->sent;
#endif
    command.steering_command_mode = MODE_ACTIVE;
    memset(answer, 0, sizeof *answer);
    answer->can_id = STEER_BY_WIRE_STEERING_COMMAND_FRAME_ID;
    answer->can_dlc = STEER_BY_WIRE_STEERING_COMMAND_LENGTH;
    steer_by_wire_steering_command_pack(answer->data, &command, sizeof answer->data);
    command.steering_command_crc = crc_of(answer->data, answer->can_dlc, COMMAND_DATA_ID);
    steer_by_wire_steering_command_pack(answer->data, &command, sizeof answer->data);
    x->sent++;
    return 1;
}

static int run_on_lines(struct controller *x)
{
    struct can_frame frame = {0}, answer;
    unsigned int can_id, byte;
    char text[17];

    while (scanf("%x#%16s", &can_id, text) == 2) {
        frame.can_id = can_id;
        frame.can_dlc = (uint8_t)(strlen(text) / 2);
        for (size_t i = 0; i < frame.can_dlc; i++) {
            if (sscanf(text + 2 * i, "%2x", &byte) != 1)
                return 1;
            frame.data[i] = (uint8_t)byte;
        }
        if (on_frame(x, &frame, &answer)) {
            printf("%03X#", answer.can_id);
            for (size_t i = 0; i < answer.can_dlc; i++)
                printf("%02X", answer.data[i]);
            printf("\n");
        }
    }
    return 0;
}

static int run_on_bus(struct controller *x, const char *interface)
{
    struct can_filter filter = {STEER_BY_WIRE_LATERAL_ERROR_FRAME_ID, CAN_SFF_MASK | CAN_EFF_FLAG};
    struct sockaddr_can address = {.can_family = AF_CAN};
    struct can_frame frame, answer;
    int descriptor = socket(PF_CAN, SOCK_RAW, CAN_RAW);

    address.can_ifindex = (int)if_nametoindex(interface);
    if (descriptor < 0 || address.can_ifindex == 0
        || setsockopt(descriptor, SOL_CAN_RAW, CAN_RAW_FILTER, &filter, sizeof filter) != 0
        || bind(descriptor, (struct sockaddr *)&address, sizeof address) != 0) {
        perror(interface);
        return 1;
    }
    printf("ready\n");
    fflush(stdout);
    struct pollfd waiting = {.fd = descriptor, .events = POLLIN};
    while (poll(&waiting, 1, x->sent == 0 ? PATIENCE_MS : SILENCE_MS) > 0) {
        if (read(descriptor, &frame, sizeof frame) != (ssize_t)sizeof frame)
            return 1;
        if (on_frame(x, &frame, &answer)
            && write(descriptor, &answer, sizeof answer) != (ssize_t)sizeof answer)
            return 1;
    }
    printf("%lu commands sent\n", x->sent);
    return 0;
}

int main(int count, char **arguments)
{
    struct controller x = {0};

    if (count != 2) {
        fprintf(stderr, "usage: %s INTERFACE, or - for standard input\n", arguments[0]);
        return 2;
    }
    return strcmp(arguments[1], "-") == 0 ? run_on_lines(&x) : run_on_bus(&x, arguments[1]);
}
