#pragma once

#include <algorithm>
#include <rbres/core/lie.hpp>
#include <rbres/core/parallel.hpp>
#include <rbres/learn/robust_fit.hpp>
#include <rbres/learn/scene_system.hpp>

namespace rbres::RBRES_ABI {

/// A piece of a scene from which a simulation starts and with which it is compared.
struct Window {
  int scene;   ///< number in the set
  int first;   ///< frame at which it starts
  int frames;  ///< for which it goes on
};

/// Pieces of `frames` frames that follow one another: of each scene the first, then of each the second, and
/// so on until there are `most_states` states (bodies times frames) to simulate. A scene's last piece may be
/// shorter, down to a half.
inline std::vector<Window> windows_of(const TrajectorySet& set, int frames, long most_states) {
  std::vector<Window> all;
  long states = 0;
  for (int first = 0, left = set.size(); left > 0; first += frames) {
    left = 0;
    for (int s = 0; s < set.size(); ++s) {
      const int there = std::min(frames, set[s].frames() - 1 - first);
      if (there < 1 || (first > 0 && 2 * there < frames)) continue;
      if (states >= most_states) return all;
      all.push_back({s, first, there});
      states += static_cast<long>(there) * set[s].bodies();
      ++left;
    }
  }
  return all;
}

namespace detail {

/// How far a state is from another: position (m), and rotation times the body's radius of gyration (m).
inline Eigen::Matrix<double, 6, 1> state_error(const Body<double>& body, const RigidState<double>& found,
                                               const RigidState<double>& expected) {
  const Vec3<double>& i = body.inertia();
  const double lever = std::sqrt(std::max({i.x, i.y, i.z}) * body.inverse_mass());
  const Vec3<double> p = found.position - expected.position;
  const Vec3<double> r = lever * quaternion_log(expected.orientation.conjugate() * found.orientation);
  Eigen::Matrix<double, 6, 1> error;
  error << p.x, p.y, p.z, r.x, r.y, r.z;
  // A simulation that diverges is wrong by far, and no more.
  constexpr double far = 100;
  if (!error.allFinite()) error.setConstant(far);
  return error.cwiseMax(-far).cwiseMin(far);
}

}  // namespace detail

/// Fits numbers to trajectories. `simulator(scene, x)` gives, for values x, what takes a SceneState of that
/// scene from frame to frame; it is called from several threads.
template <class Simulator>
FitResult fit_windows(const TrajectorySet& set, const std::vector<Window>& windows,
                      const std::vector<FitNumber>& numbers, const Simulator& simulator,
                      const FitOptions& options = {}) {
  std::vector<Eigen::Index> clusters{0};
  for (const Window& w : windows)
    clusters.push_back(clusters.back() + static_cast<Eigen::Index>(w.frames) * set[w.scene].bodies());
  const auto errors = [&](const Eigen::VectorXd& x, Eigen::MatrixXd& e) {
    const auto count = std::upper_bound(clusters.begin(), clusters.end(), e.cols()) - clusters.begin() - 1;
    parallel_for(count, 0, [&](std::ptrdiff_t k) {
      const Window& w = windows[static_cast<std::size_t>(k)];
      const Trajectory& scene = set[w.scene];
      auto step = simulator(scene, x);
      const auto start = scene.frame(w.first);
      SceneState state{{start.begin(), start.end()}};
      Eigen::Index column = clusters[static_cast<std::size_t>(k)];
      for (int t = 1; t <= w.frames; ++t) {
        step(state);
        for (int i = 0; i < scene.bodies(); ++i)
          e.col(column++) = detail::state_error(scene.body(i), state[i], scene.state(w.first + t, i));
      }
    });
  };
  return RobustFit(numbers, 6, clusters, errors, options).run();
}

}  // namespace rbres::RBRES_ABI
