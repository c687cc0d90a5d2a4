#pragma once

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <rbres/io/npy.hpp>
#include <rbres/learn/trajectory.hpp>
#include <vector>

/// The measured cube tosses of ContactNets (Pfrommer, Halm, Posa, CoRL 2020), and what is known of the cube.
namespace rbres::tosses {

inline constexpr double frame_time = 1.0 / 148;  ///< s
inline constexpr double half_width = 0.0524;     ///< m
inline constexpr double mass = 0.37;             ///< kg
inline constexpr double inertia = 8.1e-4;        ///< kg m^2, about every axis
inline constexpr double gravity = 9.81;          ///< m/s^2

using State = RigidState<double>;

/// A cube as it is said to be, with these frames. A frame's velocities are those that led to its pose:
/// position after = position before + frame_time * velocity after (SceneStep::Velocity::mean).
inline Trajectory cube_toss(std::vector<State> frames) {
  const Body<double> cube(Box(half_width, half_width, half_width), mass,
                          Vec3<double>{inertia, inertia, inertia});
  return {{cube}, std::move(frames)};
}

/// Tosses onto a floor at this height (m).
inline TrajectorySet toss_set(std::vector<Trajectory> tosses, double floor) {
  return {frame_time, {0, 0, -gravity}, {Plane<double>{{0, 0, 1}, floor, {}}}, std::move(tosses)};
}

/// Reads a .npy file of one row per frame and 14 columns: toss number, position (3), orientation (4, real
/// part first), velocity (3), body-frame angular velocity (3). A file that is missing or broken is refused
/// whole, naming the row (counted from 0): measured data with a hole in it would train and score something
/// else than it says. Refused are: another shape or type, no rows, a number that is not finite, a quaternion
/// whose length is off by more than 1e-3, a toss of a single frame. Shorter errors of a quaternion's length
/// are normalised away.
inline std::vector<Trajectory> read_tosses(const std::filesystem::path& path) {
  const NpyReader<double> file(path);
  const std::string name = path.string();
  if (file.shape().size() != 2 || file.features() != 14) {
    detail::refuse(name, "rows of 14 numbers", detail::text(file.features(), " a row"));
  }
  if (file.samples() == 0) detail::refuse(name, "at least one toss", "no rows");
  const auto rows = file.read();

  std::vector<Trajectory> tosses;
  std::vector<State> frames;
  const auto close_toss = [&](Eigen::Index row) {
    if (frames.size() < 2) {
      detail::refuse(detail::text(name, ", row ", row - 1), "a toss of two frames or more",
                     "one of a single frame");
    }
    tosses.push_back(cube_toss(std::move(frames)));
    frames.clear();
  };
  for (Eigen::Index r = 0; r < rows.cols(); ++r) {
    const auto x = rows.col(r);
    for (Eigen::Index c = 0; c < x.size(); ++c) {
      if (!std::isfinite(x[c]))
        detail::refuse(detail::text(name, ", row ", r, ", column ", c), "a finite number", x[c]);
    }
    const Quat<double> q{x[5], x[6], x[7], x[4]};
    const double length = std::sqrt(squared_norm(q));
    if (!(std::abs(length - 1) < 1e-3)) {
      detail::refuse(detail::text(name, ", row ", r), "a unit quaternion",
                     detail::text("one of length ", length));
    }
    if (r > 0 && x[0] != rows(0, r - 1)) close_toss(r);
    frames.push_back({{x[1], x[2], x[3]}, normalized(q), {x[8], x[9], x[10]}, {x[11], x[12], x[13]}});
  }
  close_toss(rows.cols());
  return tosses;
}

/// The floor's height, m: the median over tosses of where the cube's lowest corner is in the last frame, at
/// rest.
inline double floor_height(const std::vector<Trajectory>& tosses) {
  std::vector<double> lowest;
  for (const Trajectory& toss : tosses) {
    const State& last = toss.state(toss.frames() - 1, 0);
    const Mat3<double> axes = rotation_matrix(last.orientation);
    lowest.push_back(last.position.z -
                     half_width * (std::abs(axes.x.z) + std::abs(axes.y.z) + std::abs(axes.z.z)));
  }
  const auto middle = lowest.begin() + std::ssize(lowest) / 2;
  std::nth_element(lowest.begin(), middle, lowest.end());
  return *middle;
}

/// Each toss up to shortly after the cube has come to rest, but at least of `least` frames where it has so
/// many: at rest there is nothing to learn.
inline TrajectorySet until_rest(const TrajectorySet& set, int least) {
  std::vector<Trajectory> all;
  for (const Trajectory& toss : set) {
    int end = toss.frames();
    const auto moves = [](const State& s) {
      return norm(s.velocity) + half_width * norm(s.angular_velocity) > 0.05;
    };
    while (end > 2 && !moves(toss.state(end - 1, 0))) --end;
    end = std::min(toss.frames(), std::max(end + 5, least));
    all.push_back({{toss.body(0)}, {toss.states().begin(), toss.states().begin() + end}});
  }
  return {set.frame_time(), set.gravity(), set.planes(), std::move(all)};
}

}  // namespace rbres::tosses
