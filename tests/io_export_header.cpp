// Built without rbres::io: the exported headers need the core and Eigen only.
#include <array>
#include <cstring>
#include <vector>

#include <doctest/doctest.h>

#include "../examples/common/count_allocations.hpp"
#include "exported_double.hpp"
#include "exported_float.hpp"
#include "exported_half.hpp"
#include "exported_half_law.hpp"
#include "exported_hybrid.hpp"
#include "exported_law.hpp"
#include "exported_predictor.hpp"
#include "io_export_models.hpp"

namespace {

template <class Exported, class Network>
void check_same_bits(const Exported& exported, const Network& original) {
  using Input = typename Network::Input;
  for (int i = 0; i < 20; ++i) {
    const Input x = Input::Random();
    const auto a = exported.forward(x), b = original.forward(x);
    CHECK(std::memcmp(a.data(), b.data(), sizeof a) == 0);
    CHECK(b.norm() > 0);
  }
}

/// Three balls and a floor after a frame.
template <class Law>
std::array<rbres::RigidState<double>, 3> frame(const Law& law) {
  using namespace rbres;
  using Ball = Sphere<double>;
  const std::vector<Body<double, Ball>> bodies{{Ball(0.1), 1.0}, {Ball(0.12), 0.6}, {Ball(0.09), 2.0}};
  const std::vector<Plane<double>> planes{floor_plane<double>()};
  std::array<RigidState<double>, 3> start, states;
  for (std::size_t i = 0; i < 3; ++i) {
    const double x = static_cast<double>(i);
    start[i].position = {0.2 * x, 0.01 * x, 0.1};
    start[i].velocity = {0.2 - 0.3 * x, 0.1 * x, -0.5};
    start[i].angular_velocity = {x, -2, 1};
  }
  states = start;
  for (RigidState<double>& y : states) y.position += law.scales.frame_time * y.velocity;
  const auto flown = states;
  typename Law::Workspace workspace(3, 1, 1);
  law.correct(std::span<const Body<double, Ball>>(bodies), std::span<const Plane<double>>(planes), start,
              flown, states, law.weight, workspace);
  for (std::size_t i = 0; i < 3; ++i) CHECK(!(states[i] == flown[i]));
  return states;
}

}  // namespace

TEST_CASE("an exported network gives the same bits") {
  check_same_bits(exported_f::network(), exported_float());
  check_same_bits(exported_d::network(), exported_double());
  check_same_bits(exported_s::network(), exported_half());
  static_assert(exported_f::weights[0] != 0);
  CHECK(exported_f::network().parameters().data() == exported_f::weights);
  const auto copy = static_cast<decltype(exported_float())>(exported_f::network());
  check_same_bits(copy, exported_float());
  static_assert(sizeof exported_s::weights * 2 == sizeof exported_f::weights);
}

TEST_CASE("an exported predictor gives the same bits and takes nothing from the heap") {
  const auto original = exported_predictor();
  CHECK(exported_p::predictor().flow.system[2].is_kinematic());
  rbres::Random random(15);
  for (int i = 0; i < 20; ++i) {
    exported_p::Predictor::State y;
    exported_p::Predictor::Wrenches w;
    for (int b = 0; b < 3; ++b) {
      y[b].position = {random.normal(), random.normal(), random.normal()};
      y[b].velocity = {random.normal(), random.normal(), random.normal()};
      y[b].angular_velocity = {random.normal(), random.normal(), random.normal()};
      w[static_cast<std::size_t>(b)].force = {random.normal(), 0, 1};
    }
    const auto expected = original.predict(y, w);
    const long before = allocations;
    const auto exported = exported_p::predictor();
    CHECK(exported.predict(y, w) == expected);
    CHECK(allocations == before);
    CHECK(!(original.predict(y, w) == original.flow(y, w, original.horizon)));
  }
}

TEST_CASE("an exported contact law gives the same bits") {
  CHECK(frame(exported_l::law()) == frame(exported_law()));
  CHECK(exported_l::law().scales.margin == 0.013);
  CHECK(frame(exported_hl::law()) == frame(exported_half_law()));
  CHECK(frame(exported_half_law()) != frame(exported_law()));
  CHECK(frame(exported_h::law()) == frame(exported_hybrid()));
  CHECK(exported_h::law().weight == 0.3);
}
