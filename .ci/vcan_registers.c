/*
 * Loaded before user-mode Linux by .ci/vcan. Linux 6.1 keeps 2696 bytes of the vector registers of a
 * process. Where the CPU has more, as with AMX, the host refuses to take back a part of them
 * (ptrace(2), PTRACE_SETREGSET: EFAULT) and the kernel panics at its first process. Here the part is
 * completed by what the process has.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

long ptrace(enum __ptrace_request request, ...)
{
    static long (*next)(enum __ptrace_request, ...);
    /* User-mode Linux 6.1 has one CPU and one thread that asks. */
    static char registers[1 << 16] __attribute__((aligned(64)));

    va_list arguments;
    va_start(arguments, request);
    pid_t process = va_arg(arguments, pid_t);
    void *address = va_arg(arguments, void *);
    void *data = va_arg(arguments, void *);
    va_end(arguments);

    if (!next)
        *(void **)&next = dlsym(RTLD_NEXT, "ptrace");
    if (request == PTRACE_SETREGSET && (long)address == NT_X86_XSTATE) {
        struct iovec *part = data, whole = {registers, sizeof registers};
        if (next(PTRACE_GETREGSET, process, address, &whole) == 0 && part->iov_len < whole.iov_len) {
            memcpy(registers, part->iov_base, part->iov_len);
            return next(PTRACE_SETREGSET, process, address, &whole);
        }
    }
    return next(request, process, address, data);
}
