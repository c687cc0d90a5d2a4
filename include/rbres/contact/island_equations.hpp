#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <rbres/contact/block_profile.hpp>
#include <rbres/contact/block_square.hpp>
#include <rbres/contact/near_pairs.hpp>
#include <rbres/contact/point_jacobian.hpp>
#include <rbres/core/reserved.hpp>

namespace rbres::RBRES_ABI::detail {

/// Of a factorisation: an island of 9 bodies in a heap, or of some 100 in a row. Larger ones take as many
/// numbers, too.
inline constexpr std::size_t most_products = 40'000, most_numbers = 10'000;
constexpr std::size_t most_numbers_of(std::size_t bodies) {
  return std::min(6 * bodies * (6 * bodies + 1) / 2, most_numbers);
}
/// Of an island whose equations are not symmetric.
inline constexpr std::size_t most_coupled_bodies = 12;

/// The linear equations of one step of Newton's method over the velocities of an island's bodies,
///   (M + sum of J^T slope J) dv = sum of J^T push - M moved,
/// with the bodies' masses M and the change of their velocities so far, moved. `Symmetric`: whether each
/// slope is. `S`: the system's numbers, or those of one of its lanes.
template <class System, bool Symmetric, class S = typename System::Scalar>
class IslandEquations {
  using Six = typename PointJacobian<S>::Line;

 public:
  using Jacobian = PointJacobian<S>;
  /// Stands for the place of a plane or of a kinematic body.
  static constexpr std::size_t plane = std::numeric_limits<std::size_t>::max();

  explicit IslandEquations(const System& system)
      : place_(per_body<std::size_t>(system)), matrix_(matrix_for(place_.size())) {
    const std::size_t n = place_.size();
    place_.fill(plane);
    bodies_.reserve(n);
    first_.reserve(n);
    inertia_.reserve(n);
    start_.reserve(n);
    step_.reserve(6 * n);
    moved_.reserve(6 * n);
  }

  /// Takes up the bodies of an island's rows (ContactRows), which get their places in the order in which rows
  /// name them. False where the matrix would be too large.
  template <class Rows, class Motions>
  bool take_up(Rows& rows, Motions& motion) {
    for (const int body : bodies_) place_[static_cast<std::size_t>(body)] = plane;
    bodies_.clear();
    first_.clear();
    if constexpr (Packed<S>) {  // the same places, whatever touches in other lanes
      for (std::size_t i = 0; i < place_.size(); ++i) {
        place_[i] = i;
        bodies_.push_back(static_cast<int>(i));
        first_.push_back(0);
      }
    }
    rows.each(motion, [&](auto& row, auto&, auto&, auto&) {
      const std::size_t second = name(row.moved.second);
      if (row.moved.first < 0) return;
      const std::size_t first = name(row.moved.first);
      const auto [low, high] = std::minmax(first, second);
      first_[high] = std::min(first_[high], low);
    });
    if (!shape_matrix()) return false;
    take_bodies(motion);
    return true;
  }
  /// The Jacobian of a row's point.
  template <class Row, class Point>
  Jacobian jacobian(const Row& row, const Point& point) const {
    Jacobian j{};
    j.first = plane;
    j.second = place_[static_cast<std::size_t>(row.moved.second)];
    j.on_second = lines_on_moved<S>(row, point);
    if constexpr (requires { point.first_arm(0); }) {
      j.on_first = lines_on_first<S>(point);
      if (row.moved.first >= 0) j.first = place_[static_cast<std::size_t>(row.moved.first)];
    }
    return j;
  }
  /// Gives these bodies the motions that they had then.
  template <class Motions>
  void restart(Motions& motion) const {
    for (std::size_t i = 0; i < bodies_.size(); ++i) motion[static_cast<std::size_t>(bodies_[i])] = start_[i];
  }

