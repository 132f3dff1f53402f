/* Frames, and the messages in them as raw integers: value = raw * resolution. */
#ifndef MESSAGES_H
#define MESSAGES_H

#include <stdbool.h>
#include <stdint.h>

enum { FORMAT_EXTENDED = 1, FORMAT_REMOTE = 2, FORMAT_FD = 8, FORMAT_BITRATE_SWITCH = 16 };

struct frame {
    uint32_t can_id;
    uint8_t length, format, data[64];
};

struct signal {
    uint16_t start; /* of its lowest bit */
    uint8_t length; /* [bits] */
    bool is_signed;
    int32_t minimum, maximum; /* of the raw */
    double resolution;
};

struct message {
    uint32_t can_id;
    uint16_t data_id; /* of E2E profile 5 */
    uint8_t length, format;
    uint8_t count; /* of signals */
    int64_t cycle_ns;
    const struct signal *signals;
};

/* To the nearest raw, halves to even. */
int32_t raw_of(const struct message *message, int signal, double value);
double value_of(const struct message *message, int signal, int32_t raw);

/* The frame of a message; raws are in their ranges. */
struct frame packed(const struct message *message, const int32_t *raws, uint8_t counter);

/* Whether a frame has this message's format and length, an intact CRC and raws in their ranges. */
bool unpacked(const struct message *message, const struct frame *frame, int32_t *raws);

#endif
