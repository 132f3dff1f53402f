/* The CRC of E2E profile 5 in the first bytes of a payload. */
#include "node_rules.h"

enum { CRC_START = 0xFFFF, CRC_POLYNOMIAL = 0x1021, CRC_BYTES = 2 };

static uint16_t with_byte(uint16_t crc, int byte)
{
    crc = (uint16_t)(crc ^ (byte << 8));
    for (int bit = 0; bit < 8; bit++)
        crc = (uint16_t)((crc << 1) ^ ((crc & 0x8000) ? CRC_POLYNOMIAL : 0));
    return crc;
}

uint16_t crc_of(const struct frame *frame, uint16_t data_id)
{
    uint16_t crc = CRC_START;

    for (int i = CRC_BYTES; i < frame->length; i++)
        crc = with_byte(crc, frame->data[i]);
    return with_byte(with_byte(crc, data_id & 0xFF), data_id >> 8);
}
