// What is composed with the trainer: schedules, clipping, moving averages, min_delta, more epochs.
#include <doctest/doctest.h>

#include <cstring>
#include <rbres/nn/nn.hpp>
#include <vector>

using namespace rbres;

namespace {

using Matrix = Eigen::MatrixXd;
using Line = Network<double, Sequential<Linear<3, 2>>>;

Matrix normal(Eigen::Index rows, Eigen::Index columns, std::uint64_t seed) {
  Random random(seed, 96);
  return Matrix::NullaryExpr(rows, columns, [&] { return random.normal(); });
}

template <class Net>
bool same_bits(const Net& a, const Net& b) {
  return std::memcmp(a.parameters().data(), b.parameters().data(), a.parameters().size_bytes()) == 0;
}

/// Whole batches of a linear regression, so that steps have a closed form.
struct Regression {
  Matrix x = normal(3, 64, 1), y = normal(2, 64, 2);
  Samples<double> samples() const { return {columns(x), columns(y)}; }
  TrainingOptions options(int epochs) const {
    return {.epochs = epochs,
            .batch_size = 64,
            .schedule = {.kind = Schedule::Kind::constant, .initial = 0.1},
            .l2 = 0,
            .patience = 0,
            .threads = 1};
  }
  /// Of the mean loss at W, b (2 x 4).
  Matrix gradient(const Matrix& w) const {
    Matrix x1(4, 64);
    x1 << x, Eigen::RowVectorXd::Ones(64);
    return 2 * (w * x1 - y) * x1.transpose() / 64;
  }
  static Matrix weights(const Line& net) {
    const auto tensors = Line::tensors();
    Matrix w(2, 4);
    for (int r = 0; r < 2; ++r)
      for (int c = 0; c < 4; ++c) w(r, c) = net.parameters()[tensors[c == 3].index(r, c == 3 ? 0 : c)];
    return w;
  }
};

/// The rates of a schedule's first steps, `per_epoch` in each epoch.
template <class S>
std::vector<double> rates(const S& schedule, int steps, int per_epoch, int epochs) {
  std::vector<double> all;
  for (int step = 0; step < steps; ++step)
    all.push_back(schedule(TrainingTime{step / per_epoch, epochs, static_cast<std::uint64_t>(step), {}}));
  return all;
}

}  // namespace

TEST_CASE("warm-up is a line from a fraction of the schedule's rate, then the schedule") {
  const Schedule power{.initial = 2};
  const auto found = rates(WarmUp{power, 5}, 8, 2, 4);
  for (int step = 0; step < 8; ++step)
    CHECK(found[static_cast<std::size_t>(step)] ==
          doctest::Approx(power.rate(step / 2, 4) * std::min(1.0, (step + 1) / 5.0)).epsilon(1e-15));
}

TEST_CASE("a plateau lowers the rate when the loss does not fall") {
  // By hand: patience 1, so every second epoch without a better loss.
  const std::vector<double> losses{5, 4, 4, 4, 3.95, 3.9, 3, 3, 3, 3, 3};
  const std::vector<double> heights{1, 1, 1, 1, 0.5, 0.5, 0.25, 0.25, 0.25, 0.125, 0.125, 0.0625};
  const Plateau schedule{Schedule{.kind = Schedule::Kind::constant, .initial = 8}, 0.5, 1, 0.2};
  std::vector<EpochLosses> history;
  for (std::size_t epoch = 0; epoch < heights.size(); ++epoch) {
    CAPTURE(epoch);
    CHECK(schedule(TrainingTime{static_cast<int>(epoch), 20, epoch, history}) == 8 * heights[epoch]);
    if (epoch < losses.size()) history.push_back({100, losses[epoch], 0});
  }
}

TEST_CASE(
    "the trainer steps with its schedule's rates, the user's own among them, and refuses what is none") {
  const Regression data;
  Trainer trainer(Line(1), data.samples(), {}, data.options(4), Sgd{.momentum = 0});
  trainer.set_schedule(
      [](const TrainingTime& now) { return now.epoch == 3 ? std::nan("") : 0.01 * (1 + now.epoch); });
  Matrix w = Regression::weights(trainer.network());
  for (int epoch = 0; epoch < 3; ++epoch) {
    const double rate = 0.01 * (1 + epoch);
    w -= rate * data.gradient(w);
    CHECK(trainer.run_epoch().learning_rate == rate);
    CHECK(trainer.state().history.back().learning_rate == rate);
  }
  CHECK((Regression::weights(trainer.network()) - w).norm() < 1e-14);
  CHECK_THROWS_WITH_AS(trainer.run_epoch(),
                       "learning rate of step 3: expected a finite number, at least 0, found nan", Error);
  CHECK((Regression::weights(trainer.network()) - w).norm() < 1e-14);
}

