#pragma once

#include <cstddef>
#include <rbres/body/check_state.hpp>
#include <rbres/body/system.hpp>
#include <rbres/dynamics/forces.hpp>
#include <span>
#include <utility>
#include <vector>

namespace rbres::RBRES_ABI {

/// One scene: some bodies, and where they were at equal times, measured or simulated. How many bodies and
/// frames there are is known when the program runs. Overlaps are allowed: soft contacts have them.
class Trajectory {
 public:
  /// A body of it.
  using BodyType = Body<double>;
  /// Where one body is.
  using State = RigidState<double>;

  /// `states`: frame by frame, in each frame body by body. `wrenches`: one for each body, which acts on it at
  /// all times beside the set's forces (force in world frame, N; torque in body frame, N m), or none. Throws
  /// Error for no bodies, for states that make no two whole frames, for wrenches of another number, for
  /// numbers that are not finite, and for quaternions whose length is off by more than 1e-3; shorter errors
  /// of the length are normalised away.
  Trajectory(std::vector<BodyType> bodies, std::vector<State> states,
             std::vector<Wrench<double>> wrenches = {})
      : bodies_(std::move(bodies)), states_(std::move(states)), wrenches_(std::move(wrenches)) {
    if (bodies_.empty()) detail::refuse("bodies of a trajectory", "at least one", "none");
    if (states_.size() % bodies_.size() != 0) {
      detail::refuse("states of a trajectory", detail::text("whole frames of ", bodies_.size(), " bodies"),
                     detail::text(states_.size(), " states"));
    }
    if (frames() < 2) detail::refuse("frames of a trajectory", "at least 2", frames());
    for (std::size_t k = 0; k < states_.size(); ++k) {
      const auto where = [&] {
        return detail::text("frame ", k / bodies_.size(), ", body ", k % bodies_.size(), ", ");
      };
      detail::naming(where, [&] { detail::check_rigid_state(states_[k]); });
      detail::make_unit(states_[k].orientation);
    }
    if (!wrenches_.empty() && wrenches_.size() != bodies_.size())
      detail::refuse("wrenches of a trajectory", detail::text("one for each of ", bodies_.size(), " bodies"),
                     wrenches_.size());
    for (std::size_t i = 0; i < wrenches_.size(); ++i)
      for (const Vec3<double>& v : {wrenches_[i].force, wrenches_[i].torque})
        for (const double x : {v.x, v.y, v.z})
          if (!is_finite(x)) detail::refuse(detail::text("wrench on body ", i), "finite numbers", x);
  }

  /// How many there are.
  int bodies() const { return static_cast<int>(bodies_.size()); }
  /// How many there are.
  int frames() const { return static_cast<int>(states_.size() / bodies_.size()); }
  /// Body i, from 0.
  const BodyType& body(int i) const { return bodies_[static_cast<std::size_t>(i)]; }
  /// Where every body was in frame t.
  std::span<const State> frame(int t) const {
    return std::span(states_).subspan(static_cast<std::size_t>(t) * bodies_.size(), bodies_.size());
  }
  /// Of all frames, one behind the other.
  const std::vector<State>& states() const { return states_; }
  /// The wrench of its own on each body, or none.
  const std::vector<Wrench<double>>& wrenches() const { return wrenches_; }
  /// Where body i was in frame t.
  const State& state(int t, int i) const { return frame(t)[static_cast<std::size_t>(i)]; }

 private:
  std::vector<BodyType> bodies_;
  std::vector<State> states_;
  std::vector<Wrench<double>> wrenches_;
};

/// What slows bodies between their contacts. By default nothing does.
struct Resistance {
  /// Of a fluid at rest.
  FluidFriction<double> friction{.density = 0};
  /// Of the bodies' motion itself.
  Damping<double> damping{};

  /// Whether anything slows them.
  bool any() const { return friction.density != 0 || damping.linear != 0 || damping.angular != 0; }
  /// Throws Error for a number that is negative or not finite.
  void check() const {
    const auto check = [](const char* what, double x) {
      if (!(x >= 0) || !is_finite(x)) detail::refuse(what, "0 or more", x);
    };
    check("density of the fluid", friction.density);
    check("drag of the fluid", friction.drag);
    check("rotational drag of the fluid", friction.rotational_drag);
    check("linear damping", damping.linear);
    check("angular damping", damping.angular);
  }
};

/// Scenes of one world: the same planes, gravity, resistance and time between frames, each scene with bodies
/// of its own.
class TrajectorySet {
 public:
  /// frame_time: s; gravity: m/s^2, world frame. Throws Error for a frame time that is not positive, gravity
  /// or planes that are not finite, normals that are not unit vectors, a resistance that is negative, and a
  /// set without scenes.
  TrajectorySet(double frame_time, const Vec3<double>& gravity, std::vector<Plane<double>> planes,
                std::vector<Trajectory> scenes, const Resistance& resistance = {})
      : frame_time_(frame_time),
        gravity_(gravity),
        planes_(detail::checked_planes(std::move(planes))),
        scenes_(std::move(scenes)),
        resistance_(resistance) {
    if (!(frame_time > 0) || !is_finite(frame_time))
      detail::refuse("frame time", "a positive time in s", frame_time);
    for (const double g : {gravity.x, gravity.y, gravity.z})
      if (!is_finite(g)) detail::refuse("gravity", "three finite numbers (m/s^2)", g);
    resistance_.check();
    if (scenes_.empty()) detail::refuse("scenes of a trajectory set", "at least one", "none");
  }

  double frame_time() const { return frame_time_; }         ///< s
  const Vec3<double>& gravity() const { return gravity_; }  ///< m/s^2, world frame
  /// What slows bodies between their contacts.
  const Resistance& resistance() const { return resistance_; }
  /// Around all scenes.
  const std::vector<Plane<double>>& planes() const { return planes_; }
  int size() const { return static_cast<int>(scenes_.size()); }  ///< scenes
  /// Scene i, from 0.
  const Trajectory& operator[](int i) const { return scenes_[static_cast<std::size_t>(i)]; }
  /// For loops over all scenes.
  /// @{
  auto begin() const { return scenes_.begin(); }
  auto end() const { return scenes_.end(); }
  /// @}

  /// Scenes first, ..., first + count - 1 as a set. Throws Error where the set has fewer.
  TrajectorySet subset(int first, int count) const {
    if (first < 0 || count < 1 || count > size() - first)
      detail::refuse("scenes", detail::text("some within ", size()), detail::text(count, " from ", first));
    return {frame_time_, gravity_, planes_, {begin() + first, begin() + first + count}, resistance_};
  }

 private:
  double frame_time_;
  Vec3<double> gravity_;
  std::vector<Plane<double>> planes_;
  std::vector<Trajectory> scenes_;
  Resistance resistance_;
};

}  // namespace rbres::RBRES_ABI
