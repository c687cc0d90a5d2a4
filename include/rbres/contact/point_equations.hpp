#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <rbres/contact/block_square.hpp>
#include <rbres/contact/contact_row.hpp>
#include <rbres/contact/near_pairs.hpp>
#include <rbres/contact/point_jacobian.hpp>
#include <rbres/core/reserved.hpp>

namespace rbres::RBRES_ABI::detail {

/// IslandEquations of few points on many bodies, as in a chain of balls: over the velocities of the points,
/// three each, in place of six for each body,
///   (1 + response slope) dv = response push,
/// with what impulses at the points change of their velocities, response. Plain scalars only.
template <class System, class S>
class PointEquations {
  using Side = std::array<typename PointJacobian<S>::Line, 3>;

 public:
  /// The number of a point.
  using Jacobian = std::size_t;

  explicit PointEquations(const System&) {}

  /// Takes up an island. False where it has too many points, or bodies are fewer than half of them.
  template <class Rows, class Motions>
  bool take_up(Rows& rows, Motions& motion) {
    if (rows.size() > most) return false;
    points_.clear();
    rows.each(motion, [&](auto& row, auto& point, auto& first, auto& second) {
      Point& p = points_.emplace_back();
      p.body = {row.moved.first, row.moved.second};
      const auto take = [&](std::size_t k, const Side& side, const Motion<S>& body) {
        p.moved_by[k] = side;
        for (auto& line : p.answers[k] = side) respond_to(body, line.data());
      };
      take(1, lines_on_moved<S>(row, point), row.moved.second == row.who.first ? first : second);
      if constexpr (requires { point.first_arm(0); }) {
        if (row.moved.first >= 0) take(0, lines_on_first<S>(point), first);
      }
    });
    if (points_.size() >= 2 * count_bodies()) return false;
    size_ = 3 * points_.size();
    width_ = elimination_width(size_);
    named_ = 0;
    for (std::size_t i = 0; i < points_.size(); ++i) {
      for (std::size_t k = i; k < points_.size(); ++k) set_response(i, k);
    }
    return true;
  }
  /// Of the point of the next row.
  template <class Row, class Point>
  Jacobian jacobian(const Row&, const Point&) {
    return named_++;
  }

  /// As in IslandEquations.
  /// @{
  void stay() {}
  void push(Jacobian k, const Triple<S>& impulse) { set(right_, k, impulse); }
  void respond() { respond(right_, moved_); }
  Triple<S> moved(Jacobian k) const { return get(moved_, k); }
  void start() { std::fill_n(numbers_.begin(), size_ * width_, S(0)); }
  void add(Jacobian k, const std::array<Triple<S>, 3>& slope, const Triple<S>& push) {
    set(right_, k, push);
    for (std::size_t i = 0; i < size_; ++i) {
      const S* const from = &response_[i * wide + 3 * k];
      S* const to = &numbers_[i * width_ + 3 * k];
      for (std::size_t d = 0; d < 3; ++d)
        to[d] = from[0] * slope[0][d] + from[1] * slope[1][d] + from[2] * slope[2][d];
    }
    for (std::size_t d = 0; d < 3; ++d) numbers_[(3 * k + d) * width_ + 3 * k + d] += S(1);
  }
  void solve() {
    respond(right_, step_);
    for (std::size_t i = 0; i < size_; ++i) numbers_[i * width_ + size_] = step_[i];
    weight_.fill(S(1));
    eliminate(size_, width_, numbers_.data(), weight_.data(), step_.data());
  }
  Triple<S> change(Jacobian k) const { return get(step_, k); }
  /// @}

 private:
  /// Of larger islands the equations of all bodies are hardly more.
  static constexpr std::size_t most = 8, wide = 3 * most;
  using Numbers = std::array<S, wide>;
  struct Point {
    std::array<int, 2> body;       ///< of which contacts move these, the first may be negative
    std::array<Side, 2> moved_by;  ///< velocities by those of these bodies
    std::array<Side, 2> answers;   ///< what unit impulses change of these bodies' velocities
  };

  std::size_t count_bodies() const {
    std::array<int, 2 * most> bodies;
    auto end = bodies.begin();
    for (const Point& p : points_) {
      for (const int body : p.body) {
        if (body >= 0) *end++ = body;
      }
    }
    std::sort(bodies.begin(), end);
    return static_cast<std::size_t>(std::unique(bodies.begin(), end) - bodies.begin());
  }
  /// Of points i and k to one another, which is symmetric.
  void set_response(std::size_t i, std::size_t k) {
    const Point &p = points_[i], &q = points_[k];
    std::array<Triple<S>, 3> block{};
    for (std::size_t a = 0; a < 2; ++a) {
      for (std::size_t b = 0; b < 2; ++b) {
        if (p.body[a] < 0 || p.body[a] != q.body[b]) continue;
        for (std::size_t d = 0; d < 3; ++d) {
          const Triple<S> moved = along<S>(p.moved_by[a], q.answers[b][d].data());
          for (std::size_t e = 0; e < 3; ++e) block[e][d] += moved[e];
        }
      }
    }
    for (std::size_t e = 0; e < 3; ++e) {
      for (std::size_t d = 0; d < 3; ++d)
        response_[(3 * i + e) * wide + 3 * k + d] = response_[(3 * k + d) * wide + 3 * i + e] = block[e][d];
    }
  }
  void respond(const Numbers& impulses, Numbers& velocities) const {
    for (std::size_t i = 0; i < size_; ++i) {
      S sum(0);
      for (std::size_t k = 0; k < size_; ++k) sum += response_[i * wide + k] * impulses[k];
      velocities[i] = sum;
    }
  }
  static void set(Numbers& all, std::size_t k, const Triple<S>& three) {
    std::copy(three.begin(), three.end(), all.begin() + static_cast<std::ptrdiff_t>(3 * k));
  }
  static Triple<S> get(const Numbers& all, std::size_t k) {
    return {all[3 * k], all[3 * k + 1], all[3 * k + 2]};
  }

  Reserved<Point, most> points_;
  std::size_t size_ = 0, width_ = 0, named_ = 0;
  std::array<S, wide * wide> response_;
  std::array<S, wide*(wide + 8)> numbers_;  ///< see eliminate()
  Numbers weight_, right_, moved_, step_;
};

}  // namespace rbres::RBRES_ABI::detail
