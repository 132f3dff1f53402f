/* Records of a Cortex-M7 under QEMU: semihosting lends it QEMU's standard input and output.
 *
 *   qemu-system-arm -M mps2-an500 -nographic -serial none -monitor none
 *       -semihosting-config enable=on,target=native -icount shift=0,sleep=off -kernel on_m7.elf
 *
 * Start-up, semihosting calls, and the functions of the C library that the others need.
 */
#include <stddef.h>
#include <stdint.h>

#include "lockstep.h"

enum { SYS_OPEN = 0x01, SYS_WRITE = 0x05, SYS_READ = 0x06, SYS_EXIT = 0x18 };
enum { READ_BINARY = 1, WRITE_BINARY = 5, STOPPED = 0x20026 };

#define COPROCESSOR_ACCESS (*(volatile uint32_t *)0xE000ED88u)

int main(void);
extern uint32_t stack_top[], data_in_flash[], data_start[], data_end[], bss_start[], bss_end[];
void reset(void);

__attribute__((section(".vectors"), used)) static void *const vectors[] = {stack_top, (void *)reset};

static uintptr_t input, output;

void *memcpy(void *to, const void *from, size_t size)
{
    uint8_t *written = to;
    const uint8_t *read = from;

    while (size--)
        *written++ = *read++;
    return to;
}

void *memset(void *to, int value, size_t size)
{
    uint8_t *written = to;

    while (size--)
        *written++ = (uint8_t)value;
    return to;
}

int memcmp(const void *one, const void *other, size_t size)
{
    const uint8_t *left = one, *right = other;

    for (; size > 0; size--, left++, right++)
        if (*left != *right)
            return *left < *right ? -1 : 1;
    return 0;
}

static uintptr_t semihosting(uintptr_t operation, const void *arguments)
{
    register uintptr_t r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = arguments;

    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static uintptr_t opened(const char *name, uintptr_t mode, uintptr_t length)
{
    const uintptr_t arguments[] = {(uintptr_t)name, mode, length};

    return semihosting(SYS_OPEN, arguments);
}

/* Read or write all of a record; both calls return how many bytes are left. */
static int moved(uintptr_t operation, uintptr_t file, const void *record)
{
    uintptr_t left = sizeof(struct lockstep_record);

    while (left > 0) {
        uintptr_t position = (uintptr_t)record + sizeof(struct lockstep_record) - left;
        const uintptr_t arguments[] = {file, position, left};
        uintptr_t still = semihosting(operation, arguments);

        if (still >= left) /* the end of the input */
            return 0;
        left = still;
    }
    return 1;
}

int read_record(struct lockstep_record *record)
{
    return moved(SYS_READ, input, record) && LOCKSTEP_IS_SOUND(record);
}

int write_record(const struct lockstep_record *record)
{
    return moved(SYS_WRITE, output, record);
}

void reset(void)
{
    COPROCESSOR_ACCESS |= 0xFu << 20; /* the FPU */
    __asm__ volatile("dsb\n isb");
    memcpy(data_start, data_in_flash, (size_t)((uint8_t *)data_end - (uint8_t *)data_start));
    memset(bss_start, 0, (size_t)((uint8_t *)bss_end - (uint8_t *)bss_start));
    input = opened("/dev/stdin", READ_BINARY, 10);
    output = opened("/dev/stdout", WRITE_BINARY, 11);
    main();
    semihosting(SYS_EXIT, (const void *)STOPPED);
    for (;;)
        ;
}
