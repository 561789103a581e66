/* The test on a bare Cortex-M4F under QEMU (mps2-an386): instructions by SysTick under -icount, stack by painting. */
#include <stdint.h>

#include "test_spinfilter.h"

#define SYSTICK_CONTROL (*(volatile uint32_t *)0xE000E010u)
#define SYSTICK_RELOAD (*(volatile uint32_t *)0xE000E014u)
#define SYSTICK_VALUE (*(volatile uint32_t *)0xE000E018u)
#define COPROCESSORS (*(volatile uint32_t *)0xE000ED88u)
#define PAINT 0xA5A5A5A5u
#define CALIBRATION 100000u

extern uint32_t stack_bottom[], stack_top[], data_begin[], data_end[], data_load[], bss_begin[], bss_end[];
static uint32_t began, most[MEASURED_COUNT], total[MEASURED_COUNT], times[MEASURED_COUNT], stack_used;

void start(void);
static void fault(void);
__attribute__((section(".vectors"), used)) static void (*const vectors[])(void) = {
  (void (*)(void))stack_top, start, fault, fault, fault, fault, fault};

static int host(int operation, const void *argument) /* semihosting */
{
  register int r0 __asm__("r0") = operation;
  register const void *r1 __asm__("r1") = argument;
  __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
  return r0;
}

static void say(const char *text) { host(0x04, text); }

static void say_number(const char *name, uint32_t value)
{
  char digits[12], *at = digits + sizeof digits;
  *--at = 0;
  *--at = '\n';
  do *--at = (char)('0' + value % 10); /* digits from the last to the first */
  while (value /= 10);
  say(name);
  say(at);
}

static void leave(int wrong)
{
  host(0x18, (void *)(wrong ? 0x20023 : 0x20026)); /* ADP_Stopped_RunTimeErrorUnknown, ADP_Stopped_ApplicationExit */
  for (;;) {}
}

static void fault(void)
{
  say("FAULT\n");
  leave(1);
}

void measure_begin(void)
{
  uint32_t *sp;
  __asm__ volatile("mov %0, sp" : "=r"(sp));
  /* paint the stack below this frame, with eight words to spare */
  for (uint32_t *at = stack_bottom; at < sp - 8; ++at) *at = PAINT;
  began = SYSTICK_VALUE;
}

void measure_end(enum measured what)
{
  const uint32_t ticks = (began - SYSTICK_VALUE) & 0xFFFFFFu;
  if (ticks > most[what]) most[what] = ticks;
  total[what] += ticks;
  ++times[what];
  uint32_t *at = stack_bottom;
  /* the lowest word without paint is the deepest that was used */
  while (at < stack_top && *at == PAINT) ++at;
  const uint32_t used = (uint32_t)((char *)stack_top - (char *)at);
  if (used > stack_used) stack_used = used;
}

static uint32_t instructions(uint32_t ticks, uint32_t calibration) /* 64-bit division by hand: no helper is linked */
{
  return (uint32_t)((float)ticks * (2.0f * (float)CALIBRATION / (float)calibration));
}

int main(void)
{
  uint32_t count = CALIBRATION;
  const uint32_t before = SYSTICK_VALUE;
  __asm__ volatile("1: subs %0, #1\n bne 1b" : "+r"(count)::"cc"); /* two instructions each */
  const uint32_t calibration = (before - SYSTICK_VALUE) & 0xFFFFFFu;
  sf_real worst;
  const int wrong = test_spinfilter(&worst);
  say(wrong ? "FAILED\n" : "passed\n");
  say_number("departure_millionths ", (uint32_t)(worst * (sf_real)1e6));
  say_number("prediction_instructions_mean ", instructions(total[0] / times[0], calibration));
  say_number("prediction_instructions_most ", instructions(most[0], calibration));
  say_number("update_instructions_mean ", instructions(total[1] / times[1], calibration));
  say_number("update_instructions_most ", instructions(most[1], calibration));
  say_number("stack_bytes ", stack_used);
  say_number("bits ", test_bits());
  leave(wrong);
  return wrong;
}

void start(void)
{
  COPROCESSORS |= 0xFu << 20; /* the floating-point unit */
  __asm__ volatile("dsb\n isb");
  /* initial values from flash, then zeros for all other static data, as a C library would do before main */
  for (uint32_t *to = data_begin, *from = data_load; to < data_end;) *to++ = *from++;
  for (uint32_t *to = bss_begin; to < bss_end;) *to++ = 0;
  SYSTICK_RELOAD = 0xFFFFFFu;
  SYSTICK_VALUE = 0;
  SYSTICK_CONTROL = 5;
  main();
}
