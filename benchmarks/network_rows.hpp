#pragma once

#include <benchmark/benchmark.h>
#include <time.h>

#include <algorithm>
#include <chrono>
#include <rbres/nn/nn.hpp>
#include <string>
#include <utility>
#include <vector>

/// What the rows of all libraries share, so that they are measured alike.
namespace rbres::bench {

template <int Blocks>
using Network = ResidualNetwork<float, 95, 256, Blocks, 65>;

/// Seconds of this thread's processor time, which other work on the machine disturbs less than wall time.
inline double thread_seconds() {
  timespec now;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}
inline double wall_seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

inline double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Floating-point operations a second of nothing but float multiply-adds in registers, measured over at least
/// `seconds`. Not inlined, so that it is the same code everywhere.
[[gnu::noinline]] inline double peak(double seconds) {
  using Register = detail::Simd<float>;
  constexpr int registers = detail::simd_bytes == 64 ? 24 : 12, rounds = 5000;
  Register sum[registers]{};
  const Register factor = Register{} + 0.5f, term = Register{} + 1.0f;
  const double start = thread_seconds();
  double passed = 0, operations = 0;
  while (passed < seconds) {
    for (int i = 0; i < rounds; ++i) {
#pragma GCC unroll 24
      for (int r = 0; r < registers; ++r) {
        sum[r] = sum[r] * factor + term;
#if defined(__AVX512F__)
        asm volatile("" : "+v"(sum[r]));
#else
        asm volatile("" : "+x"(sum[r]));
#endif
      }
    }
    operations += 2.0 * rounds * registers * detail::simd_width<float>;
    passed = thread_seconds() - start;
  }
  return operations / passed;
}

/// Seconds to read all of a network's parameters once and do nothing with them: no inference is faster.
template <int Blocks>
double read_seconds() {
  using Register = detail::Simd<float>;
  const Network<Blocks> network(1);
  std::vector<double> seconds;
  for (int round = 0; round < 200; ++round) {
    Register sum[8]{};
    const double start = thread_seconds();
    for (const float *from = network.parameters().data(), *end = from + network.block_size / 128 * 128;
         from < end;)
      for (Register& s : sum) s += detail::load(std::exchange(from, from + detail::simd_width<float>));
    for (Register& s : sum) benchmark::DoNotOptimize(s);
    seconds.push_back(thread_seconds() - start);
  }
  return median(seconds);
}

/// Times `call`, each time beside as long a slice of the processor's peak: other work on the machine, and a
/// clock that falls under load, touch both alike. Counters: the median time under the name `time_counter`,
/// and peak_share, the median share of the peak, for `operations` floating-point operations in a call on one
/// core (0: no share).
template <class Call>
void measure(benchmark::State& state, const std::string& time_counter, double operations, const Call& call,
             double (*clock)() = thread_seconds) {
  std::vector<double> seconds, shares;
  call();
  for (auto _ : state) {
    const double start = clock();
    call();
    seconds.push_back(clock() - start);
    if (operations <= 0) continue;
    state.PauseTiming();
    shares.push_back(operations / seconds.back() / peak(seconds.back()));
    state.ResumeTiming();
  }
  state.counters[time_counter] = 1e6 * median(seconds);
  if (operations > 0) state.counters["peak_share"] = median(shares);
}

/// Floating-point operations of one sample's forward pass, multiplications and additions of the matrices
/// alone.
constexpr double forward_operations(int blocks) {
  return 2.0 * (95 * 256 + 2 * blocks * 256 * 256 + 256 * 65);
}

/// "infer/K10/B64/rbres"
inline std::string infer_row(int blocks, int batch, const std::string& library) {
  return detail::text("infer/K", blocks, "/B", batch, "/", library);
}
/// "train/K10/B64/T1/rbres"
inline std::string train_row(int blocks, int batch, int threads, const std::string& library) {
  return detail::text("train/K", blocks, "/B", batch, "/T", threads, "/", library);
}

inline constexpr int infer_batches[] = {1, 8, 64, 256, 1024};
inline constexpr int train_batches[] = {64, 1024};

}  // namespace rbres::bench
