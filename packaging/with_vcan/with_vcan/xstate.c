// Lets User Mode Linux run on processors whose XSAVE area is larger than its buffer, as those with AMX.
//
// User Mode Linux 6.1 gets and sets the floating point state of its processes in a buffer of 2696 bytes.
// The host's kernel gives a part of the area, but sets only the whole of it and refuses the rest with
// EFAULT (Linux, arch/x86/kernel/fpu/regset.c). Preloaded into linux.uml, this sets the whole: the
// caller's bytes over those that are there.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <stdarg.h>
#include <stdint.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

typedef long Ptrace(enum __ptrace_request request, ...);

static Ptrace *next_ptrace;

__attribute__((constructor)) static void find_next(void)
{
    next_ptrace = (Ptrace *)dlsym(RTLD_NEXT, "ptrace");
}

long ptrace(enum __ptrace_request request, ...)
{
    va_list rest;
    va_start(rest, request);
    pid_t pid = va_arg(rest, pid_t);
    void *address = va_arg(rest, void *);
    void *data = va_arg(rest, void *);
    va_end(rest);

    static char area[65536];
    struct iovec whole = {area, sizeof area};
    if (request == PTRACE_SETREGSET && (uintptr_t)address == NT_X86_XSTATE &&
        next_ptrace(PTRACE_GETREGSET, pid, address, &whole) == 0) {
        const struct iovec *given = data;
        if (given->iov_len < whole.iov_len) {
            memcpy(area, given->iov_base, given->iov_len);
            data = &whole;
        }
    }
    return next_ptrace(request, pid, address, data);
}
