#include <doctest/doctest.h>

#include <rbres/predict/encoding.hpp>

#include "predict_states.hpp"

using namespace rbres;

namespace {

using Code = Encoding<3>;
using State = SystemState<double, 3>;
using Wrenches = std::array<Wrench<double>, 3>;

}  // namespace

TEST_CASE("a body's 19 inputs are its 13 numbers in the paper's order, its force and its torque") {
  State y;
  y[1].position = {1, 2, 3};
  y[1].orientation = {0.5, -0.5, 0.5, 0.5};
  y[1].velocity = {8, 9, 10};
  y[1].angular_velocity = {11, 12, 13};
  Wrenches w{};
  w[1] = {{14, 15, 16}, {17, 18, 19}};
  const auto x = Code::encode(y, w, 3);
  static_assert(decltype(x)::SizeAtCompileTime == 57);
  Eigen::Matrix<double, 19, 1> expected;
  expected << 1, 2, 3, 0.5, -0.5, 0.5, 0.5, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19;
  CHECK(x.segment<19>(19) == expected);
}

TEST_CASE("q and -q are encoded alike, on the side w >= 0") {
  const State y = random_state<State>(1);
  const Wrenches w{};
  CHECK(Code::encode(y, w, 3) == Code::encode(turned(y), w, 3));
  for (int b = 0; b < 3; ++b) CHECK(Code::encode(y, w, 3)[19 * b + 6] >= 0);
}

TEST_CASE("the numbers of absent bodies are zero") {
  const State y = random_state<State>(2), base = random_state<State>(3);
  Wrenches w{};
  w[2].force = {1, 1, 1};
  CHECK(Code::encode(y, w, 2).tail<19>().isZero(0));
  CHECK_FALSE(Code::encode(y, w, 2).head<38>().isZero(0));
  CHECK(Code::difference(y, base, 2).tail<13>().isZero(0));
  CHECK(Code::sum(base, Code::Output<double>::Ones().eval(), 2)[2] == base[2]);
}

TEST_CASE("base plus the difference is the state, whichever quaternion stands for it") {
  const State y = random_state<State>(4), base = random_state<State>(5);
  const auto difference = Code::difference(y, base, 3);
  CHECK(difference == Code::difference(turned(y), base, 3));
  const State back = Code::sum(base, difference, 3);
  for (int b = 0; b < 3; ++b) {
    CHECK(norm(back[b].position - y[b].position) < 1e-14);
    // The near side: the difference of two unit quaternions is at most the square root of 2 long.
    CHECK(difference.segment<4>(13 * b + 3).norm() <= std::sqrt(2.0) + 1e-12);
    const double cosine = back[b].vector().segment<4>(3).dot(y[b].vector().segment<4>(3));
    CHECK(std::abs(cosine) == doctest::Approx(1).epsilon(1e-14));
  }
}

TEST_CASE("a sum has unit quaternions, also where they cancel") {
  const State base = random_state<State>(6);
  Code::Output<double> y = Code::Output<double>::Constant(0.7);
  y.segment<4>(3) = -base[0].vector().segment<4>(3);
  const State next = Code::sum(base, y, 3);
  CHECK(next[0].orientation == Quat<double>{});
  for (int b = 0; b < 3; ++b) CHECK(squared_norm(next[b].orientation) == doctest::Approx(1).epsilon(1e-14));
}

TEST_CASE("a normaliser has the mean and deviation of what is present") {
  Eigen::Matrix<float, 3, 4> columns;
  columns << 1, 2, 3, 1000,  //
      5, 5, 5, 5,            //
      -2, 2, 1000, 1000;
  const auto fitted = Normalizer<float, 3>::fit(columns, [](Eigen::Index r, Eigen::Index c) {
    return r == 1 || (r == 0 && c < 3) || (r == 2 && c < 2);
  });
  CHECK(fitted.mean[0] == doctest::Approx(2));
  CHECK(fitted.deviation[0] == doctest::Approx(std::sqrt(2.0 / 3)));
  CHECK(fitted.mean[1] == 5);
  CHECK(fitted.deviation[1] == 1);  // does not vary
  CHECK(fitted.mean[2] == 0);
  CHECK(fitted.deviation[2] == doctest::Approx(2));
  const Eigen::Vector3f x(0.3f, -4, 7);
  CHECK((fitted.restore(fitted.normalize(x)) - x).norm() < 1e-6f);
  CHECK(fitted.normalize(x)[2] == doctest::Approx(3.5));
}
