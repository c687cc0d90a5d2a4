// A learned predictor in a control loop: a ball bounces about a room with others, and sideways pushes are to
// keep it over a mark on the floor. Ten times a second the loop predicts what each of nine pushes would lead
// to, and gives the best one. Deciding allocates nothing, which is proven by counting.
#include <chrono>
#include <cstdio>
#include <exception>
#include <rbres/io.hpp>
#include <rbres/paper/paper.hpp>
#include <rbres/rbres.hpp>

#include "common/count_allocations.hpp"
#include "common/help.hpp"

namespace {

using namespace rbres;

constexpr const char* usage =
    "usage: control_loop [MODEL] [--help]\n"
    "Pushes a ball about a room to keep it over a mark, by what a learned predictor says of each push, and "
    "prints how\n"
    "near it stays and how long deciding takes.\n"
    "  MODEL  a model of rbres_train --world room --network shallow; none: trains one for some seconds\n"
    "Exit status: 0; 1 where deciding allocates; 2 with one line that says what is wrong.\n";

using Net = Network<float, Sequential<Linear<95, 256>, Relu, Linear<256, 256>, Relu, Linear<256, 65>>>;
using BallPredictor = Predictor<Net, 5>;
constexpr auto balls = BodySet::standard;

BallPredictor trained() {
  std::printf("training ...\n");
  const ScenarioData data = generate(ScenarioSampler<balls>(World::room, 1), 0, 6'000, {0.1});
  BallPredictor predictor{Net(1), {}, {}, free_flow<balls>(), Target::residual};
  const TrainingSet<BallPredictor> set(predictor, ScenarioTransitions(data, 0), 600, data.count());
  Trainer trainer(predictor.network, set.samples(600, data.count() - 600), set.samples(0, 600),
                  {.epochs = 10});
  trainer.train();
  predictor.network = trainer.best();
  return predictor;
}

BallPredictor loaded(const char* path) {
  const SafetensorsReader file(path);
  file.require_digest("; train it again");
  require_metadata(file, {{"world", "room"}, {"set", "standard"}});
  return ModelFormat<BallPredictor>::read(file);
}

using State = BallPredictor::State;

/// How far ball 0 would be from the point above the mark (1, 1) after `ahead` seconds with its velocity, m.
double distance(const State& y, double ahead = 0) {
  return std::hypot(y[0].position.x + ahead * y[0].velocity.x - 1,
                    y[0].position.y + ahead * y[0].velocity.y - 1);
}

/// The push on ball 0, N, after which `predict` sees it nearest to the mark.
template <class Predict>
Vec3<double> best_push(const Predict& predict, const State& state, BallPredictor::Wrenches wrench,
                       int present) noexcept {
  Vec3<double> best{};
  double least = std::numeric_limits<double>::infinity();
  for (const double x : {-4.0, 0.0, 4.0}) {
    for (const double y : {-4.0, 0.0, 4.0}) {
      wrench[0].force = {x, y, 0};
      const double found = distance(predict(state, wrench, present), 0.7);
      if (found < least) least = found, best = wrench[0].force;
    }
  }
  return best;
}

/// Pushes for 20 s by decide(state, wrench, present) and prints how that went; how many allocations deciding
/// took.
template <class Decide>
long steer(const char* how, double period, const Decide& decide) {
  const Scenario start = ScenarioSampler<balls>(World::room, 2)(0);
  const SimulatedScenario<balls> world{World::room, {.step = 5e-3, .duration = period}};
  State state = start.state;
  BallPredictor::Wrenches wrench = start.wrench;
  const int steps = static_cast<int>(std::lround(20 / period));
  std::chrono::duration<double, std::micro> thinking{};
  long allocated = 0;
  double sum = 0;
  for (int step = 0; step < steps; ++step) {
    const long before = allocations;
    const auto asked = std::chrono::steady_clock::now();
    wrench[0].force = decide(state, wrench, start.bodies);
    thinking += std::chrono::steady_clock::now() - asked;
    allocated += allocations - before;
    state = world(state, wrench, start.bodies);
    sum += distance(state);
  }
  std::printf("%-34s %6.2f m from the mark on average; %d decisions, %.1f us each, %ld allocations\n", how,
              sum / steps, steps, thinking.count() / steps, allocated);
  return allocated;
}

}  // namespace

int main(int argc, char** argv) try {
  if (asks_for_help(argc, argv)) return print_help(argv, usage);
  for (int i = 1; i < argc; ++i)
    if (i > 1 || argv[i][0] == '-') return refuse_argument(argv, argv[i]);
  const BallPredictor predictor = argc > 1 ? loaded(argv[1]) : trained();
  const ContactFree flow{predictor.flow, predictor.horizon};
  const auto network = [&](const auto&... at) { return predictor.predict(at...); };
  steer("no pushes", predictor.horizon, [](const auto&...) { return Vec3<double>{}; });
  steer("pushes by the contact-free flow", predictor.horizon,
        [&](const auto&... at) { return best_push(flow, at...); });
  const long allocated = steer("pushes by the learned predictor", predictor.horizon,
                               [&](const auto&... at) { return best_push(network, at...); });
  return allocated == 0 ? finish(argv) : 1;
} catch (const std::exception& problem) {
  std::fprintf(stderr, "control_loop: %s\n", problem.what());
  return 2;
}
