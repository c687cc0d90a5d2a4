// Objectives that are not columns, tapes, and what the public interface refuses.
#include <doctest/doctest.h>

#include <cstring>
#include <limits>
#include <numeric>
#include <rbres/nn/nn.hpp>
#include <string>

#include "error_of.hpp"

using namespace rbres;

namespace {

using Eigen::Index;
template <class T>
using Matrix = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;

template <class T>
Matrix<T> normal(Index rows, Index columns, std::uint64_t seed) {
  Random random(seed, 97);
  return Matrix<T>::NullaryExpr(rows, columns, [&] { return static_cast<T>(random.normal()); });
}

/// A recurrent use of a network: the state (2 doubles) of an item moves by h times what the network says of
/// it and of the item's constant push (1), for some steps. The value of an item is the squared distance from
/// where a damped pendulum would be, summed over the steps.
template <class Net>
class PendulumRollouts {
  using T = typename Net::Scalar;
  static constexpr int steps = 6, most = 8;
  static constexpr double h = 0.2;
  using State = Eigen::Vector2d;

 public:
  struct Scratch {
    std::vector<Tape<Net>> tapes = std::vector<Tape<Net>>(steps, Tape<Net>(most));
    std::vector<Matrix<double>> states = std::vector<Matrix<double>>(steps + 1, Matrix<double>(2, most));
    Matrix<T> inputs = Matrix<T>(3, most), outputs = Matrix<T>(2, most);
  };

  explicit PendulumRollouts(Index count, std::uint64_t seed) : starts_(normal<double>(3, count, seed)) {}

  Scratch scratch() const { return {}; }
  std::ptrdiff_t count() const { return starts_.cols(); }
  std::ptrdiff_t chunk() const { return most; }
  std::uint64_t digest() const { return static_cast<std::uint64_t>(starts_.cols()); }

  double value(const Net& network, Items items, Scratch& own) const {
    return forward(network, items, {}, own);
  }

  double differentiate(const Net& network, Items items, const DropoutMask& mask, Scratch& own,
                       ParameterGradient<Net>& gradient) const {
    const double value = forward(network, items, mask, own);
    const Index count = std::ssize(items);
    Matrix<double> by_state = Matrix<double>::Zero(2, count);
    for (int t = steps; t-- > 0;) {
      for (Index c = 0; c < count; ++c) by_state.col(c) += 2 * error(own, items, c, t + 1);
      own.tapes[static_cast<std::size_t>(t)].backward(network, (h * by_state).cast<T>(), gradient,
                                                      own.inputs.leftCols(count));
      by_state += own.inputs.leftCols(count).topRows(2).template cast<double>();
    }
    return value;
  }

 private:
  double forward(const Net& network, Items items, DropoutMask mask, Scratch& own) const {
    const Index count = std::ssize(items);
    for (Index c = 0; c < count; ++c) own.states[0].col(c) = start(items, c).template head<2>();
    double sum = 0;
    for (int t = 0; t < steps; ++t) {
      for (Index c = 0; c < count; ++c)
        own.inputs.col(c) << own.states[static_cast<std::size_t>(t)].col(c).template cast<T>(),
            static_cast<T>(start(items, c)[2]);
      mask.seed += 1;  // each step drops others
      own.tapes[static_cast<std::size_t>(t)].record(network, own.inputs.leftCols(count),
                                                    own.outputs.leftCols(count), mask);
      own.states[static_cast<std::size_t>(t + 1)] =
          own.states[static_cast<std::size_t>(t)] + h * own.outputs.template cast<double>();
      for (Index c = 0; c < count; ++c) sum += error(own, items, c, t + 1).squaredNorm();
    }
    return sum;
  }
  Eigen::Vector3d start(Items items, Index c) const {
    return starts_.col(items[static_cast<std::size_t>(c)]);
  }
  State error(const Scratch& own, Items items, Index c, int steps_done) const {
    State truth = start(items, c).template head<2>();
    for (int t = 0; t < steps_done; ++t)
      truth += h * State(truth[1], start(items, c)[2] - std::sin(truth[0]) - 0.3 * truth[1]);
    return own.states[static_cast<std::size_t>(steps_done)].col(c) - truth;
  }

