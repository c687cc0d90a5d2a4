// rbres_train on arrays of one's own.
#include "train_program.hpp"

#include <limits>

#include <nlohmann/json.hpp>
#include <rbres/io/model.hpp>
#include <rbres/io/npy.hpp>

using namespace rbres;

namespace {

using Model = Network<float, Sequential<Linear<3, 256>, Relu, Linear<256, 256>, Relu, Linear<256, 2>>>;

/// Inputs of different sizes, of which one never varies.
Eigen::MatrixXd some_inputs(std::uint64_t stream, int count) {
  Random random(1, stream);
  Eigen::MatrixXd x(3, count);
  for (int i = 0; i < count; ++i) x.col(i) << random.uniform(-2, 2), random.uniform(100, 101), 7;
  return x;
}
/// What is to be learned: small and large numbers, far from 0.
Eigen::MatrixXd targets_of(const Eigen::MatrixXd& x) {
  Eigen::MatrixXd y(2, x.cols());
  y.row(0) = (3e-3 + 1e-3 * (2 * x.row(0).array()).sin()).matrix();
  y.row(1) = (5000 + 1000 * x.row(0).array() * (x.row(1).array() - 100.5)).matrix();
  return y;
}
Eigen::VectorXd variance(const Eigen::MatrixXd& y) {
  return (y.colwise() - y.rowwise().mean()).array().square().rowwise().mean();
}

const std::string own = "--inputs x.npy --targets y.npy --threads 1 ";

/// The program's answer to data that it must refuse.
std::string refusal(const TemporaryFolder& folder, const std::string& options) {
  return refusal(folder, RBRES_TRAIN, "--epochs 1 --threads 1 --out new " + options);
}

}  // namespace

TEST_CASE("a model of one's own data predicts what it never saw, in the data's units") {
  const TemporaryFolder folder;
  const Eigen::MatrixXd x = some_inputs(0, 2000);
  write_npy(folder / "x.npy", x);
  write_npy(folder / "y.npy", targets_of(x).cast<float>().eval());
  const Outcome outcome = run(folder, RBRES_TRAIN, own + "--epochs 30 --json table");
  CHECK(outcome.err == "");
  REQUIRE(outcome.status == 0);
  CHECK(contains(outcome.out, "3 inputs, 2 outputs: 1600 samples to train on, 200 to validate, 200 to test"));

  const auto model = load<Model>(folder / "model.safetensors");
  const Eigen::MatrixXd unseen = some_inputs(1, 500), truth = targets_of(unseen);
  Eigen::MatrixXd predicted(2, 500);
  for (int i = 0; i < 500; ++i) predicted.col(i) = model.forward(unseen.col(i).cast<float>()).cast<double>();
  const Eigen::VectorXd error = (predicted - truth).array().square().rowwise().mean();
  CHECK(error[0] < 0.05 * variance(truth)[0]);
  CHECK(error[1] < 0.05 * variance(truth)[1]);

  const auto table = nlohmann::json::parse(read_bytes(folder / "table"));
  for (std::size_t i = 0; i < 2; ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    CHECK(table["model"]["mean_square_error"][i].get<double>() == doctest::Approx(error[k]).epsilon(0.5));
    CHECK(table["mean of the targets"]["mean_square_error"][i].get<double>() ==
          doctest::Approx(variance(truth)[k]).epsilon(0.3));
  }
  CHECK(table["test_samples"] == 200);
  // It is no predictor of bodies.
  CHECK(contains(refusal(folder, RBRES_ROLLOUT, "--model model.safetensors"), "model.safetensors: metadata"));
}

TEST_CASE("residual networks and one sample's many axes") {
  const TemporaryFolder folder;
  const Eigen::MatrixXf x = Eigen::MatrixXf::Random(95, 40);
  NpyWriter<float> inputs(folder / "x.npy", {5, 19});
  inputs.append(x);
  inputs.commit();
  NpyWriter<float> targets(folder / "y.npy", {});
  targets.append(x.topRows(1));
  targets.commit();
  REQUIRE(run(folder, RBRES_TRAIN, own + "--epochs 2 --network residual4").status == 0);
  const SafetensorsReader file(folder / "model.safetensors");
  CHECK(file.metadata().at("architecture").starts_with("rbres::Sequential<rbres::Linear<95, 256>"));
  CHECK(file.metadata().at("architecture").ends_with(", rbres::Linear<256, 1>>"));
}

