#include <doctest/doctest.h>

#include <rbres/nn/nn.hpp>

#include <cmath>
#include <cstring>
#include <limits>

using namespace rbres;

namespace {

template <class T>
using Matrix = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;

template <class T>
Matrix<T> normal(Eigen::Index rows, Eigen::Index columns, std::uint64_t seed) {
  Random random(seed, 99);
  return Matrix<T>::NullaryExpr(rows, columns, [&] { return static_cast<T>(random.normal()); });
}

/// A smooth function of six inputs in [-1, 1].
struct Smooth {
  Matrix<float> x, y;
  Smooth(Eigen::Index count, std::uint64_t seed) : x(6, count), y(2, count) {
    Random random(seed, 98);
    x = Matrix<float>::NullaryExpr(6, count, [&] { return static_cast<float>(random.uniform(-1, 1)); });
    for (Eigen::Index i = 0; i < count; ++i) {
      y(0, i) = std::sin(2 * x(0, i) + x(1, i)) * x(2, i);
      y(1, i) = std::exp(-x(3, i) * x(3, i)) + x(4, i) * x(5, i);
    }
  }
  Samples<float> samples() const { return {columns(x), columns(y)}; }
};

using Small = ResidualNetwork<float, 6, 24, 2, 2>;

TrainingOptions short_run() { return {.epochs = 6, .batch_size = 50, .seed = 3, .threads = 1}; }

template <class Net>
bool same_bits(const Net& a, const Net& b) {
  return std::memcmp(a.parameters().data(), b.parameters().data(),
                     Net::block_size * sizeof(typename Net::Scalar)) == 0;
}

template <class T>
bool same_numbers(const AlignedBuffer<T>& a, const AlignedBuffer<T>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end());
}

}  // namespace

TEST_CASE("memorises 8 samples") {
  using Net = ResidualNetwork<float, 19, 64, 2, 13>;
  const Matrix<float> x = normal<float>(19, 8, 1), y = normal<float>(13, 8, 2);
  Trainer trainer(Net(1), {columns(x), columns(y)}, {},
                  {.epochs = 1000,
                   .batch_size = 8,
                   .schedule = {.kind = Schedule::Kind::cosine, .initial = 3e-3},
                   .l2 = 0,
                   .dropout = 0,
                   .patience = 0,
                   .threads = 1});
  CHECK(trainer.train() == TrainingStatus::finished);
  CHECK(mean_loss(trainer.best(), Samples<float>{columns(x), columns(y)}) < 1e-6);
}

TEST_CASE("fits a smooth function of six inputs, and generalises") {
  const Smooth train(6000, 1), validation(500, 2), test(500, 3);
  Trainer trainer(ResidualNetwork<float, 6, 64, 2, 2>(1), train.samples(), validation.samples(),
                  {.epochs = 60,
                   .schedule = {.kind = Schedule::Kind::cosine, .initial = 6e-3},
                   .l2 = 0,
                   .dropout = 0,
                   .threads = 1});
  trainer.train();
  const double variance = (test.y.colwise() - test.y.rowwise().mean()).squaredNorm() / 500.0;
  // 0.012 of the variance on samples that it has not seen.
  CHECK(mean_loss(trainer.best(), test.samples()) < 0.02 * variance);
}

TEST_CASE_TEMPLATE("the bits do not depend on the number of threads", Scalar, float, double) {
  using Net = ResidualNetwork<Scalar, 6, 64, 2, 2>;  // large enough that a step is worth 4 threads
  const Matrix<Scalar> x = normal<Scalar>(6, 333, 1), y = normal<Scalar>(2, 333, 2);
  const Samples<Scalar> samples{columns(x), columns(y)};
  const auto train = [&](int threads) {
    auto options = short_run();
    options.batch_size = 128;
    options.threads = threads;
    Trainer trainer(Net(1), samples, samples, options);
    trainer.train();
    return trainer.state();
  };
  const auto one = train(1);
  for (const int threads : {2, 3, 4}) {
    const auto more = train(threads);
    CHECK(same_bits(one.network, more.network));
    CHECK(same_numbers(one.moments, more.moments));
    CHECK(one.progress.best_loss == more.progress.best_loss);
  }
}