  Matrix<double> starts_;
};

template <class T>
using Recurrent = Network<T, Sequential<Linear<3, 20>, Tanh, Dropout, Linear<20, 2>>>;

template <class Net>
bool same_bits(const Net& a, const Net& b) {
  return std::memcmp(a.parameters().data(), b.parameters().data(),
                     Net::block_size * sizeof(typename Net::Scalar)) == 0;
}

std::vector<std::uint32_t> first_items(std::uint32_t count) {
  std::vector<std::uint32_t> items(count);
  std::iota(items.begin(), items.end(), 0u);
  return items;
}

}  // namespace

TEST_CASE("the gradient of a rollout through time agrees with central differences") {
  using Net = Recurrent<double>;
  const PendulumRollouts<Net> rollouts(8, 1);
  Net net(2);
  auto scratch = rollouts.scratch();
  const auto items = first_items(8);
  const DropoutMask mask{0.3, 4, 5};
  ParameterGradient<Net> gradient, unused;
  const double value = rollouts.differentiate(net, items, mask, scratch, gradient);
  CHECK(value > 1);
  CHECK(rollouts.value(net, items, scratch) != value);  // nothing is dropped
  double worst = 0, length = 0;
  for (const ParameterTensor& tensor : Net::tensors())
    for (int r = 0; r < tensor.rows; ++r)
      for (int c = 0; c < tensor.columns; ++c) {
        double& w = net.parameters()[tensor.index(r, c)];
        const double at = w, step = 1e-5;
        w = at + step;
        const double more = rollouts.differentiate(net, items, mask, scratch, unused);
        w = at - step;
        const double less = rollouts.differentiate(net, items, mask, scratch, unused);
        w = at;
        const double found = gradient.numbers()[tensor.index(r, c)];
        worst = std::max(worst, std::abs((more - less) / (2 * step) - found));
        length += found * found;
      }
  CHECK(worst < 1e-7 * std::sqrt(length));
}

TEST_CASE("a tape's gradients by parameters and inputs are those of the fused path, and add up") {
  using Net =
      Network<double, Sequential<Linear<5, 9>, Silu, Dropout, Residual<Linear<9, 9>>, Tanh, Linear<9, 3>>>;
  const Matrix<double> x = normal<double>(5, 13, 1), y = normal<double>(3, 13, 2);
  const Net net(3);
  const DropoutMask mask{0.4, 1, 2};
  Backpropagation<Net> fused(13);
  fused.run(net, {columns(x), columns(y)}, {}, first_items(13), mask, {}, true);
  AlignedBuffer<double> expected(Net::block_size);
  fused.parameter_gradient(
      {}, [&](std::size_t at, const auto& g, bool) { std::memcpy(expected.data() + at, &g, sizeof g); });

  Tape<Net> tape(20);
  ParameterGradient<Net> sum;
  Matrix<double> outputs(3, 13), by_inputs(5, 13);
  for (int repeat = 0; repeat < 2; ++repeat) {
    tape.record(net, x, outputs, mask);
    tape.backward(net, 2 * (outputs - y) / 13, sum, by_inputs);
  }
  CHECK((by_inputs - fused.input_gradient()).norm() < 1e-14);
  for (std::size_t i = 0; i < Net::block_size; ++i)
    REQUIRE(sum.numbers()[i] == doctest::Approx(2 * expected[i]).epsilon(1e-12));
  sum += ParameterGradient<Net>(sum);
  CHECK(sum.numbers()[0] == doctest::Approx(4 * expected[0]).epsilon(1e-12));

  Net::Workspace workspace;
  Matrix<double> plain(3, 13);
  tape.record(net, x, outputs);
  net.forward(x, plain, workspace);
  CHECK((outputs - plain).norm() < 1e-14);
  tape.record(net, x.leftCols(0), outputs.leftCols(0));  // none is fine
  tape.backward(net, outputs.leftCols(0), sum);
}

