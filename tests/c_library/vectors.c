/* The first two words of memory on a Cortex-M, stack and start; a fault ends the emulation by never returning. */
extern unsigned __stack;
extern void _start(void); /* newlib's, with semihosting */

static void hang(void)
{
    for (;;) {
    }
}

__attribute__((section(".vectors"), used)) static const void *const vectors[16] = {
    &__stack, (const void *)_start, (const void *)hang, (const void *)hang,
};
