// Start-up of a Cortex-M7, and what console.hpp names by semihosting: Arm's calls to a debugger, which QEMU
// answers, too.
#include "console.hpp"

extern "C" {
extern std::uint32_t data_from, data_begin, data_end, bss_begin, bss_end, stack_bottom, stack_top;
extern void (*const constructors_begin[])();
extern void (*const constructors_end[])();
[[noreturn]] void abort() { stop(3); }
}

namespace {

constexpr std::uint32_t paint = 0xa5a5a5a5;

volatile std::uint32_t& at(std::uint32_t address) {
  return *reinterpret_cast<volatile std::uint32_t*>(address);
}

std::uint32_t debugger(std::uint32_t operation, const void* argument) {
  register std::uint32_t r0 asm("r0") = operation;
  register const void* r1 asm("r1") = argument;
  asm volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
  return r0;
}

/// How often the timer, which counts down 24 bits, has come to zero.
volatile std::uint32_t rounds = 0;
void count_round() { rounds = rounds + 1; }

[[noreturn]] void fault() {
  print("fault\n");
  stop(4);
}

[[noreturn]] void start() {
  at(0xe000ed88) = 0xf << 20;  // CPACR: the floating-point unit
  asm volatile("dsb\n isb");
  at(0xe000e014) = 0xffffff;  // SysTick: counts the processor's clock, with interrupts
  at(0xe000e018) = 0;
  at(0xe000e010) = 7;
  std::uint32_t* here = static_cast<std::uint32_t*>(__builtin_frame_address(0)) - 16;
  for (volatile std::uint32_t* word = &stack_bottom; word < here; ++word) *word = paint;
  const std::uint32_t* from = &data_from;
  for (std::uint32_t* to = &data_begin; to < &data_end; ++to) *to = *from++;
  for (std::uint32_t* to = &bss_begin; to < &bss_end; ++to) *to = 0;
  for (auto constructor = constructors_begin; constructor != constructors_end; ++constructor)
    (*constructor)();
  run();
  stop(5);
}

/// The stack's top, reset, and the other exceptions of the processor.
struct Vectors {
  std::uint32_t* top;
  void (*handlers[15])();
};
[[gnu::section(".vectors"), gnu::used]] const Vectors vectors{
    &stack_top,
    {start, fault, fault, fault, fault, fault, nullptr, nullptr, nullptr, nullptr, fault, fault, nullptr,
     fault, count_round}};

}  // namespace

void print(const char* words) { debugger(4, words); }

void stop(int status) {
  // The program has ended by itself, with this status.
  const std::uint32_t block[2] = {0x20026, static_cast<std::uint32_t>(status)};
  debugger(0x20, block);
  for (;;) {
  }
}

std::uint64_t instructions() {
  // QEMU's -icount shift=0 makes an instruction a nanosecond, and its boards of this kind tick at 25 MHz.
  std::uint32_t high, low;
  do {
    high = rounds;
    low = at(0xe000e018);
  } while (high != rounds);
  return 40 * ((std::uint64_t{high} << 24) + (0xffffff - low));
}

std::uint32_t stack_used() {
  const volatile std::uint32_t* word = &stack_bottom;
  while (word < &stack_top && *word == paint) ++word;
  return static_cast<std::uint32_t>(reinterpret_cast<std::uintptr_t>(&stack_top) -
                                    reinterpret_cast<std::uintptr_t>(word));
}