TEST_CASE("columns as an objective have the fused path's gradient") {
  using Net = Network<double, Sequential<Linear<5, 9>, Tanh, Linear<9, 3>>>;
  const Matrix<double> x = normal<double>(5, 60, 1), y = normal<double>(3, 60, 2);
  const ColumnsObjective<Net> objective({columns(x), columns(y)});
  static_assert(Objective<ColumnsObjective<Net>, Net> &&
                Objective<PendulumRollouts<Recurrent<float>>, Recurrent<float>>);
  static_assert(!Objective<Samples<double>, Net>);
  const Net net(3);
  auto scratch = objective.scratch();
  ParameterGradient<Net> gradient;
  const auto items = first_items(60);
  const double sum = objective.differentiate(net, items, {}, scratch, gradient);
  CHECK(objective.value(net, items, scratch) == doctest::Approx(sum).epsilon(1e-14));
  Backpropagation<Net> fused(60);
  CHECK(fused.run(net, objective.samples(), {}, items, {}, {}) == doctest::Approx(sum / 60).epsilon(1e-14));
  fused.parameter_gradient({}, [&](std::size_t at, const auto& g, bool) {
    CHECK(gradient.numbers()[at] == doctest::Approx(60 * g[0]).epsilon(1e-12));
  });
}

TEST_CASE_TEMPLATE("rollouts train, to the same bits with any number of threads, and resume", T, float,
                   double) {
  using Net = Recurrent<T>;
  const TrainingOptions options{.epochs = 40,
                                .batch_size = 50,  // 7 chunks, the last of 2 items
                                .schedule = {.kind = Schedule::Kind::cosine, .initial = 1e-2},
                                .l2 = 0,
                                .dropout = 0.05,
                                .seed = 3};
  const auto trainer = [&](int threads) {
    auto own = options;
    own.threads = threads;
    return Trainer(Net(1), PendulumRollouts<Net>(120, 1), PendulumRollouts<Net>(30, 2), own,
                   Averaged<Clipped<Adam>>{{{}, 5.0}, 0.9});
  };
  auto one = trainer(1);
  const double before = one.run_epoch().validation_loss;
  CHECK(one.train() == TrainingStatus::finished);
  CHECK(one.state().progress.best_loss < 0.03 * before);
  CHECK(one.state().history.size() == 40);
  for (const int threads : {2, 3, 5}) {
    auto more = trainer(threads);
    for (int epoch = 0; epoch < 7; ++epoch) more.run_epoch();
    auto resumed = trainer(1);
    resumed.restore([&](auto& state) { state = more.state(); });
    CHECK(resumed.fingerprint() == one.fingerprint());
    resumed.train();
    CHECK(same_bits(resumed.network(), one.network()));
    CHECK(same_bits(resumed.best(), one.best()));
    CHECK(std::ranges::equal(resumed.state().moments, one.state().moments));
  }
}

TEST_CASE("what an objective throws reaches the caller, with any number of threads") {
  using Net = Recurrent<float>;
  struct Throwing : PendulumRollouts<Net> {
    using PendulumRollouts<Net>::PendulumRollouts;
    double differentiate(const Net& network, Items items, const DropoutMask& mask, Scratch& own,
                         ParameterGradient<Net>& gradient) const {
      for (const std::uint32_t item : items)
        if (item == 77) throw std::runtime_error("item 77");
      return PendulumRollouts<Net>::differentiate(network, items, mask, own, gradient);
    }
  };
  // Wide enough that a step of columns is worth two threads.
  using Wide = Network<float, Sequential<Linear<3, 256>, Relu, Linear<256, 256>, Relu, Linear<256, 2>>>;
  const Matrix<float> x = normal<float>(3, 128, 1), y = normal<float>(2, 128, 2);
  Loss<float> loss;
  loss.extra = [](Index sample, auto, auto, auto) -> double {
    if (sample == 77) throw std::runtime_error("sample 77");
    return 0;
  };
  for (const int threads : {1, 2, 4}) {
    CAPTURE(threads);
    const TrainingOptions options{.epochs = 2, .batch_size = 128, .threads = threads};
    Trainer rollouts(Net(1), Throwing(120, 1), {}, options);
    CHECK_THROWS_WITH_AS(rollouts.train(), "item 77", std::runtime_error);
    Trainer columns_trainer(Wide(1), {columns(x), columns(y)}, {}, options, Adam{}, loss);
    CHECK_THROWS_WITH_AS(columns_trainer.train(), "sample 77", std::runtime_error);
    CHECK_THROWS_WITH_AS(mean_loss(Wide(1), {columns(x), columns(y)}, loss, threads), "sample 77",
                         std::runtime_error);
  }
}

