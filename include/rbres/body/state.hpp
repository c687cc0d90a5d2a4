#pragma once

#include <array>
#include <rbres/core/per_body.hpp>
#include <rbres/core/vector.hpp>
#include <vector>

namespace rbres::RBRES_ABI {

/// The 13 numbers of one rigid body, in the paper's order (section 3.1): position 3, orientation 4, linear
/// velocity 3, angular velocity 3.
template <class S>
struct RigidState {
  /// How many numbers it is.
  static constexpr int size = 13;

  Vec3<S> position;          ///< of the centre of mass, world frame, m
  Quat<S> orientation;       ///< unit quaternion, body to world
  Vec3<S> velocity;          ///< of the centre of mass, world frame, m/s
  Vec3<S> angular_velocity;  ///< body frame, rad/s

  /// Angular velocity in the world frame, rad/s.
  Vec3<S> angular_velocity_world() const { return rotate(orientation, angular_velocity); }
  /// A point fixed to the body, given in the body frame (m), in the world frame (m).
  Vec3<S> point_world(const Vec3<S>& point) const { return position + rotate(orientation, point); }
  /// The 13 numbers as an Eigen vector that reads and writes this state.
  Eigen::Map<Eigen::Matrix<S, size, 1>> vector() {
    return Eigen::Map<Eigen::Matrix<S, size, 1>>(&position.x);
  }
  /// The same, to read only.
  Eigen::Map<const Eigen::Matrix<S, size, 1>> vector() const {
    return Eigen::Map<const Eigen::Matrix<S, size, 1>>(&position.x);
  }
  /// Whether all numbers are equal.
  friend bool operator==(const RigidState&, const RigidState&) = default;
};

/// The states of N bodies, one after the other: 13 N numbers.
template <class S, int N>
struct SystemState {
  /// How many bodies there are.
  static constexpr int bodies = N;
  /// How many numbers it is.
  static constexpr int size = N * RigidState<S>::size;

  /// The states, body by body.
  std::array<RigidState<S>, std::size_t(N)> body;

  /// The state of body i.
  /// @{
  RigidState<S>& operator[](int i) { return body[static_cast<std::size_t>(i)]; }
  const RigidState<S>& operator[](int i) const { return body[static_cast<std::size_t>(i)]; }
  /// @}
  /// The 13 N numbers as an Eigen vector that reads and writes this state.
  Eigen::Map<Eigen::Matrix<S, size, 1>> vector() {
    return Eigen::Map<Eigen::Matrix<S, size, 1>>(&body[0].position.x);
  }
  /// The same, to read only.
  Eigen::Map<const Eigen::Matrix<S, size, 1>> vector() const {
    return Eigen::Map<const Eigen::Matrix<S, size, 1>>(&body[0].position.x);
  }
  /// Whether all numbers are equal.
  friend bool operator==(const SystemState&, const SystemState&) = default;
};

/// The states of as many bodies as the program finds when it runs.
template <class S>
struct SystemState<S, dynamic> {
  static constexpr int bodies = dynamic;  ///< see size() for how many there are

  /// The states, body by body.
  std::vector<RigidState<S>> body;

  /// How many bodies there are.
  int size() const noexcept { return static_cast<int>(body.size()); }
  /// The state of body i.
  /// @{
  RigidState<S>& operator[](int i) { return body[static_cast<std::size_t>(i)]; }
  const RigidState<S>& operator[](int i) const { return body[static_cast<std::size_t>(i)]; }
  /// @}
  /// The 13 numbers of each body as an Eigen vector that reads and writes this state.
  Eigen::Map<Eigen::VectorX<S>> vector() {
    return {reinterpret_cast<S*>(body.data()), RigidState<S>::size * std::ssize(body)};
  }
  /// The same, to read only.
  Eigen::Map<const Eigen::VectorX<S>> vector() const {
    return {reinterpret_cast<const S*>(body.data()), RigidState<S>::size * std::ssize(body)};
  }
  /// Whether all numbers are equal.
  friend bool operator==(const SystemState&, const SystemState&) = default;
};

/// Force and torque on one body: 6 numbers.
template <class S>
struct Wrench {
  /// How many numbers it is.
  static constexpr int size = 6;

  Vec3<S> force;   ///< at the centre of mass, world frame, N
  Vec3<S> torque;  ///< about the centre of mass, body frame, N m

  /// The sum of two wrenches on one body.
  friend Wrench operator+(const Wrench& a, const Wrench& b) {
    return {a.force + b.force, a.torque + b.torque};
  }
  /// Whether all numbers are equal.
  friend bool operator==(const Wrench&, const Wrench&) = default;
};

static_assert(std::is_trivially_copyable_v<RigidState<double>> && sizeof(RigidState<double>) == 104);
static_assert(std::is_trivially_copyable_v<SystemState<double, 5>> && sizeof(SystemState<double, 5>) == 520);
static_assert(std::is_trivially_copyable_v<Wrench<float>> && sizeof(Wrench<float>) == 24);
static_assert(alignof(SystemState<float, 5>) == alignof(float));

/// Lane by lane.
template <Packed S>
RigidState<S> select(const MaskOf<S>& m, const RigidState<S>& a, const RigidState<S>& b) {
  return {select(m, a.position, b.position), select(m, a.orientation, b.orientation),
          select(m, a.velocity, b.velocity), select(m, a.angular_velocity, b.angular_velocity)};
}

/// One lane of a packed state, and the way back.
template <class S, int N>
SystemState<typename ScalarTraits<S>::Value, N> lane(const SystemState<S, N>& state, int i) {
  SystemState<typename ScalarTraits<S>::Value, N> out;
  if constexpr (N == dynamic) out.body.resize(state.body.size());
  const S* from = &state[0].position.x;
  auto* to = &out[0].position.x;
  const std::size_t numbers = RigidState<S>::size * state.body.size();
  for (std::size_t k = 0; k < numbers; ++k) to[k] = ScalarTraits<S>::lane(from[k], i);
  return out;
}
/// Sets one lane of a packed state.
template <class S, int N>
void set_lane(SystemState<S, N>& state, int i, const SystemState<typename ScalarTraits<S>::Value, N>& value) {
  S* to = &state[0].position.x;
  const auto* from = &value[0].position.x;
  const std::size_t numbers = RigidState<S>::size * state.body.size();
  for (std::size_t k = 0; k < numbers; ++k) ScalarTraits<S>::set_lane(to[k], i, from[k]);
}

}  // namespace rbres::RBRES_ABI