TEST_CASE("clipping scales a gradient to the largest norm, and leaves smaller ones alone") {
  const Regression data;
  const double whole = data.gradient(Regression::weights(Line(1))).norm();
  for (const double largest : {0.25 * whole, 4 * whole, std::numeric_limits<double>::infinity()}) {
    CAPTURE(largest);
    Trainer trainer(Line(1), data.samples(), {}, data.options(1), Clipped<Sgd>{{.momentum = 0}, largest});
    const Matrix before = Regression::weights(trainer.network());
    trainer.train();
    const Matrix step = before - Regression::weights(trainer.network());
    CHECK(step.norm() == doctest::Approx(0.1 * std::min(whole, largest)).epsilon(1e-5));
    CHECK((step / step.norm() - data.gradient(before) / whole).norm() < 1e-13);
  }
}

TEST_CASE("the moving average of the weights is what is validated and kept") {
  const Regression data;
  Trainer trainer(Line(1), data.samples(), data.samples(), data.options(5),
                  Averaged<Sgd>{{.momentum = 0}, 0.8});
  Matrix w = Regression::weights(Line(1)), sum = Matrix::Zero(2, 4);
  double total = 0;
  for (int epoch = 0; epoch < 5; ++epoch) {
    w -= 0.1 * data.gradient(w);
    sum = 0.8 * sum + w, total = 0.8 * total + 1;  // the weighted mean, without powers
    const EpochReport report = trainer.run_epoch();
    CHECK((Regression::weights(trainer.best()) - sum / total).norm() < 1e-14);
    CHECK((Regression::weights(trainer.network()) - w).norm() < 1e-14);
    CHECK(mean_loss(trainer.best(), data.samples()) == report.validation_loss);
  }
}

TEST_CASE("min_delta: an improvement that is too small does not keep a run going, but its weights are kept") {
  const Regression data;
  auto options = data.options(1000);
  options.patience = 4;
  Trainer patient(Line(1), data.samples(), {}, options, Sgd{.momentum = 0});
  options.min_delta = 1e-3;
  Trainer trainer(Line(1), data.samples(), {}, options, Sgd{.momentum = 0});
  CHECK(trainer.train() == TrainingStatus::early_stopped);
  const auto& history = trainer.state().history;
  std::size_t last = 0;  // that was better by min_delta
  for (std::size_t i = 1; i < history.size(); ++i)
    if (history[i].train_loss < history[last].train_loss - 1e-3) last = i;
  CHECK(history.size() == last + 1 + 4);
  CHECK(trainer.state().progress.best_epoch > last + 1);
  for (std::size_t i = 0; i < history.size(); ++i) patient.run_epoch();
  CHECK(patient.state().progress.status == TrainingStatus::running);
}

TEST_CASE("a run goes on with more epochs, with more patience, and after its callback stopped it") {
  const Regression data;
  Trainer whole(Line(1), data.samples(), data.samples(), data.options(9));
  CHECK(whole.train() == TrainingStatus::finished);

  Trainer part(Line(1), data.samples(), data.samples(), data.options(4));
  CHECK(part.train([](const EpochReport& report) { return report.epoch != 2; }) == TrainingStatus::stopped);
  CHECK(part.state().progress.epoch == 2);
  CHECK(part.train() == TrainingStatus::finished);
  CHECK(part.train() == TrainingStatus::finished);
  Trainer more(Line(7), data.samples(), data.samples(), data.options(9));
  CHECK(more.fingerprint() == part.fingerprint());
  more.restore([&](auto& state) { state = part.state(); });
  CHECK(more.train() == TrainingStatus::finished);
  CHECK(same_bits(more.network(), whole.network()));
  CHECK(same_bits(more.best(), whole.best()));
  CHECK(more.state().history.size() == 9);

  auto options = data.options(500);
  options.patience = 2, options.min_delta = 10;
  Trainer impatient(Line(1), data.samples(), {}, options);
  CHECK(impatient.train() == TrainingStatus::early_stopped);
  options.patience = 5;
  Trainer patient(Line(1), data.samples(), {}, options);
  patient.restore([&](auto& state) { state = impatient.state(); });
  CHECK(patient.train() == TrainingStatus::early_stopped);
  CHECK(patient.state().progress.epoch == impatient.state().progress.epoch + 3);

  Trainer none(Line(1), data.samples(), {}, data.options(0));
  CHECK(none.train() == TrainingStatus::finished);
  CHECK(none.run_epoch().epoch == 0);
  CHECK(same_bits(none.network(), Line(1)));
}

