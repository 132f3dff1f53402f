// Preloaded into linux.uml, makes the host one whose processor has AMX, as far as ptrace shows it: the
// XSAVE area has 11008 bytes, and less than all of it cannot be set.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <errno.h>
#include <stdarg.h>
#include <stdint.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

enum { AMX_BYTES = 11008, FILL = 0xA5 };

long ptrace(enum __ptrace_request request, ...)
{
    va_list rest;
    va_start(rest, request);
    pid_t pid = va_arg(rest, pid_t);
    void *address = va_arg(rest, void *);
    struct iovec *data = va_arg(rest, void *);
    va_end(rest);

    long (*host)(enum __ptrace_request, ...) = dlsym(RTLD_NEXT, "ptrace");
    if ((uintptr_t)address != NT_X86_XSTATE ||
        (request != PTRACE_GETREGSET && request != PTRACE_SETREGSET))
        return host(request, pid, address, data);

    static unsigned char area[65536];
    struct iovec real = {area, sizeof area};
    if (host(PTRACE_GETREGSET, pid, address, &real) != 0)
        return -1;
    size_t bytes = real.iov_len < AMX_BYTES ? AMX_BYTES : real.iov_len;
    memset(area + real.iov_len, FILL, bytes - real.iov_len);
    if (data->iov_len > bytes)
        data->iov_len = bytes;
    if (request == PTRACE_GETREGSET) {
        memcpy(data->iov_base, area, data->iov_len);
        return 0;
    }
    // What this host's processor does not have must come back as it was.
    if (data->iov_len < bytes || memcmp((char *)data->iov_base + real.iov_len, area + real.iov_len,
                                        bytes - real.iov_len) != 0) {
        errno = EFAULT;
        return -1;
    }
    real.iov_base = data->iov_base;
    return host(PTRACE_SETREGSET, pid, address, &real);
}
