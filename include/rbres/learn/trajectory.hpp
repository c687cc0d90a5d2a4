#pragma once

#include <cstddef>
#include <rbres/body/check_state.hpp>
#include <rbres/body/system.hpp>
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

  /// `states`: frame by frame, in each frame body by body. Throws Error for no bodies, for states that make
  /// no two whole frames, for numbers that are not finite, and for quaternions whose length is off by more
  /// than 1e-3; shorter errors of the length are normalised away.
  Trajectory(std::vector<BodyType> bodies, std::vector<State> states)
      : bodies_(std::move(bodies)), states_(std::move(states)) {
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
  /// Where body i was in frame t.
  const State& state(int t, int i) const { return frame(t)[static_cast<std::size_t>(i)]; }

 private:
  std::vector<BodyType> bodies_;
  std::vector<State> states_;
};

/// Scenes of one world: the same planes, gravity and time between frames, each scene with bodies of its own.
class TrajectorySet {
 public:
  /// frame_time: s; gravity: m/s^2, world frame. Throws Error for a frame time that is not positive, gravity
  /// or planes that are not finite, normals that are not unit vectors, and a set without scenes.
  TrajectorySet(double frame_time, const Vec3<double>& gravity, std::vector<Plane<double>> planes,
                std::vector<Trajectory> scenes)
      : frame_time_(frame_time),
        gravity_(gravity),
        planes_(detail::checked_planes(std::move(planes))),
        scenes_(std::move(scenes)) {
    if (!(frame_time > 0) || !is_finite(frame_time))
      detail::refuse("frame time", "a positive time in s", frame_time);
    for (const double g : {gravity.x, gravity.y, gravity.z})
      if (!is_finite(g)) detail::refuse("gravity", "three finite numbers (m/s^2)", g);
    if (scenes_.empty()) detail::refuse("scenes of a trajectory set", "at least one", "none");
  }

  double frame_time() const { return frame_time_; }         ///< s
  const Vec3<double>& gravity() const { return gravity_; }  ///< m/s^2, world frame
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
    return {frame_time_, gravity_, planes_, {begin() + first, begin() + first + count}};
  }

 private:
  double frame_time_;
  Vec3<double> gravity_;
  std::vector<Plane<double>> planes_;
  std::vector<Trajectory> scenes_;
};

}  // namespace rbres::RBRES_ABI
