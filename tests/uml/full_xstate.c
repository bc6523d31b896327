/* User-mode Linux 6.1 on processors with AMX: its buffer for the floating-point state has 4 kB, the state 11 kB, and the
 * kernel refuses to set a part (EFAULT). Here the whole state is read, the known part replaced, and the whole set.
 * Preloaded into the user-mode kernel by tests/uml/boot.py; nothing else needs it. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

#define XSTATE 0x202 /* NT_X86_XSTATE */
#define WHOLE 65536

long ptrace(enum __ptrace_request request, ...)
{
    static long (*original)(enum __ptrace_request, pid_t, void *, void *);
    static char whole[WHOLE];
    va_list arguments;
    pid_t pid;
    void *address, *data;

    va_start(arguments, request);
    pid = va_arg(arguments, pid_t);
    address = va_arg(arguments, void *);
    data = va_arg(arguments, void *);
    va_end(arguments);
    if (!original)
        original = (long (*)(enum __ptrace_request, pid_t, void *, void *))dlsym(RTLD_NEXT, "ptrace");
    if (request == PTRACE_SETREGSET && address == (void *)XSTATE) {
        struct iovec *known = data;
        struct iovec all = {whole, WHOLE};
        long result = original(PTRACE_GETREGSET, pid, address, &all);

        if (result < 0)
            return result;
        if (known->iov_len < all.iov_len) {
            memcpy(whole, known->iov_base, known->iov_len);
            return original(PTRACE_SETREGSET, pid, address, &all);
        }
    }
    return original(request, pid, address, data);
}
