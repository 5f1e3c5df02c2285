/*
 * Loaded before user-mode Linux by .ci/vcan: stands between that kernel and the machine it runs on.
 *
 * Registers. Linux 6.1 keeps 2696 bytes of the vector registers of a process. Where the CPU has more, as
 * with AMX, the host refuses to take back a part of them (ptrace(2), PTRACE_SETREGSET: EFAULT) and the
 * kernel panics at its first process. Here the part is completed by what the process has.
 *
 * Clock. A shared machine may not run the kernel for tenths of a second, or hold up its write to a file.
 * To the tests that looks like a bus that fell silent. So the kernel's clock waits for its timer: while the
 * interrupt of a timer is due and not handled, the clock stands SLACK_NS after it. Time in which the kernel
 * runs passes as on the host, since its timer is then handled as it falls due: a program that is slow or
 * does not answer fails as before.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <signal.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <time.h>

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

#define SLACK_NS 1000000

/* User-mode Linux 6.1 has one CPU. SIGALRM, its timer, may come between any two steps here. */
static volatile int64_t due_ns;     /* the kernel's time at which its timer is due, 0 where it is off */
static volatile int64_t missing_ns; /* how far the kernel's clock is behind the host's */
static volatile int64_t longest_ns; /* the longest time by which the timer was late */

static int64_t nanoseconds(struct timespec time)
{
    return time.tv_sec * INT64_C(1000000000) + time.tv_nsec;
}

static int host_clock(clockid_t clock, struct timespec *time)
{
    static int (*next)(clockid_t, struct timespec *);
    if (!next)
        *(void **)&next = dlsym(RTLD_NEXT, "clock_gettime");
    return next(clock, time);
}

/* How late the timer is, beyond the slack; the kernel's time goes to *now_ns. */
static int64_t lateness_ns(int64_t *now_ns)
{
    struct timespec time;
    host_clock(CLOCK_MONOTONIC, &time);
    *now_ns = nanoseconds(time) - missing_ns;
    return due_ns == 0 ? 0 : *now_ns - (due_ns + SLACK_NS);
}

int clock_gettime(clockid_t clock, struct timespec *time)
{
    if (clock != CLOCK_MONOTONIC)
        return host_clock(clock, time);
    int64_t now_ns;
    if (lateness_ns(&now_ns) > 0) {
        /* Again, with the timer held off: it changes what is read here. */
        sigset_t alarm, before;
        sigemptyset(&alarm);
        sigaddset(&alarm, SIGALRM);
        sigprocmask(SIG_BLOCK, &alarm, &before);
        int64_t late_ns = lateness_ns(&now_ns);
        if (late_ns > 0) {
            missing_ns += late_ns;
            now_ns -= late_ns;
            if (late_ns > longest_ns)
                longest_ns = late_ns;
        }
        sigprocmask(SIG_SETMASK, &before, NULL);
    }
    time->tv_sec = now_ns / 1000000000;
    time->tv_nsec = now_ns % 1000000000;
    return 0;
}

int timer_settime(timer_t timer, int flags, const struct itimerspec *set, struct itimerspec *old)
{
    static int (*next)(timer_t, int, const struct itimerspec *, struct itimerspec *);
    if (!next)
        *(void **)&next = dlsym(RTLD_NEXT, "timer_settime");
    /* The kernel calls with its interrupts off. A timer that repeats, as it does while it boots, has no one
     * time at which it is due. */
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    int64_t wait_ns = nanoseconds(set->it_value);
    int once = wait_ns > 0 && nanoseconds(set->it_interval) == 0 && !(flags & TIMER_ABSTIME);
    due_ns = once ? nanoseconds(now) + wait_ns : 0;
    return next(timer, flags, set, old);
}

/* At the kernel's end. */
__attribute__((destructor)) static void tell(void)
{
    if (missing_ns > 0)
        fprintf(stderr, "vcan: the machine held up the kernel for %.2f s in all, for %.3f s at most\n",
                missing_ns * 1e-9, longest_ns * 1e-9);
}