TEST_CASE("a run on one's own data goes on to the same bits, and only on the same data") {
  const TemporaryFolder folder;
  const Eigen::MatrixXd x = some_inputs(0, 400);
  write_npy(folder / "x.npy", x);
  write_npy(folder / "y.npy", targets_of(x));
  REQUIRE(run(folder, RBRES_TRAIN, own + "--epochs 5 --out whole").status == 0);
  REQUIRE(run(folder, RBRES_TRAIN, own + "--epochs 3 --checkpoint run --out part").status == 0);
  const std::string resume = own + "--epochs 5 --checkpoint run --resume ";
  REQUIRE(run(folder, RBRES_TRAIN, resume + "--out resumed").status == 0);
  CHECK(read_bytes(folder / "resumed") == read_bytes(folder / "whole"));
  CHECK(read_bytes(folder / "part") != read_bytes(folder / "whole"));
  write_npy(folder / "y.npy", (targets_of(x).array() + 1).matrix().eval());
  CHECK(contains(refusal(folder, RBRES_TRAIN, resume + "--out new"), "run: metadata 'data'"));
}

TEST_CASE("data that cannot be learned cost one line and no file") {
  const TemporaryFolder folder;
  write_npy(folder / "x.npy", Eigen::MatrixXf::Random(3, 50).eval());
  write_npy(folder / "y.npy", Eigen::MatrixXd::Random(2, 50).eval());
  const auto with_inputs = [&](const std::string& name) {
    return refusal(folder, "--inputs " + name + " --targets y.npy");
  };
  const auto with_targets = [&](const std::string& name) {
    return refusal(folder, "--inputs x.npy --targets " + name);
  };
  CHECK(contains(refusal(folder, "--inputs x.npy"), "--inputs requires --targets"));
  CHECK(contains(refusal(folder, "--targets y.npy"), "--targets requires --inputs"));
  CHECK(
      contains(refusal(folder, "--inputs x.npy --targets y.npy --horizon 1"), "--horizon excludes --inputs"));
  CHECK(contains(with_inputs("missing"), "--inputs: missing: cannot read"));
  CHECK(contains(with_targets("missing"), "--targets: missing: cannot read"));
  write_bytes(folder / "text", "1, 2, 3\n");
  CHECK(contains(with_inputs("text"), "--inputs: text: "));

  const auto columns = [&](int rows, int count) {
    write_npy(folder / "new.npy", Eigen::MatrixXf::Random(rows, count).eval());
  };
  columns(2, 49);
  CHECK(contains(with_targets("new.npy"),
                 "--targets: new.npy: expected 50 samples, as --inputs has, found 49"));
  columns(96, 50);
  CHECK(contains(with_inputs("new.npy"), "--inputs: new.npy: expected samples of 1 to 95 numbers"));
  columns(66, 50);
  CHECK(contains(with_targets("new.npy"), "--targets: new.npy: expected samples of 1 to 65 numbers"));
  columns(0, 50);
  CHECK(contains(with_inputs("new.npy"), "expected samples of 1 to 95 numbers"));
  columns(3, 9);
  CHECK(contains(with_inputs("new.npy"), "expected 10 samples or more, found 9"));
  write_npy(folder / "new.npy", Eigen::Matrix<std::int64_t, 3, 50>::Ones().eval());
  CHECK(contains(with_inputs("new.npy"), "expected an array of float32 or float64, found one of <i8"));
  for (const double wrong : {std::numeric_limits<double>::quiet_NaN(), -1e300}) {
    Eigen::MatrixXd numbers = Eigen::MatrixXd::Ones(3, 50);
    numbers(2, 7) = wrong;
    write_npy(folder / "new.npy", numbers);
    CHECK(
        contains(with_inputs("new.npy"), "--inputs: new.npy: sample 7, number 2: expected a finite number"));
    CHECK(contains(with_targets("new.npy"),
                   "--targets: new.npy: sample 7, number 2: expected a finite number"));
  }
}
