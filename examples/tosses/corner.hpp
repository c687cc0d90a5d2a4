#pragma once

#include <array>
#include <functional>
#include <rbres/body/state.hpp>

#include "toss.hpp"

namespace rbres::tosses {

/// A step that a learned one corrects: free flight, or the simulator. From a state to the one a frame later.
using Prior = std::function<State(const State&)>;

/// A frame of motion without contact; the cube's spin keeps its body-frame value, its three moments of
/// inertia being equal.
inline State free_flight(const State& state) {
  State next = state;
  next.velocity = next.angular_velocity = {};
  add_velocity(next, state.velocity + Vec3<double>{0, 0, -gravity * frame_time}, state.angular_velocity);
  return next;
}

/// The cube as its corners see it, S being double or a dual number.
template <class S>
struct Posture {
  Mat3<S> axes;      ///< the body's axes in the world frame
  S height;          ///< of the centre above the floor, m
  Vec3<S> velocity;  ///< at the frame's end in free flight, world frame
  Vec3<S> spin;      ///< angular velocity, world frame
  Vec3<S> push;      ///< what the prior adds to that velocity
  Vec3<S> twist;     ///< what the prior adds to the spin

  /// `push_` and `twist_`: what the prior's velocity (world) and spin (body frame) are above those of free
  /// flight.
  Posture(const RigidState<S>& state, double floor, const Vec3<S>& push_, const Vec3<S>& twist_)
      : axes(rotation_matrix(state.orientation)),
        height(state.position.z - S(floor)),
        velocity(state.velocity.x, state.velocity.y, state.velocity.z - S(gravity * frame_time)),
        spin(axes * state.angular_velocity),
        push(push_),
        twist(axes * twist_) {}

  /// Where a point fixed to the cube, `arm` from its centre, would be above the floor at the frame's end, in
  /// free flight.
  S coming_height(const Vec3<S>& arm) const {
    return height + arm.z + S(frame_time) * (velocity.z + spin.x * arm.y - spin.y * arm.x);
  }
};

/// One corner of the cube in the frame in which contact is simplest: up, away from the centre, and along its
/// slip. Nothing here depends on where the cube is on the floor or which way it heads, so neither can a
/// prediction. The corner's three edges come in one of three orders (`turn`), which are its symmetries.
template <class S>
class Corner {
 public:
  static constexpr int count = 8, turns = 3;
  static constexpr int features = 36, coefficients = 5;
  /// A corner that stays higher than this in free flight gets no impulse, m.
  static constexpr double reach = 0.008;

  Corner(const Posture<S>& posture, int index, int turn) : posture_(posture) {
    const Mat3<S>& a = posture.axes;
    const auto outward = [&](int axis) {
      const Vec3<S>& v = axis == 0 ? a.x : axis == 1 ? a.y : a.z;
      return index >> axis & 1 ? v : -v;
    };
    const bool mirrored =
        ((index ^ index >> 1 ^ index >> 2) & 1) == 0;  // x, y, z would be a left-handed order
    for (int k = 0; k < 3; ++k) {
      const int place = (k + turn) % 3;
      edge_[static_cast<std::size_t>(k)] = outward(mirrored ? (3 - place) % 3 : place);
    }
    arm_ = S(half_width) * (edge_[0] + edge_[1] + edge_[2]);
    using std::sqrt;
    lever_ = sqrt(S(square(arm_.x) + square(arm_.y) + S(1e-6)));
    away_ = {arm_.x / lever_, arm_.y / lever_, S(0)};
    velocity_ = posture.velocity + cross(posture.spin, arm_);
    speed_ = sqrt(S(square(velocity_.x) + square(velocity_.y) + S(1e-4)));
    slip_ = {velocity_.x / speed_, velocity_.y / speed_, S(0)};
  }

  bool active() const { return posture_.coming_height(arm_) < S(reach); }

  /// The network's input: velocities in m/s, spins in 10 rad/s, lengths in 0.1 m or, near the floor, in 5 mm.
  /// It saturates beyond what tosses reach, so that a rollout gone astray cannot run away.
  std::array<S, features> encode() const {
    std::array<S, features> x;
    std::size_t n = 0;
    const auto put = [&](const Vec3<S>& v, double scale) {
      x[n++] = S(scale) * (v.x * away_.x + v.y * away_.y);
      x[n++] = S(scale) * (v.y * away_.x - v.x * away_.y);
      x[n++] = S(scale) * v.z;
    };
    put(velocity_, 1);
    put(posture_.velocity, 1);
    put(posture_.spin, 0.1);
    put(posture_.push, 1);
    put(posture_.twist, 0.1);
    x[n++] = speed_;
    x[n++] = S(10) * lever_;
    x[n++] = S(10) * arm_.z;
    for (const Vec3<S>& e : edge_) {
      x[n++] = e.x * away_.x + e.y * away_.y;
      x[n++] = e.y * away_.x - e.x * away_.y;
    }
    for (int other = 0; other < count; ++other) {
      Vec3<S> arm = arm_;
      for (int k = 0; k < 3; ++k) {
        if (other >> k & 1) arm -= S(2 * half_width) * edge_[static_cast<std::size_t>(k)];
      }
      const S height = posture_.coming_height(arm);
      x[n++] = clamp(S(S(200) * height), S(-2), S(2));
      if (other == 0 || other == 1 || other == 2 || other == 4) x[n++] = S(10) * height;
    }
    for (S& number : x) number = clamp(number, S(-4), S(4));
    return x;
  }

  /// The impulse (per mass, m/s, world frame) that the network's coefficients stand for: away from the
  /// centre, across that, up, along the slip, across that.
  template <class Coefficients>
  Vec3<S> impulse(const Coefficients& c) const {
    const S away(c[0]), across(c[1]), up(c[2]), along(c[3]), beside(c[4]);
    return {away * away_.x - across * away_.y + along * slip_.x - beside * slip_.y,
            away * away_.y + across * away_.x + along * slip_.y + beside * slip_.x, up};
  }
  /// What that impulse adds to the body-frame angular velocity.
  Vec3<S> spin_of(const Vec3<S>& impulse) const {
    return S(mass / inertia) * posture_.axes.transposed_times(cross(arm_, impulse));
  }
  /// From the gradient by the velocity and the spin that an impulse changes to that by its coefficients.
  void pull_back(const Vec3<S>& by_change, const Vec3<S>& by_spin, std::array<S, coefficients>& c) const {
    const Vec3<S> j = by_change + S(mass / inertia) * cross(posture_.axes * by_spin, arm_);
    c = {j.x * away_.x + j.y * away_.y, j.y * away_.x - j.x * away_.y, j.z, j.x * slip_.x + j.y * slip_.y,
         j.y * slip_.x - j.x * slip_.y};
  }

 private:
  const Posture<S>& posture_;
  std::array<Vec3<S>, 3> edge_;  ///< the body axes, pointing outward here
  Vec3<S> arm_, velocity_, away_, slip_;
  S lever_, speed_;
};

}  // namespace rbres::tosses
