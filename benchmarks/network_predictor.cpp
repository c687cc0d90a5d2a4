/// The predictor of `own_world` (two boxes, 0.2 s ahead, two layers of 128): its network beside its
/// contact-free flow, and 50 wrenches tried from one state, at once and one by one.
#include <rbres/predict/predictor.hpp>

#include "network_rows.hpp"

namespace rbres::bench {
namespace {

using Net = rbres::Network<float, Sequential<Linear<38, 128>, Relu, Linear<128, 128>, Relu, Linear<128, 26>>>;
using Boxes = Predictor<Net, 2>;

/// A predictor, untrained, and what it predicts from.
struct Work {
  Boxes boxes{Net(1), {}, {}, {System<double, 2>::of(Body{Box{0.1, 0.08, 0.05}, 1.0}), {}, {.density = 0}}};
  Boxes::State state;
  std::vector<Boxes::Wrenches> wrenches{50};
  std::vector<Boxes::State> next{50};
  Boxes::Batch batch{50};

  Work() {
    boxes.horizon = 0.2;
    state[0].angular_velocity = {1, 2, 3};
    state[1].position = {0.5, 0, 0};
    for (std::size_t i = 0; i < wrenches.size(); ++i) wrenches[i][0].force.x = 0.1 * static_cast<double>(i);
  }
};

/// Calls call(work, wrench) for each of the 50 wrenches.
template <class Call>
auto each(const Call& call) {
  return [call](Work& work) {
    for (const auto& wrench : work.wrenches) benchmark::DoNotOptimize(call(work, wrench));
  };
}

template <class Call>
void row(const char* name, const Call& call) {
  const auto run = [call](benchmark::State& state) {
    Work work;
    measure(state, "us_per_50", 0, [&] {
      call(work);
      benchmark::ClobberMemory();
    });
  };
  benchmark::RegisterBenchmark(name, run)->Unit(benchmark::kMicrosecond);
}

void register_rows() {
  row("own_world/rbres/network", each([](Work& work, const Boxes::Wrenches& wrench) {
        return work.boxes.network.forward(work.boxes.encode(work.state, wrench, 2));
      }));
  row("own_world/flow", each([](Work& work, const Boxes::Wrenches& wrench) {
        return work.boxes.flow(work.state, wrench, work.boxes.horizon);
      }));
  row("candidates/rbres/batch",
      [](Work& work) { work.boxes.predict(work.state, work.wrenches, work.next, work.batch); });
  row("candidates/one_by_one",
      each([](Work& work, const Boxes::Wrenches& wrench) { return work.boxes.predict(work.state, wrench); }));
}

const bool registered = (register_rows(), true);

}  // namespace
}  // namespace rbres::bench