TEST_CASE("a run that goes on from a saved state ends with the same bits") {
  const Smooth train(200, 1), validation(100, 2);
  Trainer whole(Small(1), train.samples(), validation.samples(), short_run());
  whole.train();
  for (const int epochs : {1, 4}) {
    Trainer first(Small(1), train.samples(), validation.samples(), short_run());
    for (int e = 0; e < epochs; ++e) first.run_epoch();
    Trainer second(Small(77), train.samples(), validation.samples(), short_run());
    second.restore([&](auto& state) { state = first.state(); });
    second.train();
    CHECK(same_bits(second.network(), whole.network()));
    CHECK(same_bits(second.best(), whole.best()));
    CHECK(same_numbers(second.state().moments, whole.state().moments));
    CHECK(second.state().progress.step == whole.state().progress.step);
  }
}

TEST_CASE("every epoch takes all samples once, in an order of its own that the seed gives") {
  const Smooth train(100, 1);
  const auto orders = [&](std::uint64_t seed) {
    std::vector<std::vector<Eigen::Index>> epochs;
    Loss<float> listening;
    listening.extra = [&](Eigen::Index sample, auto, auto, auto) {
      epochs.back().push_back(sample);
      return 0.0;
    };
    auto options = short_run();
    options.seed = seed;
    Trainer trainer(Small(1), train.samples(), {}, options, Adam{}, listening);
    for (int epoch = 0; epoch < 2; ++epoch) {
      epochs.emplace_back();
      trainer.run_epoch();
    }
    return epochs;
  };
  auto first = orders(3);
  CHECK(first == orders(3));
  CHECK(first != orders(4));
  CHECK(first[0] != first[1]);
  for (auto& epoch : first) {
    std::sort(epoch.begin(), epoch.end());
    REQUIRE(epoch.size() == 100);
    for (Eigen::Index i = 0; i < 100; ++i) CHECK(epoch[static_cast<std::size_t>(i)] == i);
  }
}

TEST_CASE("the loss that is reported is the weighted mean over samples, however they fall into batches") {
  const Smooth train(120, 1);
  const Matrix<float> weights = normal<float>(2, 120, 5).cwiseAbs();
  Loss<float> loss;
  loss.output_weights = {2, 3};
  auto options = short_run();  // batches of 50, 50 and 20
  options.dropout = 0;
  options.schedule.initial = 1e-30;
  Trainer trainer(Small(1), {columns(train.x), columns(train.y), columns(weights)}, {}, options, Adam{},
                  loss);
  double expected = 0;
  for (Eigen::Index i = 0; i < 120; ++i) {
    const Eigen::Vector2f error = Small(1).forward(Small::Input(train.x.col(i))) - train.y.col(i);
    expected += static_cast<double>(2 * weights(0, i) * error[0] * error[0] +
                                    3 * weights(1, i) * error[1] * error[1]) /
                120;
  }
  CHECK(trainer.run_epoch().train_loss == doctest::Approx(expected).epsilon(1e-5));
}

TEST_CASE("schedules") {
  const Schedule paper;
  CHECK(paper.rate(0, 200) == 1e-3);
  CHECK(paper.rate(10, 200) == doctest::Approx(1e-3 * std::pow(2.0, -0.75)));
  const Schedule cosine{.kind = Schedule::Kind::cosine, .initial = 2};
  CHECK(cosine.rate(0, 100) == 2);
  CHECK(cosine.rate(50, 100) == doctest::Approx(1));
  CHECK(cosine.rate(100, 100) == doctest::Approx(0));
  CHECK(Schedule{.kind = Schedule::Kind::constant, .initial = 3}.rate(7, 9) == 3);

  const Smooth train(100, 1);
  Trainer trainer(Small(1), train.samples(), {}, short_run());
  for (int epoch = 0; epoch < 3; ++epoch) CHECK(trainer.run_epoch().learning_rate == paper.rate(epoch, 6));
}

