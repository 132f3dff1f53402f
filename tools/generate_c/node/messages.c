#include "messages.h"

enum { CRC_START = 0xFFFF, CRC_POLYNOMIAL = 0x1021, CRC_BYTES = 2, COUNTER_BYTE = 2 };

static uint16_t with_byte(uint16_t crc, uint8_t byte)
{
    crc = (uint16_t)(crc ^ (byte << 8));
    for (int bit = 0; bit < 8; bit++)
        crc = (uint16_t)((crc << 1) ^ ((crc & 0x8000) ? CRC_POLYNOMIAL : 0));
    return crc;
}

/* The CRC of what follows it in a payload, and of the Data ID, which is not sent. */
static uint16_t crc_of(const struct message *message, const uint8_t *data)
{
    uint16_t crc = CRC_START;

    for (int i = CRC_BYTES; i < message->length; i++)
        crc = with_byte(crc, data[i]);
    crc = with_byte(crc, (uint8_t)(message->data_id & 0xFF));
    return with_byte(crc, (uint8_t)(message->data_id >> 8));
}

int32_t raw_of(const struct message *message, int signal, double value)
{
    const double exact = value / message->signals[signal].resolution;
    const int32_t truncated = (int32_t)exact;
    const int32_t below = truncated - (exact < truncated ? 1 : 0);
    const double above = exact - below;

    return below + (above > 0.5 || (above == 0.5 && below % 2 != 0) ? 1 : 0);
}

double value_of(const struct message *message, int signal, int32_t raw)
{
    return raw * message->signals[signal].resolution;
}

struct frame packed(const struct message *message, const int32_t *raws, uint8_t counter)
{
    struct frame frame = {message->can_id, message->length, message->format, {0}};

    frame.data[COUNTER_BYTE] = counter;
    for (int i = 0; i < message->count; i++) {
        const struct signal *signal = &message->signals[i];
        const uint64_t mask = ((uint64_t)1 << signal->length) - 1;
        uint64_t bits = ((uint64_t)(uint32_t)raws[i] & mask) << (signal->start % 8);

        for (int byte = signal->start / 8; bits != 0; byte++, bits >>= 8)
            frame.data[byte] = (uint8_t)(frame.data[byte] | (bits & 0xFF));
    }
    const uint16_t crc = crc_of(message, frame.data);
    frame.data[0] = (uint8_t)(crc & 0xFF);
    frame.data[1] = (uint8_t)(crc >> 8);
    return frame;
}

bool unpacked(const struct message *message, const struct frame *frame, int32_t *raws)
{
    if (frame->format != message->format || frame->length != message->length)
        return false;
    if ((frame->data[0] | frame->data[1] << 8) != crc_of(message, frame->data))
        return false;
    for (int i = 0; i < message->count; i++) {
        const struct signal *signal = &message->signals[i];
        const int first = signal->start / 8, last = (signal->start + signal->length - 1) / 8;
        const int64_t values = (int64_t)1 << signal->length;
        uint64_t bits = 0;

        for (int byte = last; byte >= first; byte--)
            bits = bits << 8 | frame->data[byte];
        int64_t raw = (int64_t)(bits >> (signal->start % 8)) & (values - 1);
        if (signal->is_signed && raw >= values / 2)
            raw -= values;
        if (raw < signal->minimum || raw > signal->maximum)
            return false;
        raws[i] = (int32_t)raw;
    }
    return true;
}