  /// Nothing has moved.
  void stay() { std::fill(moved_.begin(), moved_.end(), S(0)); }
  /// Moves the bodies by the impulses (N s) of push() since stay().
  /// @{
  void push(const Jacobian& j, const Triple<S>& impulse) {
    add_push(j.second, j.on_second, impulse, moved_);
    if (j.first != plane) add_push(j.first, j.on_first, impulse, moved_);
  }
  void respond() {
    for (std::size_t i = 0; i < bodies_.size(); ++i) respond_to(start_[i], &moved_[6 * i]);
  }
  /// @}
  /// How that changes a point's velocity.
  Triple<S> moved(const Jacobian& j) const { return velocity(j, moved_); }

  /// Starts the equations with the bodies' masses.
  void start() {
    matrix_.clear();
    for (std::size_t i = 0; i < bodies_.size(); ++i) {
      const auto& [mass, inertia] = inertia_[i];
      for (std::size_t d = 0; d < 3; ++d) matrix_(6 * i + d, 6 * i + d) = mass;
      matrix_(6 * i + 3, 6 * i + 3) = inertia.x.x;
      matrix_(6 * i + 4, 6 * i + 3) = inertia.x.y;
      matrix_(6 * i + 4, 6 * i + 4) = inertia.y.y;
      matrix_(6 * i + 5, 6 * i + 3) = inertia.x.z;
      matrix_(6 * i + 5, 6 * i + 4) = inertia.y.z;
      matrix_(6 * i + 5, 6 * i + 5) = inertia.z.z;
      if constexpr (!Symmetric) {
        matrix_(6 * i + 3, 6 * i + 4) = inertia.x.y;
        matrix_(6 * i + 3, 6 * i + 5) = inertia.x.z;
        matrix_(6 * i + 4, 6 * i + 5) = inertia.y.z;
      }
      if constexpr (Symmetric) {
        const Six m = momentum(i, &moved_[6 * i]);
        for (std::size_t d = 0; d < 6; ++d) step_[6 * i + d] = -m[d];
      }
    }
    if constexpr (!Symmetric) {
      std::fill(step_.begin(), step_.end(), S(0));
      matrix_.weigh();
    }
  }
  /// Adds J^T slope J and J^T push of one point.
  void add(const Jacobian& j, const std::array<Triple<S>, 3>& slope, const Triple<S>& push) {
    add_push(j.second, j.on_second, push, step_);
    if (j.first != plane) add_push(j.first, j.on_first, push, step_);
    const MaskOf<S> pushes = slope[0][0] > S(0), rubs = slope[1][1] + slope[2][2] > S(0);
    if (!any(pushes | rubs)) return;
    add_block(j.second, j.on_second, slope, j.second, j.on_second);
    if (j.first == plane) return;
    add_block(j.first, j.on_first, slope, j.first, j.on_first);
    if (!Symmetric || j.second > j.first) add_block(j.second, j.on_second, slope, j.first, j.on_first);
    if (!Symmetric || j.second < j.first) add_block(j.first, j.on_first, slope, j.second, j.on_second);
  }
  /// Finds the step of the bodies' velocities.
  void solve() {
    if constexpr (Symmetric) matrix_.factor();
    matrix_.solve(step_);
  }

  /// How the step changes a point's velocity.
  Triple<S> change(const Jacobian& j) const { return velocity(j, step_); }
  /// The slope of the kinetic part, dv . M (moved + length dv), is rise + length bend.
  struct KineticSlope {
    S rise, bend;
  };
  KineticSlope kinetic_slope() const {
    S bend(0), rise(0);
    for (std::size_t i = 0; i < bodies_.size(); ++i) {
      const Six m = momentum(i, &step_[6 * i]);
      for (std::size_t d = 0; d < 6; ++d) {
        bend += m[d] * step_[6 * i + d];
        rise += m[d] * moved_[6 * i + d];
      }
    }
    return {rise, bend};
  }
  /// Goes the share `way` of the step.
  void advance(const S& way) {
    for (std::size_t i = 0; i < moved_.size(); ++i) moved_[i] += way * step_[i];
  }

 private:
  static constexpr std::size_t room = body_room<System>;
  static constexpr std::size_t number_room = room_for<System>(6 * room);
  using Matrix = std::conditional_t<Symmetric, BlockProfile<S, room, room_for<System>(most_numbers_of(room))>,
                                    BlockSquare<S, room_for<System>(std::min(room, most_coupled_bodies))>>;
  struct Inertia {
    S mass;
    Mat3<S> tensor;  ///< world frame
  };

