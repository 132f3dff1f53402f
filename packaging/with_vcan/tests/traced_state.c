// Traces a child, sets the first 576 bytes of its floating point state, and prints one line each: how
// many bytes the whole has, what the kernel answers, whether the child then has what was set and
// keeps the rest, and what the three PEEK requests return with errno.
#include <elf.h>
#include <errno.h>
#include <signal.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/uio.h>
#include <sys/user.h>
#include <sys/wait.h>
#include <unistd.h>

enum { SHORT_BYTES = 576, XMM0 = 160 }; // header included; place of xmm0 (Intel SDM volume 1, 13.4)

static long minus_one = -1, answer = 42;
static unsigned char ymm0[32];
static unsigned char before[65536], after[65536];

static size_t get(pid_t child, unsigned char *area)
{
    struct iovec whole = {area, sizeof before};
    return ptrace(PTRACE_GETREGSET, child, (void *)NT_X86_XSTATE, &whole) == 0 ? whole.iov_len : 0;
}

static void peek(const char *what, int request, pid_t child, uintptr_t address)
{
    errno = 0;
    long word = ptrace(request, child, (void *)address, NULL);
    printf("%s %ld errno %d\n", what, word, errno);
}

int main(void)
{
    memset(ymm0, 0xC3, sizeof ymm0);
    pid_t child = fork();
    if (child == 0) {
        ptrace(PTRACE_TRACEME, 0, NULL, NULL);
        __asm__ volatile("vmovups %0, %%ymm0\n\tint3" ::"m"(ymm0) : "xmm0");
        _exit(0);
    }
    waitpid(child, NULL, 0);

    size_t bytes = get(child, before);
    printf("whole %zu\n", bytes);
    unsigned char wanted[65536];
    memcpy(wanted, before, sizeof wanted);
    memset(wanted + XMM0, 0x3C, 16);
    struct iovec part = {wanted, SHORT_BYTES};
    long result = ptrace(PTRACE_SETREGSET, child, (void *)NT_X86_XSTATE, &part);
    printf("set %ld errno %d\n", result, result ? errno : 0);
    get(child, after);
    printf("set as wanted %d, the same as before %d\n", memcmp(after, wanted, bytes) == 0,
           memcmp(after, before, bytes) == 0);

    part.iov_len = bytes;
    result = ptrace(PTRACE_SETREGSET, child, (void *)NT_X86_XSTATE, &part);
    get(child, after);
    printf("whole set %ld, as wanted %d\n", result, memcmp(after, wanted, bytes) == 0);

    peek("data", PTRACE_PEEKDATA, child, (uintptr_t)&answer);
    peek("data of -1", PTRACE_PEEKDATA, child, (uintptr_t)&minus_one);
    peek("text", PTRACE_PEEKTEXT, child, (uintptr_t)&minus_one);
    peek("nowhere", PTRACE_PEEKDATA, child, 8);
    peek("orig_rax", PTRACE_PEEKUSER, child, offsetof(struct user, regs.orig_rax));
    peek("no register", PTRACE_PEEKUSER, child, 1);
    struct user_regs_struct all;
    result = ptrace(PTRACE_GETREGS, child, NULL, &all);
    errno = 0;
    long rip = ptrace(PTRACE_PEEKUSER, child, (void *)offsetof(struct user, regs.rip), NULL);
    printf("registers %ld, rip the same %d\n", result, (unsigned long)rip == all.rip);
    kill(child, SIGKILL);
    waitpid(child, NULL, 0);
    return 0;
}
