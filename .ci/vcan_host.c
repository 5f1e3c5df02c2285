/*
 * Loaded before user-mode Linux by .ci/vcan: stands between that kernel and the machine it runs on.
 *
 * Registers. Linux 6.1 keeps 2696 bytes of the vector registers of a process. Where the CPU has more, as
 * with AMX, the host refuses to take back a part of them (ptrace(2), PTRACE_SETREGSET: EFAULT) and the
 * kernel panics at its first process. Here the part is completed by what the process has.
 *
 * Clock. The tests measure how long what the programs do takes: time-outs, ramps, cycles. How long a machine takes to
 * compute it, which others share and which runs this kernel slowly, is not what they measure. So the kernel's clock is
 * not the host's:
 * - while nothing runs in it, it leaps to the next timer: waiting takes no time;
 * - while something runs, it runs at 1 / SLOWDOWN of the host's, as if that computed so many times as fast;
 * - while a timer is due and the kernel does not handle it, because the machine does not run the kernel or holds up its
 *   write to a file, it stands SLACK_NS after that.
 * A program that does not answer, answers late, or computes for SLOWDOWN times too long, fails as on a vehicle.
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
#define SLOWDOWN 4

/* User-mode Linux 6.1 has one CPU. SIGALRM, its timer, may come between any two steps here. */
static timer_t timer;               /* its timer */
static volatile int64_t due_ns;     /* the kernel's time at which it is due, 0 where it is off */
static volatile int64_t ahead_ns;   /* how far the kernel's clock is ahead of the host's slowed down */
static volatile int64_t leapt_ns;   /* how much of that it has leapt */
static volatile int64_t longest_ns; /* the longest time by which the timer was late */

static int64_t nanoseconds(struct timespec time)
{
    return time.tv_sec * INT64_C(1000000000) + time.tv_nsec;
}

static struct timespec timespec_of(int64_t ns)
{
    return (struct timespec){ns / 1000000000, ns % 1000000000};
}

static int host_clock(clockid_t clock, struct timespec *time)
{
    static int (*next)(clockid_t, struct timespec *);
    if (!next)
        *(void **)&next = dlsym(RTLD_NEXT, "clock_gettime");
    return next(clock, time);
}

static int host_timer(timer_t which, int flags, const struct itimerspec *set, struct itimerspec *old)
{
    static int (*next)(timer_t, int, const struct itimerspec *, struct itimerspec *);
    if (!next)
        *(void **)&next = dlsym(RTLD_NEXT, "timer_settime");
    return next(which, flags, set, old);
}

/* How late the timer is, beyond the slack; the kernel's time goes to *now_ns. */
static int64_t lateness_ns(int64_t *now_ns)
{
    struct timespec time;
    host_clock(CLOCK_MONOTONIC, &time);
    *now_ns = nanoseconds(time) / SLOWDOWN + ahead_ns;
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
            ahead_ns -= late_ns;
            now_ns -= late_ns;
            if (late_ns > longest_ns)
                longest_ns = late_ns;
        }
        sigprocmask(SIG_SETMASK, &before, NULL);
    }
    *time = timespec_of(now_ns);
    return 0;
}

int timer_settime(timer_t which, int flags, const struct itimerspec *set, struct itimerspec *old)
{
    /* The kernel calls with its interrupts off. A timer that repeats, as it does while it boots, has no one
     * time at which it is due. */
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    int64_t wait_ns = nanoseconds(set->it_value), interval_ns = nanoseconds(set->it_interval);
    int once = wait_ns > 0 && interval_ns == 0 && !(flags & TIMER_ABSTIME);
    timer = which;
    due_ns = once ? nanoseconds(now) + wait_ns : 0;
    struct itimerspec slowed = {timespec_of(SLOWDOWN * interval_ns), timespec_of(SLOWDOWN * wait_ns)};
    return host_timer(which, flags, &slowed, old);
}

/* The kernel waits for an interrupt here, with its timer held off, when nothing is left to run. */
int sigsuspend(const sigset_t *mask)
{
    static int (*next)(const sigset_t *);
    if (!next)
        *(void **)&next = dlsym(RTLD_NEXT, "sigsuspend");
    int64_t now_ns;
    lateness_ns(&now_ns);
    if (due_ns > now_ns) {
        ahead_ns += due_ns - now_ns;
        leapt_ns += due_ns - now_ns;
        struct itimerspec at_once = {{0, 0}, {0, 1}};
        host_timer(timer, 0, &at_once, NULL);
    }
    return next(mask);
}

/* At the kernel's end. */
__attribute__((destructor)) static void tell(void)
{
    if (leapt_ns > 0) /* not a helper of the kernel's */
        fprintf(stderr, "vcan: the kernel waited for %.0f s, which took no time; the machine held it up for %.3f s at most\n",
                leapt_ns * 1e-9, longest_ns * 1e-9);
}