  static Matrix matrix_for(std::size_t bodies) {
    if constexpr (Symmetric) {
      return Matrix(bodies, most_numbers_of(bodies));
    } else {
      return Matrix(std::min(bodies, most_coupled_bodies));
    }
  }
  bool shape_matrix() {
    if constexpr (Symmetric) {
      return matrix_.shape(first_, most_products);
    } else {
      return matrix_.shape(bodies_.size());
    }
  }
  template <class Motions>
  void take_bodies(const Motions& motion) {
    step_.resize(6 * bodies_.size());
    moved_.resize(6 * bodies_.size());
    inertia_.clear();
    start_.clear();
    for (const int body : bodies_) {
      const Motion<S>& m = motion[static_cast<std::size_t>(body)];
      start_.push_back(m);
      // No point names a kinematic body; in lanes it has a place, and any mass does.
      if (Packed<S> && !any(m.inverse_mass > S(0))) {
        inertia_.push_back({S(1), {{S(1), S(0), S(0)}, {S(0), S(1), S(0)}, {S(0), S(0), S(1)}}});
        continue;
      }
      inertia_.push_back({inverse(m.inverse_mass), symmetric_inverse(m.inverse_inertia)});
    }
  }
  std::size_t name(int body) {
    std::size_t& at = place_[static_cast<std::size_t>(body)];
    if (at == plane) {
      at = bodies_.size();
      bodies_.push_back(body);
      first_.push_back(at);
    }
    return at;
  }
  static void add_push(std::size_t i, const std::array<Six, 3>& side, const Triple<S>& push,
                       std::span<S> to) {
    for (std::size_t d = 0; d < 3; ++d) {
      for (std::size_t k = 0; k < 6; ++k) to[6 * i + k] += side[d][k] * push[d];
    }
  }
  static Triple<S> velocity(const Jacobian& j, std::span<const S> moves) {
    Triple<S> v = along(j.on_second, &moves[6 * j.second]);
    if (j.first == plane) return v;
    const Triple<S> of_first = along(j.on_first, &moves[6 * j.first]);
    for (std::size_t d = 0; d < 3; ++d) v[d] += of_first[d];
    return v;
  }
  void add_block(std::size_t i, const std::array<Six, 3>& left, const std::array<Triple<S>, 3>& slope,
                 std::size_t j, const std::array<Six, 3>& right) {
    std::array<Six, 3> sloped;
    for (std::size_t d = 0; d < 3; ++d) {
      for (std::size_t c = 0; c < 6; ++c)
        sloped[d][c] = slope[d][0] * right[0][c] + slope[d][1] * right[1][c] + slope[d][2] * right[2][c];
    }
    for (std::size_t k = 0; k < 6; ++k) {
      S* line = &matrix_(6 * i + k, 6 * j);
      const std::size_t end = Symmetric && i == j ? k + 1 : 6;
      for (std::size_t c = 0; c < end; ++c)
        line[c] += left[0][k] * sloped[0][c] + left[1][k] * sloped[1][c] + left[2][k] * sloped[2][c];
    }
  }
  /// Mass and inertia times a velocity.
  Six momentum(std::size_t i, const S* v) const {
    const auto& [mass, inertia] = inertia_[i];
    const Vec3<S> spin = inertia * Vec3<S>{v[3], v[4], v[5]};
    return {mass * v[0], mass * v[1], mass * v[2], spin.x, spin.y, spin.z};
  }

  PerBody<std::size_t, System::bodies> place_;
  Reserved<int, room> bodies_;
  Reserved<std::size_t, room> first_;
  Reserved<Inertia, room> inertia_;
  Reserved<Motion<S>, room> start_;  ///< the bodies' motions when they were taken up
  Matrix matrix_;
  Reserved<S, number_room> step_;   ///< right side, then the step of the bodies' velocities
  Reserved<S, number_room> moved_;  ///< by the steps so far
};

}  // namespace rbres::RBRES_ABI::detail