TEST_CASE("stops early after `patience` epochs without a better loss, and keeps the best weights") {
  const Matrix<float> x = normal<float>(6, 64, 1), noise = normal<float>(2, 64, 2);
  const Matrix<float> vx = normal<float>(6, 64, 3), vnoise = normal<float>(2, 64, 4);
  const Samples<float> validation{columns(vx), columns(vnoise)};
  Trainer trainer(Small(1), {columns(x), columns(noise)}, validation,
                  {.epochs = 500,
                   .schedule = {.kind = Schedule::Kind::constant, .initial = 1e-2},
                   .patience = 7,
                   .threads = 1});
  double best = std::numeric_limits<double>::infinity();
  std::uint64_t best_epoch = 0, last = 0;
  CHECK(trainer.train([&](const EpochReport& report) {
    if (report.validation_loss < best) best = report.validation_loss, best_epoch = report.epoch;
    last = report.epoch;
    return true;
  }) == TrainingStatus::early_stopped);
  CHECK(last == best_epoch + 7);
  CHECK(trainer.state().progress.best_epoch == best_epoch);
  CHECK(mean_loss(trainer.best(), validation) == best);
  CHECK(mean_loss(trainer.network(), validation) > best);
  CHECK(trainer.run_epoch().epoch == last);  // nothing more happens
}

TEST_CASE("the callback stops the run") {
  const Smooth train(100, 1);
  Trainer trainer(Small(1), train.samples(), {}, short_run());
  CHECK(trainer.train([](const EpochReport& report) { return report.epoch < 2; }) == TrainingStatus::stopped);
  CHECK(trainer.state().progress.epoch == 2);
}

TEST_CASE("numbers that are not finite are refused with row and column") {
  Smooth train(100, 1);
  const auto build = [&] { Trainer(Small(1), train.samples(), {}, short_run()); };
  train.y(1, 42) = std::numeric_limits<float>::quiet_NaN();
  CHECK_THROWS_WITH_AS(
      build(), "Trainer: training samples: targets: row 1, column 42: expected a finite number, found nan",
      Error);
  train.y(1, 42) = 0;
  train.x(5, 99) = -std::numeric_limits<float>::infinity();
  CHECK_THROWS_WITH_AS(
      build(), "Trainer: training samples: inputs: row 5, column 99: expected a finite number, found -inf",
      Error);
}

TEST_CASE("weights that are none are refused, those of samples and those of outputs") {
  const Smooth train(100, 1);
  Matrix<float> weights = Matrix<float>::Ones(2, 100);
  const auto error = [&](const Loss<float>& loss) -> std::string {
    try {
      Trainer(Small(1), {columns(train.x), columns(train.y), columns(weights)}, {}, short_run(), Adam{},
              loss);
    } catch (const Error& problem) {
      return problem.what();
    }
    return "";
  };
  const float infinite = std::numeric_limits<float>::infinity();
  for (const float bad : {-1.0f, -1e-30f, infinite, -infinite, std::nanf("")}) {
    CAPTURE(bad);
    weights(1, 42) = bad;
    CHECK(error({}).starts_with(
        "Trainer: training samples: weights: row 1, column 42: expected a finite number "
        "of at least 0, found "));
    weights(1, 42) = 0;
    CHECK(error({.output_weights = {1, bad}})
              .starts_with("Loss::output_weights: number 1: expected a finite number of at least 0, found "));
  }
  CHECK(error({.output_weights = {0, 1}}) == "");
}

TEST_CASE("a trainer that is assigned goes on as the one that it was assigned from") {
  const Smooth first(100, 1), other(150, 2);
  Trainer a(Small(1), first.samples(), first.samples(), short_run());
  Trainer b(Small(2), other.samples(), other.samples(), {.epochs = 4, .batch_size = 30, .threads = 1});
  b.run_epoch();
  a = b;
  CHECK(a.fingerprint() == b.fingerprint());
  Trainer c(Small(3), first.samples(), {}, short_run());
  c = Trainer(b);
  for (Trainer<Small>* trainer : {&a, &b, &c}) trainer->train();
  CHECK(same_bits(a.network(), b.network()));
  CHECK(same_bits(c.best(), b.best()));
  CHECK(!same_bits(a.network(), Small(2)));
}

