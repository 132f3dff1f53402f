/* A controller in C from the DBC alone: it answers every LATERAL_ERROR with a STEERING_COMMAND, the
 * steer of decide.c.
 *
 *   make -f examples/foreign_controller_c/Makefile on_vcan on_lockstep on_m7.elf
 *
 *   ./on_vcan vcan0                                              on a CAN interface
 *   steer-by-wire run --controller-command ./on_lockstep         in virtual time
 *   steer-by-wire run --controller-command 'qemu-system-arm ...' the same, on a Cortex-M7
 *
 * steer_by_wire.c and .h, which cantools writes, know where each signal is. What they do not know:
 * the CRC of AUTOSAR E2E profile 5, and the Data IDs it covers, an attribute of the DBC.
 * With -DWITHOUT_COUNTER it has a deliberate error, for test_controller.py to find.
 */
#include "controller.h"

#include <string.h>

#include "steer_by_wire.h"

enum { COMMAND_DATA_ID = 0x5100, ERROR_DATA_ID = 0x5110, MODE_ACTIVE = 1 };
enum { NOT_AVAILABLE_RAW = -16777216 };

static const double STEER_RESOLUTION_RAD = 1e-5;

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

/* To the nearest, halves to even; the generated encoder truncates. */
static int32_t rounded(double value)
{
    int32_t below = (int32_t)value - (value < (int32_t)value);
    double above = value - below;

    return below + (above > 0.5 || (above == 0.5 && below % 2 != 0));
}

int controller_on_frame(struct controller *x, const struct frame *frame, struct frame *answer)
{
    struct steer_by_wire_lateral_error_t error;
    struct steer_by_wire_steering_command_t command;

    if (frame->can_id != STEER_BY_WIRE_LATERAL_ERROR_FRAME_ID
        || frame->length != STEER_BY_WIRE_LATERAL_ERROR_LENGTH
        || steer_by_wire_lateral_error_unpack(&error, frame->data, frame->length) != 0
        || error.lateral_error_crc != crc_of(frame->data, frame->length, ERROR_DATA_ID)
        || error.lateral_error_lateral_error == NOT_AVAILABLE_RAW
        || (x->sent > 0 && error.lateral_error_counter == x->counter)) /* repeated */
        return 0;
    x->counter = error.lateral_error_counter;
    double error_m = steer_by_wire_lateral_error_lateral_error_lateral_error_decode(
        error.lateral_error_lateral_error);
    x->steer_rad = decide(error_m, x->steer_rad, x->sent == 0);
    steer_by_wire_steering_command_init(&command);
    command.steer = rounded(x->steer_rad / STEER_RESOLUTION_RAD);
    command.command_counter = (uint16_t)x->sent;
#ifndef WITHOUT_COUNTER
    command.steering_command_counter = (uint8_t)x->sent;
#endif
    command.steering_command_mode = MODE_ACTIVE;
    answer->can_id = STEER_BY_WIRE_STEERING_COMMAND_FRAME_ID;
    answer->length = STEER_BY_WIRE_STEERING_COMMAND_LENGTH;
    steer_by_wire_steering_command_pack(answer->data, &command, sizeof answer->data);
    command.steering_command_crc = crc_of(answer->data, answer->length, COMMAND_DATA_ID);
    steer_by_wire_steering_command_pack(answer->data, &command, sizeof answer->data);
    x->sent++;
    return 1;
}
