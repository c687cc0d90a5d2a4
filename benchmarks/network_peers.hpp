#pragma once

#include <cmath>
#include <cstddef>
#include <numeric>
#include <string>
#include <vector>

#include "network_rows.hpp"
#include "uniform.hpp"

/// The network of the benchmark, described once and in plain C++, so that every library computes the same:
/// 95 -> 256 -> ReLU -> blocks of [x + W2 drop(relu(W1 x + b1)) + b2] -> 65, float32; and the rows of a peer.
namespace rbres::bench {

inline constexpr int inputs = 95, width = 256, outputs = 65;
inline constexpr float dropout = 0.2f, learning_rate = 1e-3f,
                       l2 = 1e-4f;  // l2: the loss carries l2 times the sum of w^2

/// What follows a linear layer; `sum` adds what its block began with.
enum class After { nothing, relu, sum };

/// One linear layer: weights row-major [out][in], bias [out].
struct LinearLayer {
  int in, out;
  After after;
  std::vector<float> weights, bias;
};

/// `count` numbers, uniform in [-bound, bound).
inline std::vector<float> numbers(std::size_t count, double bound, std::uint64_t seed) {
  Uniform uniform(seed);
  std::vector<float> values(count);
  for (float& value : values) value = static_cast<float>(uniform(-bound, bound));
  return values;
}

/// The layers in order: the first, two of each block, the last. He's bound, halved inside the blocks so that
/// the activations stay of order one through any number of them.
inline std::vector<LinearLayer> network(int blocks) {
  std::vector<LinearLayer> layers;
  const auto add = [&](int in, int out, After after, double scale) {
    const std::uint64_t seed = 2 * layers.size();
    layers.push_back({in, out, after,
                      numbers(static_cast<std::size_t>(in * out), scale * std::sqrt(6.0 / in), seed),
                      numbers(static_cast<std::size_t>(out), 0.1, seed + 1)});
  };
  add(inputs, width, After::relu, 1.0);
  for (int i = 0; i < blocks; ++i) {
    add(width, width, After::relu, 0.5);
    add(width, width, After::sum, 0.5);
  }
  add(width, outputs, After::nothing, 1.0);
  return layers;
}

/// `batch` samples of `features` numbers, one after the other.
inline std::vector<float> samples(int batch, int features) {
  return numbers(static_cast<std::size_t>(batch * features), 1.0,
                 1000 + static_cast<std::uint64_t>(features));
}

/// One row of inference. Library(layers, batch) is built outside the time; run(input) returns the outputs.
/// Their root mean square is a counter, so that a reader sees that all peers computed the same.
template <class Library>
void infer(benchmark::State& state, int blocks, int batch) {
  Library library(network(blocks), batch);
  const std::vector<float> input = samples(batch, inputs);
  const float* result = nullptr;
  measure(state, "us_per_call", batch * forward_operations(blocks),
          [&] { benchmark::DoNotOptimize(result = library.run(input.data())); });
  const auto count = static_cast<std::size_t>(batch * outputs);
  state.counters["output_rms"] =
      std::sqrt(std::inner_product(result, result + count, result, 0.0) / double(count));
  state.SetLabel(library.mode());
}

/// Registers infer/K../B../LIBRARY for all sizes.
template <class Library>
void register_inference(const std::string& library) {
  for (const int blocks : {10, 4})
    for (const int batch : infer_batches)
      benchmark::RegisterBenchmark(infer_row(blocks, batch, library).c_str(), infer<Library>, blocks, batch)
          ->Unit(benchmark::kMicrosecond);
}

}  // namespace rbres::bench
