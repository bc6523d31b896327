/* The vector table of a Cortex-M, for a program with newlib's semihosting start. */
#include <stdint.h>

extern unsigned __stack;
extern void _start(void);

/* The floating-point unit is off after a reset; on a core without one the register ignores it. */
static void reset(void)
{
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20;
    _start();
}

/* End the emulator with status 1: the semihosting call SYS_EXIT with a reason other than "application exit". */
static void fault(void)
{
    __asm__ volatile("movs r0, #0x18\n movs r1, #0\n bkpt 0xAB");
    for (;;) {
    }
}

typedef union {
    unsigned *stack;
    void (*handler)(void);
} vector;

__attribute__((section(".vectors"), used)) static const vector VECTORS[16] = {
    {.stack = &__stack}, {.handler = reset}, {.handler = fault}, {.handler = fault},
    {.handler = fault},  {.handler = fault}, {.handler = fault},
};
