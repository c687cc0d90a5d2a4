/// The paper's network, 95 -> 256 -> K blocks -> 65, float: inference and training in rbres and, where their
/// packages are found, in libtorch and oneDNN, whose rows stand in network_peers_*.cpp. A whole predictor's
/// rows stand in network_predictor.cpp.
#include <cstdio>
#include <memory>

#include "environment.hpp"
#include "network_rows.hpp"
#include "ratio_reporter.hpp"

namespace rbres::bench {
namespace {

template <class Network, int Blocks>
void infer(benchmark::State& state, int batch) {
  const auto network = std::make_unique<Network>(1);
  typename Network::Workspace workspace;
  const Eigen::MatrixXf inputs = Eigen::MatrixXf::Random(95, batch);
  Eigen::MatrixXf outputs(65, batch);
  measure(state, "us_per_call", batch * forward_operations(Blocks), [&] {
    network->forward(inputs, outputs, workspace);
    benchmark::DoNotOptimize(outputs.data());
  });
}

template <int Blocks>
void train(benchmark::State& state, int batch, int threads) {
  const Eigen::MatrixXf inputs = Eigen::MatrixXf::Random(95, batch),
                        targets = Eigen::MatrixXf::Random(65, batch);
  Trainer trainer(Network<Blocks>(1), {columns(inputs), columns(targets)}, {},
                  {.epochs = 1'000'000'000, .batch_size = batch, .patience = 0, .threads = threads});
  // One epoch is one step: the batch is all the data.
  measure(
      state, "us_per_step", 0, [&] { trainer.run_epoch(); }, threads == 1 ? thread_seconds : wall_seconds);
}

template <int Blocks>
void register_rows() {
  const auto row = [](const std::string& name, auto run) {
    benchmark::RegisterBenchmark(name.c_str(), run)->Unit(benchmark::kMicrosecond);
  };
  for (const int batch : infer_batches)
    row(infer_row(Blocks, batch, "rbres"),
        [batch](benchmark::State& state) { infer<Network<Blocks>, Blocks>(state, batch); });
  // The same with weights of half the size, beside itself.
  using Half = ResidualNetwork<float, 95, 256, Blocks, 65, bfloat16>;
  for (const int batch : {1, 2, 4, 8, 64}) {
    const std::string work = detail::text("half/K", Blocks, "/B", batch);
    row(work + "/rbres/bfloat16", [batch](benchmark::State& state) { infer<Half, Blocks>(state, batch); });
    row(work + "/float", [batch](benchmark::State& state) { infer<Network<Blocks>, Blocks>(state, batch); });
  }
  for (const int batch : train_batches)
    for (const int threads : {1, 2})
      row(train_row(Blocks, batch, threads, "rbres"),
          [=](benchmark::State& state) { train<Blocks>(state, batch, threads); });
}

const bool registered = (register_rows<10>(), register_rows<4>(), true);

}  // namespace
}  // namespace rbres::bench

int main(int argc, char** argv) {
  rbres::bench::settle_environment(argv);
  std::fprintf(stderr, "peak of one core: %.1f GFLOP/s in float, registers of %zu bytes\n",
               1e-9 * rbres::bench::peak(0.05), rbres::detail::simd_bytes);
  std::fprintf(stderr, "to read the parameters once: %.1f us (K10), %.1f us (K4)\n",
               1e6 * rbres::bench::read_seconds<10>(), 1e6 * rbres::bench::read_seconds<4>());
  return rbres::bench::run_benchmarks(argc, argv);
}
