#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstring>
#include <rbres/contact/block_square.hpp>
#include <rbres/contact/cone_point.hpp>
#include <rbres/contact/contact_row.hpp>
#include <rbres/contact/point_jacobian.hpp>
#include <rbres/core/pack.hpp>
#include <rbres/core/reserved.hpp>
#include <type_traits>

namespace rbres::RBRES_ABI::detail {

/// IslandPoints of a single body that contacts move, some points at a time: those of a register, one in each
/// lane.
template <class S>
class BodyPoints {
  static constexpr std::size_t lanes = native_lanes<S>, most = 16;
  using Wide = Pack<S, int(lanes)>;
  /// Six numbers of the body, one of the right side, and one that fills a register.
  struct Line {
    static constexpr std::size_t wide = std::min<std::size_t>(lanes, 8);
    using Part = Pack<S, int(wide)>;
    std::array<Part, 8 / wide> parts{};

    Line() = default;
    explicit Line(const std::array<S, 8>& numbers) { std::memcpy(&parts, &numbers, sizeof numbers); }
    S operator[](std::size_t k) const { return parts[k / wide][int(k % wide)]; }
    void add(const S& share, const Line& line) {
      for (std::size_t i = 0; i < parts.size(); ++i) parts[i] += Part(share) * line.parts[i];
    }
  };

 public:
  /// As in IslandPoints. False where there are more bodies, or too many points.
  /// @{
  template <class Rows, class Motions>
  bool take_up(Rows& rows, Motions& motion, bool friction) {
    std::size_t count = 0;
    bool single = true;
    rows.each(motion, [&](auto& row, auto&, auto&, auto&) {
      if (count++ == 0) body_ = row.moved.second;
      single = single && row.moved.first < 0 && row.moved.second == body_;
    });
    if (!single || count > most) return false;
    groups_.clear();
    lines_.clear();
    rows.each(motion, [&](auto& row, auto& point, auto& first, auto& second) {
      const std::size_t l = lines_.size() % lanes;
      if (l == 0) groups_.emplace_back().response = {Wide(1), Wide(1)};  // of lanes without a point
      Group& g = groups_[groups_.size() - 1];
      const auto set = [&](Wide& to, const S& x) { ScalarTraits<Wide>::set_lane(to, int(l), x); };
      set(g.taken, row.active ? S(1) : S(0));
      set(g.response[0], point.normal_response());
      set(g.response[1], point.tangent_response());
      set(g.friction, friction ? row.friction : S(0));
      set(g.left.x, point.velocity(0, first, second) - row.target);
      set(g.left.y, point.velocity(1, first, second));
      set(g.left.z, point.velocity(2, first, second));
      std::array<Line, 3>& lines = lines_.emplace_back();
      const auto jacobian = lines_on_moved<S>(row, point);
      for (std::size_t d = 0; d < 3; ++d) {
        set(g.start[d], point.impulse()[d]);
        for (std::size_t k = 0; k < 6; ++k) set(g.jacobian[d][k], jacobian[d][k]);
        const auto& [a, b, c, x, y, z] = jacobian[d];
        lines[d] = Line({a, b, c, x, y, z, S(0), S(0)});
      }
    });
    for (Group& g : groups_) {
      g.take(g.response, g.start, g.taken > Wide(0));
      g.start = {g.impulse.x, g.impulse.y, g.impulse.z};
    }
    take_body(motion[static_cast<std::size_t>(body_)]);
    return true;
  }
  template <class Rows, class Motions>
  void give(Rows& rows, Motions& motion) const {
    std::array<Wide, 3> change{};
    std::size_t k = 0;
    rows.each(motion, [&](auto& row, auto& point, auto& first, auto& second) {
      const int l = int(k % lanes);
      if (l == 0) {
        const Group& g = groups_[k / lanes];
        change = g.result(g.friction);
        for (std::size_t d = 0; d < 3; ++d) change[d] -= g.start[d];
      }
      ++k;
      if (row.active) point.add({change[0][l], change[1][l], change[2][l]}, first, second);
    });
  }
  S read() {
    std::array<Line, 3> pushed;
    each_line([&](const Group& g, int l, const std::array<Line, 3>& line) {
      pushed[0].add(g.impulse.x[l] - g.start[0][l], line[0]);
      pushed[1].add(g.impulse.y[l] - g.start[1][l], line[1]);
      pushed[2].add(g.impulse.z[l] - g.start[2][l], line[2]);
    });
    std::array<S, 6> moved;
    for (std::size_t k = 0; k < 6; ++k) moved[k] = pushed[0][k] + pushed[1][k] + pushed[2][k];
    respond_to(start_, moved.data());
    Wide worst(0);
    for (Group& g : groups_) worst = g.read(g.left + g.velocity(moved), g.friction, worst);
    S largest = worst[0];
    for (int l = 1; l < int(lanes); ++l) largest = maximum(largest, worst[l]);
    return largest;
  }
  void keep() {
    for (Group& g : groups_) g.keep(true);
  }
  void advance(double soft) {
    for (Group& g : groups_) g.linearise(g.friction, soft);
    std::array<Line, 6> matrix = inertia_;
    Line right;
    each_line([&](const Group& g, int l, const std::array<Line, 3>& line) {
      const auto& [x, y, z] = g.slope;
      const auto sum = [&](const Wide& a, const Wide& b, const Wide& c) {
        Line all;
        all.add(a[l], line[0]);
        all.add(b[l], line[1]);
        all.add(c[l], line[2]);
        return all;
      };
      const Line n = sum(x.x, y.x, z.x), u = sum(x.y, y.y, z.y), v = sum(x.z, y.z, z.z);
      for (std::size_t k = 0; k < 6; ++k) {
        matrix[k].add(line[0][k], n);
        matrix[k].add(line[1][k], u);
        matrix[k].add(line[2][k], v);
      }
      right.add(g.push.x[l], line[0]);
      right.add(g.push.y[l], line[1]);
      right.add(g.push.z[l], line[2]);
    });
    alignas(64) std::array<S, 48> numbers;
    for (std::size_t k = 0; k < 6; ++k) {
      std::memcpy(&numbers[8 * k], &matrix[k], 8 * sizeof(S));
      numbers[8 * k + 6] = right[k];
    }
    std::array<S, 6> weight = weight_, step;
    eliminate(std::integral_constant<std::size_t, 6>(), std::integral_constant<std::size_t, 8>(),
              numbers.data(), weight.data(), step.data());
    for (Group& g : groups_) g.advance(g.velocity(step), g.active);
  }
  /// @}