TEST_CASE("options and sizes that make no sense are refused") {
  const Smooth train(100, 1);
  const auto build = [&](const TrainingOptions& options) { Trainer(Small(1), train.samples(), {}, options); };
  CHECK_THROWS_WITH_AS(build({.dropout = 1}), "TrainingOptions::dropout: expected in [0, 1), found 1", Error);
  CHECK_THROWS_AS(build({.batch_size = 0}), Error);
  CHECK_THROWS_AS(build({.l2 = -1}), Error);
  CHECK_THROWS_AS(build({.l2 = std::nan("")}), Error);
  CHECK_THROWS_WITH_AS(Trainer(Small(1), Samples<float>{columns(train.x), columns(train.x)}, {}),
                       "Trainer: training samples: targets: expected 2 x 100, found 6 x 100", Error);
}

TEST_CASE("a loss that turns non-finite stops the run and keeps the last good weights") {
  const Smooth train(100, 1);
  auto options = short_run();
  options.epochs = 200;
  options.patience = 0;
  options.schedule = {.kind = Schedule::Kind::constant, .initial = 0.01};
  Loss<float> loss;
  bool explode = false;
  loss.extra = [&](Eigen::Index, auto, auto, auto) {
    return explode ? std::numeric_limits<double>::infinity() : 0.0;
  };
  Trainer trainer(Small(1), train.samples(), {}, options, Sgd{}, loss);
  CHECK(trainer.train([&](const EpochReport& report) {
    explode = report.epoch == 3;
    return true;
  }) == TrainingStatus::diverged);
  CHECK(trainer.state().progress.epoch == 3);
  CHECK(trainer.state().progress.step == 6);  // two batches an epoch: none after the bad loss
  for (const float p : trainer.best().parameters()) REQUIRE(std::isfinite(p));
  CHECK(std::isfinite(mean_loss(trainer.best(), train.samples())));

  options.schedule.initial = 1e30;  // diverges by itself, at once
  Trainer wild(Small(1), train.samples(), {}, options, Sgd{});
  CHECK(wild.train() == TrainingStatus::diverged);
  CHECK(same_bits(wild.best(), Small(1)));

  // The loss of an epoch of one step is that of before the step.
  options.epochs = 1;
  options.batch_size = 100;
  options.schedule.initial = 1e300;
  Trainer blind(Small(1), train.samples(), {}, options, Sgd{});
  CHECK(blind.train() == TrainingStatus::diverged);
  CHECK(same_bits(blind.best(), Small(1)));
}

TEST_CASE_TEMPLATE("optimisers step as their papers say", Optimizer, Adam, AdamW, Sgd) {
  using Net = Network<double, Sequential<Linear<3, 2>>>;
  const Matrix<double> x = normal<double>(3, 300, 1), y = normal<double>(2, 300, 2);
  const TrainingOptions options{
      .epochs = 5, .batch_size = 300, .schedule = {.initial = 0.01}, .l2 = 0.1, .threads = 1};
  Trainer trainer(Net(1), {columns(x), columns(y)}, {}, options, Optimizer{});
  const auto tensors = Net::tensors();

  const Net start(1);
  Matrix<double> w(2, 4), m = Matrix<double>::Zero(2, 4), v = m;  // [W, b]
  for (int r = 0; r < 2; ++r)
    for (int c = 0; c < 4; ++c) w(r, c) = start.parameters()[tensors[c == 3].index(r, c == 3 ? 0 : c)];
  Matrix<double> x1(4, 300), decays = Matrix<double>::Ones(2, 4);
  x1 << x, Eigen::RowVectorXd::Ones(300);
  decays.col(3).setZero();
  for (int t = 1; t <= 5; ++t) {
    trainer.run_epoch();
    const double rate = options.schedule.rate(t - 1, 5);
    const Matrix<double> g = 2 * (w * x1 - y) * x1.transpose() / 300 + 2 * 0.1 * w.cwiseProduct(decays);
    if constexpr (std::is_same_v<Optimizer, Sgd>) {
      m = 0.9 * m + g;
      w -= rate * m;
    } else {
      m = 0.9 * m + 0.1 * g;
      v = 0.999 * v + 0.001 * g.cwiseProduct(g);
      const auto m_hat = m.array() / (1 - std::pow(0.9, t)), v_hat = v.array() / (1 - std::pow(0.999, t));
      if constexpr (std::is_same_v<Optimizer, AdamW>) w -= rate * 0.01 * w.cwiseProduct(decays);
      w.array() -= rate * m_hat / (v_hat.sqrt() + 1e-8);
    }
  }
  for (int r = 0; r < 2; ++r)
    for (int c = 0; c < 4; ++c)
      CHECK(trainer.network().parameters()[tensors[c == 3].index(r, c == 3 ? 0 : c)] ==
            doctest::Approx(w(r, c)).epsilon(1e-12));
}