TEST_CASE("batches, indices and sizes that do not fit are refused") {
  using Net = Network<float, Sequential<Linear<3, 17>, Relu, Dropout, Linear<17, 2>>>;
  const Matrix<float> x = normal<float>(3, 100, 1), y = normal<float>(2, 100, 2),
                      other = normal<float>(4, 100, 3);
  const Samples<float> samples{columns(x), columns(y)};
  const Net net(1);
  Backpropagation<Net> pass(8);
  const auto run = [&](const std::vector<std::uint32_t>& order, const Samples<float>& s,
                       Loss<float> loss = {}) {
    return error_of([&] { pass.run(net, s, loss, order, {}, {}); });
  };
  CHECK(run(first_items(8), samples) == "");
  CHECK(run(first_items(9), samples) == "Backpropagation::run: samples of a batch: expected 1 to 8, found 9");
  CHECK(run({}, samples) == "Backpropagation::run: samples of a batch: expected 1 to 8, found 0");
  CHECK(run({100}, samples) == "Backpropagation::run: number of a sample: expected less than 100, found 100");
  CHECK(run({1}, {columns(x), columns(other)}) ==
        "Backpropagation::run: samples: targets: expected 2 x 100, found 4 x 100");
  CHECK(run({1}, {columns(other), columns(y)}) ==
        "Backpropagation::run: samples: inputs: expected 3 x 100, found 4 x 100");
  for (const double rate : {1.0, std::nan(""), std::numeric_limits<double>::infinity()}) {
    CAPTURE(rate);
    const DropoutMask mask{.rate = rate};
    const std::string expected = detail::text("DropoutMask::rate: expected below 1, found ", rate);
    CHECK(error_of([&] { pass.run(net, samples, {}, first_items(8), mask, {}); }) == expected);
    Tape<Net> tape(8);
    Matrix<float> outputs(2, 8);
    CHECK(error_of([&] { tape.record(net, x.leftCols(8), outputs, mask); }) == expected);
  }
  CHECK(run({1}, samples, {.output_weights = {1}}) ==
        "Loss::output_weights: expected 2 numbers or none, found 1");
  CHECK(error_of([] { Backpropagation<Net>(0); }) ==
        "Backpropagation: samples: expected 1 to 2^31 - 1, found 0");
  CHECK(error_of([] { Backpropagation<Net>(-5); }) != "");

  CHECK(error_of([&] { mean_loss(net, Samples<float>{}); }) ==
        "mean_loss: samples: expected at least one, found 0");
  CHECK(error_of([&] {
          mean_loss(net, Samples<float>{columns(x), columns(other)});
        }) == "mean_loss: samples: targets: expected 2 x 100, found 4 x 100");
  const Matrix<float> few = y.leftCols(10);
  CHECK(error_of([&] {
          mean_loss(net, Samples<float>{columns(x), columns(few)});
        }) == "mean_loss: samples: targets: expected 2 x 100, found 2 x 10");
  CHECK(error_of([&] { mean_loss(net, samples, Loss<float>{.output_weights = {1, 2, 3}}); }) != "");

  const ColumnsObjective<Net> none(Samples<float>{}), some(samples);
  using Mean = Evaluation<Net, ColumnsObjective<Net>>;
  CHECK(error_of([&] { Mean(some, 2'000'000'000); }) == "threads: expected 0 to 4096, found 2000000000");
  CHECK(error_of([&] { Mean(none, 1); }) == "Evaluation: items: expected at least one, found 0");
  CHECK(error_of([&] { Mean(some, 1).mean(net, none); }) ==
        "Evaluation::mean: items: expected at least one, found 0");

  Tape<Net> tape(8);
  Matrix<float> outputs(2, 9), inputs = x.leftCols(9);
  ParameterGradient<Net> gradient;
  CHECK(error_of([&] { tape.record(net, inputs, outputs); }) ==
        "Tape::record: samples: expected 0 to 8, found 9");
  CHECK(error_of([&] { tape.backward(net, outputs, gradient); }) ==
        "Tape::backward: expected a record() before each, found none");
  tape.record(net, inputs.leftCols(4), outputs.leftCols(4));
  CHECK(error_of([&] { tape.backward(net, outputs, gradient); }) ==
        "Tape::backward: gradient by the outputs: expected 2 x 4, found 2 x 9");
  tape.backward(net, outputs.leftCols(4), gradient);
  CHECK(error_of([&] { tape.backward(net, outputs.leftCols(4), gradient); }) != "");
}

TEST_CASE("what is moved from stays usable") {
  using Net = Network<float, Sequential<Linear<3, 17>, Relu, Linear<17, 2>>>;
  const Matrix<float> x = normal<float>(3, 100, 1), y = normal<float>(2, 100, 2);
  const Samples<float> samples{columns(x), columns(y)};
  Net net(1);
  const Net copy = net, moved = std::move(net);
  CHECK(same_bits(moved, copy));
  CHECK(same_bits(net, Net()));
  CHECK(net.forward(Net::Input::Ones()) == Net::Output::Zero());
  CHECK(same_bits(Net(net), Net()));
  net.parameters()[0] = 1;
  CHECK(!same_bits(net, Net()));
  CHECK(same_bits(Net(), Net(Net())));

  Net::Workspace workspace;
  Net::Workspace other = std::move(workspace);
  Matrix<float> outputs(2, 100), expected(2, 100);
  moved.forward(x, outputs, workspace);
  moved.forward(x, expected, other);
  CHECK(outputs == expected);

  Trainer trainer(copy, samples, samples, {.epochs = 3, .threads = 1});
  trainer.run_epoch();
  auto taken = std::move(trainer);
  trainer.train();
  taken.train();
  CHECK(same_bits(trainer.network(), taken.network()));

  Tape<Net> tape(100);
  Tape<Net> taken_tape = std::move(tape);
  ParameterGradient<Net> gradient;
  ParameterGradient<Net> taken_gradient = std::move(gradient);
  tape.record(moved, x, outputs);
  tape.backward(moved, outputs, gradient);
  CHECK(gradient.numbers().size() == Net::block_size);

  const ColumnsObjective<Net> objective(samples);
  Evaluation<Net, ColumnsObjective<Net>> evaluation(objective, 2);
  auto taken_evaluation = std::move(evaluation);
  CHECK(evaluation.mean(moved, objective) == taken_evaluation.mean(moved, objective));
}

TEST_CASE("a restore that throws changes nothing") {
  using Net = Network<float, Sequential<Linear<3, 17>, Relu, Linear<17, 2>>>;
  const Matrix<float> x = normal<float>(3, 100, 1), y = normal<float>(2, 100, 2);
  const Samples<float> samples{columns(x), columns(y)};
  const auto trained = [&] {
    Trainer trainer(Net(1), samples, samples, {.epochs = 4, .threads = 1});
    trainer.run_epoch();
    return trainer;
  };
  auto whole = trained();
  whole.train();
  using State = TrainingState<Net>;
  const auto refused = [&](const std::string& expected, const auto& write) {
    auto trainer = trained();
    CHECK(error_of([&] { trainer.restore(write); }).starts_with("Trainer::restore" + expected));
    trainer.train();
    CHECK(same_bits(trainer.network(), whole.network()));
  };
  refused(": moments", [](State& s) { s.moments = AlignedBuffer<float>(3), s.network = Net(9); });
  refused(": epochs done", [](State& s) { s.progress.epoch = ~0ull, s.network = Net(9); });
  refused(": best epoch", [](State& s) { s.progress.best_epoch = 2; });
  refused(": best loss", [](State& s) { s.progress.best_loss = std::nan(""); });
  refused(": history", [](State& s) { s.history.clear(); });
  refused(": status", [](State& s) { s.progress.status = static_cast<TrainingStatus>(77); });
  refused(": status", [](State& s) { s.progress.status = TrainingStatus::diverged; });
  refused(": the reader", [](State& s) {
    s.network = Net(9);
    throw Error("Trainer::restore: the reader gave up");
  });
}

TEST_CASE("layers that no stack holds train") {
  using Net = Network<float, Sequential<Linear<2, 65536>, Relu, Linear<65536, 1>>>;
  const Matrix<float> x = normal<float>(2, 8, 1), y = normal<float>(1, 8, 2);
  Trainer trainer(Net(1), {columns(x), columns(y)}, {},
                  {.epochs = 2, .batch_size = 8, .schedule = {.initial = 1e-5}, .threads = 2});
  const double before = mean_loss(trainer.network(), Samples<float>{columns(x), columns(y)});
  CHECK(trainer.train() == TrainingStatus::finished);
  CHECK(trainer.state().progress.best_loss < before);
  Net::Workspace workspace;
  CHECK(std::isfinite(trainer.network().vjp(x.col(0), y.col(0).head<1>(), workspace).norm()));
}