 private:
  struct Group : ConePoint<Wide> {
    Wide taken;  ///< 1 where there is an active point
    Wide friction;
    std::array<Wide, 3> start;  ///< impulse before the first step, N s
    Vec3<Wide> left;            ///< fault that it leaves, m/s
    std::array<std::array<Wide, 6>, 3> jacobian;

    /// Of the points, by that of their body.
    Vec3<Wide> velocity(const std::array<S, 6>& six) const {
      const auto along = [&](const std::array<Wide, 6>& line) {
        Wide sum = line[0] * Wide(six[0]);
        for (std::size_t k = 1; k < 6; ++k) sum += line[k] * Wide(six[k]);
        return sum;
      };
      return {along(jacobian[0]), along(jacobian[1]), along(jacobian[2])};
    }
  };

  template <class F>
  void each_line(const F& f) const {
    for (std::size_t k = 0; k < lines_.size(); ++k) f(groups_[k / lanes], int(k % lanes), lines_[k]);
  }
  void take_body(const Motion<S>& body) {
    start_ = body;
    const S mass = inverse(body.inverse_mass), o(0);
    const Mat3<S> i = symmetric_inverse(body.inverse_inertia);
    inertia_ = {Line({mass, o, o, o, o, o, o, o}),          Line({o, mass, o, o, o, o, o, o}),
                Line({o, o, mass, o, o, o, o, o}),          Line({o, o, o, i.x.x, i.y.x, i.z.x, o, o}),
                Line({o, o, o, i.x.y, i.y.y, i.z.y, o, o}), Line({o, o, o, i.x.z, i.y.z, i.z.z, o, o})};
    const S weight = body.inverse_mass;
    weight_ = {weight, weight, weight, inverse(i.x.x), inverse(i.y.y), inverse(i.z.z)};
  }

  int body_ = 0;
  Motion<S> start_;
  std::array<Line, 6> inertia_;
  std::array<S, 6> weight_;  ///< see eliminate()
  Reserved<Group, (most + lanes - 1) / lanes> groups_;
  Reserved<std::array<Line, 3>, most> lines_;  ///< the Jacobian once more, point by point
};

}  // namespace rbres::RBRES_ABI::detail