#if defined(__SSE2__)
TEST_CASE("weights that fade become zero, not denormal numbers that slow everything down") {
  using Net = Network<float, Sequential<Linear<4, 16>, Relu, Linear<16, 2>>>;
  const Matrix<float> x = Matrix<float>::Zero(4, 64), y = Matrix<float>::Zero(2, 64);
  for (const int threads : {1, 2}) {
    // The inputs are zero, so that the L2 term alone halves the first layer's weights in each of 135 steps.
    Trainer trainer(Net(1), {columns(x), columns(y)}, {},
                    {.epochs = 135,
                     .batch_size = 64,
                     .schedule = {.initial = 1, .gamma = 0},
                     .l2 = 0.25,
                     .dropout = 0,
                     .patience = 0,
                     .threads = threads},
                    Sgd{.momentum = 0});
    trainer.train();
    int denormal = 0;
    for (const float w : trainer.network().parameters()) denormal += std::fpclassify(w) == FP_SUBNORMAL;
    CHECK(denormal == 0);
    volatile float least = std::numeric_limits<float>::min();
    CHECK(least / 2 > 0);  // as before the training
  }
}
#endif

TEST_CASE("outputs without weight carry no loss, and their targets change nothing") {
  const Smooth train(200, 1);
  Matrix<float> weights = Matrix<float>::Ones(2, 200), other = train.y;
  for (Eigen::Index i = 0; i < 200; i += 3) weights(1, i) = 0, other(1, i) = 1e6f;
  Trainer a(Small(1), {columns(train.x), columns(train.y), columns(weights)}, {}, short_run());
  Trainer b(Small(1), {columns(train.x), columns(other), columns(weights)}, {}, short_run());
  a.train();
  b.train();
  CHECK(same_bits(a.network(), b.network()));
  CHECK(std::isfinite(b.state().progress.best_loss));
}

TEST_CASE("dropout keeps the asked share, scaled so that the mean stays, as a function of the sample") {
  constexpr std::ptrdiff_t size = 72, samples = 500;
  std::vector<double> factors(std::size_t{size * samples}), other(factors.size());
  for (std::ptrdiff_t r = 0; r < samples; ++r)
    detail::fill_dropout({.rate = 0.2, .seed = 1, .step = 2}, 3, size,
                         detail::Panels<double>{factors.data(), samples}, r);
  double sum = 0, zeros = 0;
  for (const double f : factors) {
    sum += f / (size * samples);
    zeros += f == 0 ? 1.0 / (size * samples) : 0;
    REQUIRE((f == 0 || f == doctest::Approx(1.25).epsilon(1e-4)));
  }
  CHECK(zeros == doctest::Approx(0.2).epsilon(0.05));
  CHECK(sum == doctest::Approx(1).epsilon(0.02));

  for (std::ptrdiff_t r = samples; r-- > 0;)
    detail::fill_dropout({.rate = 0.2, .seed = 1, .step = 2}, 3, size,
                         detail::Panels<double>{other.data(), samples}, r);
  CHECK(factors == other);
  detail::fill_dropout({.rate = 0.2, .seed = 1, .step = 3}, 3, size,
                       detail::Panels<double>{other.data(), samples}, 0);
  CHECK(factors != other);
}

TEST_CASE("blocks of Philox side by side are those of Philox") {
  std::uint32_t words[4][16];
  detail::philox_blocks(0xfffffff8u, 7, 8, 0x80000009u, 0x0123456789abcdefu, words);
  for (std::uint32_t b = 0; b < 16; ++b) {
    const auto expected = philox4x32({0xfffffff8u + b, 7, 8, 0x80000009u}, {0x89abcdefu, 0x01234567u});
    for (std::size_t w = 0; w < 4; ++w) CHECK(words[w][b] == expected[w]);
  }
}