TEST_CASE("a fingerprint tells apart what changes the bits, and nothing else") {
  const Regression data;
  Matrix other_y = data.y;
  other_y(1, 40) += 1e-12;
  const auto options = data.options(4);
  const auto print = [&](const Matrix& y, const TrainingOptions& o, const auto& optimizer) {
    return Trainer(Line(1), {columns(data.x), columns(y)}, data.samples(), o, optimizer).fingerprint();
  };
  const std::string first = print(data.y, options, Adam{});
  std::vector<std::string> all{first,
                               print(other_y, options, Adam{}),
                               print(data.y, options, Adam{.beta1 = 0.1}),
                               print(data.y, options, AdamW{}),
                               print(data.y, options, AdamW{{}, 0.5}),
                               print(data.y, options, Clipped<Adam>{}),
                               print(data.y, options, Averaged<Adam>{}),
                               print(data.y, options, Sgd{})};
  for (const auto& change : std::vector<std::function<void(TrainingOptions&)>>{
           [](auto& o) { o.batch_size = 32; }, [](auto& o) { o.l2 = 1e-14; }, [](auto& o) { o.seed = 1; },
           [](auto& o) { o.schedule.initial += 1e-16; }, [](auto& o) { o.dropout = 0.1; }}) {
    auto changed = options;
    change(changed);
    all.push_back(print(data.y, changed, Adam{}));
  }
  for (std::size_t i = 0; i < all.size(); ++i)
    for (std::size_t j = 0; j < i; ++j) CHECK(all[i] != all[j]);
  auto same = options;
  same.epochs = 9, same.threads = 3, same.patience = 8;
  CHECK(print(data.y, same, Adam{}) == first);
}

TEST_CASE("a run goes on with another number of epochs only where its rates do not depend on it") {
  const Regression data;
  const auto print = [&](int epochs, const auto& schedule) {
    Trainer trainer(Line(1), data.samples(), {}, data.options(epochs));
    trainer.set_schedule(schedule);
    return trainer.fingerprint();
  };
  const auto extends = [&](const auto& schedule) { return print(4, schedule) == print(9, schedule); };
  const Schedule cosine{.kind = Schedule::Kind::cosine};
  CHECK(!extends(cosine));
  CHECK(!extends(WarmUp{cosine, 5}));
  CHECK(!extends(Plateau{cosine}));
  CHECK(print(4, cosine) == print(4, cosine));
  for (const auto kind : {Schedule::Kind::power, Schedule::Kind::constant}) {
    CHECK(extends(Schedule{.kind = kind}));
    CHECK(extends(WarmUp{Plateau{Schedule{.kind = kind}}, 5}));
  }
  struct Halves {
    double operator()(const TrainingTime& now) const { return 2 * now.epoch < now.epochs ? 1e-3 : 1e-4; }
    bool spans_run() const { return true; }
  };
  CHECK(!extends(Halves{}));
  CHECK(extends([](const TrainingTime&) { return 1e-3; }));
  auto options = data.options(4);
  options.schedule = cosine;
  CHECK(Trainer(Line(1), data.samples(), {}, options).fingerprint() == print(4, cosine));
}

TEST_CASE("numbers out of their range are refused before anything is trained") {
  const Regression data;
  const double nan = std::nan(""), infinite = std::numeric_limits<double>::infinity();
  const auto refuses = [&](const TrainingOptions& options, const auto& optimizer) {
    CHECK_THROWS_AS(Trainer(Line(1), data.samples(), {}, options, optimizer), Error);
  };
  const auto option = [&](auto change) {
    auto options = data.options(3);
    change(options);
    refuses(options, Adam{});
  };
  option([&](auto& o) { o.l2 = infinite; });
  option([&](auto& o) { o.threads = 2'000'000'000; });
  option([&](auto& o) { o.threads = -1; });
  option([&](auto& o) { o.schedule.gamma = nan; });
  option([&](auto& o) { o.schedule.gamma = -0.1; });
  option([&](auto& o) { o.schedule.initial = nan; });
  option([&](auto& o) { o.schedule.power = infinite; });
  option([&](auto& o) { o.min_delta = nan; });
  option([&](auto& o) { o.epochs = -1; });
  const auto options = data.options(3);
  refuses(options, Adam{.beta1 = nan});
  refuses(options, Adam{.beta2 = 1});
  refuses(options, Adam{.epsilon = -1});
  refuses(options, AdamW{{}, infinite});
  refuses(options, Sgd{.momentum = nan});
  refuses(options, Clipped<Adam>{{}, 0});
  refuses(options, Clipped<Adam>{{}, nan});
  refuses(options, Averaged<Adam>{{}, 1});

  Trainer trainer(Line(1), data.samples(), {}, options);
  const auto refuses_schedule = [&](const auto& schedule) {
    CHECK_THROWS_AS(trainer.set_schedule(schedule), Error);
  };
  refuses_schedule(Schedule{.initial = -1});
  refuses_schedule(WarmUp{Schedule{.initial = nan}, 5});
  refuses_schedule(Plateau{Schedule{}, 7.0});
  refuses_schedule(Plateau{Schedule{}, nan});
  refuses_schedule(Plateau{Schedule{}, 0.1, -3});
  refuses_schedule(WarmUp{Plateau{Schedule{}, 0.1, 3, nan}, 5});
  trainer.set_schedule(Plateau{Schedule{}, 1.0, 0});
}
