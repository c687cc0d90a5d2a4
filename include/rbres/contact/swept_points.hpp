#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <rbres/contact/contact_row.hpp>
#include <rbres/contact/near_pairs.hpp>
#include <rbres/core/pack.hpp>
#include <rbres/core/reserved.hpp>

namespace rbres::RBRES_ABI::detail {

/// The contact points of an island as sweep() takes them, where rows are plain numbers: the three directions
/// of a point, or the three components of a velocity, stand side by side in a register. Each point waits for
/// what the one before it did to their bodies, so that what counts is how soon that is there: points of one
/// pair are swept far apart from one another.
template <class System>
class SweptPoints {
  using S = typename System::Scalar;
  /// Never passed by value: where it is wider than a register, compilers differ about how.
  using Four = typename VectorOf<S, 4>::type;

 public:
  /// Room for so many points, in crowds, which alone are swept here.
  SweptPoints(const System& system, std::size_t most_rows) : place_(per_body<std::size_t>(system)) {
    if (!is_crowd(system)) return;
    points_.reserve(most_rows);
    velocities_.reserve(place_.size() + 1);
    bodies_.reserve(place_.size());
    place_.fill(plane);
  }

  /// Takes up the rows that are active, and the velocities of their bodies.
  template <class Rows, class Motions>
  void take(Rows& rows, Motions& motion) {
    velocities_.clear();
    velocities_.emplace_back();  // of planes
    std::size_t active = 0;
    rows.each(motion, [&](auto& row, auto&, auto&, auto&) { active += row.active; });
    points_.resize(active);
    stride_ = stride(active);
    std::size_t at = 0;
    rows.each(motion, [&](auto& row, auto& contact, auto& first, auto& second) {
      if (!row.active) return;
      Point& p = points_[at];
      at = (at + stride_) % active;
      p.response = contact.response();
      p.target = row.target;
      p.friction = row.friction;
      set(p.impulse, contact.impulse());
      p.second = place(row.who.second, second);
      p.second_mass = second.inverse_mass;
      p.first = plane;
      p.first_mass = S(0);
      p.drift = Four{};
      const Mat3<S> frame = contact.frame();
      set_rows(p.along, frame.x, frame.y, frame.z);
      set_columns(p.directions, frame.x, frame.y, frame.z);
      set_columns(p.second_arms, contact.second_arm(0), contact.second_arm(1), contact.second_arm(2));
      set_rows(p.second_spin, contact.second_spin(0), contact.second_spin(1), contact.second_spin(2));
      if constexpr (requires { contact.first_arm(0); }) {
        p.first = place(row.who.first, first);
        p.first_mass = first.inverse_mass;
        set_columns(p.first_arms, -contact.first_arm(0), -contact.first_arm(1), -contact.first_arm(2));
        set_rows(p.first_spin, contact.first_spin(0), contact.first_spin(1), contact.first_spin(2));
      } else {
        set(p.drift, contact.drift());
      }
    });
    for (const int body : bodies_) place_[static_cast<std::size_t>(body)] = plane;
    bodies_.clear();
  }
  /// Gives these rows the impulses here, and their bodies the velocities that they leave.
  template <class Rows, class Motions>
  void give(Rows& rows, Motions& motion) const {
    std::size_t at = 0;
    rows.each(motion, [&](auto& row, auto& contact, auto& first, auto& second) {
      if (!row.active) return;
      const Four& to = points_[at].impulse;
      at = (at + stride_) % points_.size();
      const std::array<S, 3>& from = contact.impulse();
      contact.add({to[0] - from[0], to[1] - from[1], to[2] - from[2]}, first, second);
    });
  }

  std::size_t size() const { return points_.size(); }
  /// See sweep(). Bodies of a heap may be wedged, and then no round brings anything, in step after step.
  /// @{
  static constexpr bool gives_up = true;
  void start() {
    for (Point& p : points_) p.way = Four{};
  }
  void start_round() {
    for (Point& p : points_) p.before = p.impulse;
  }
  S relax(std::size_t k, bool friction, bool) {
    using std::abs;
    Point& p = points_[k];
    const Velocity &a = velocities_[p.first], &b = velocities_[p.second];
    Four v = p.drift, turn = p.second_arms[0] * b.angular[0];  // sums that need not wait for one another
    for (std::size_t c = 0; c < 3; ++c) v += p.directions[c] * (b.linear[c] - a.linear[c]);
    for (std::size_t c = 1; c < 3; ++c) turn += p.second_arms[c] * b.angular[c];
    if (p.first != plane) {
      Four first_turn = p.first_arms[0] * a.angular[0];
      for (std::size_t c = 1; c < 3; ++c) first_turn += p.first_arms[c] * a.angular[c];
      turn += first_turn;
    }
    v += turn;
    if (!friction) {
      const S change = p.response.normal_change(p.impulse[0], v[0], p.target, true);
      add(p, change, S(0), S(0));
      return p.response.normal * abs(change);
    }
    const auto [change, fault] = p.response.step({p.impulse[0], p.impulse[1], p.impulse[2]}, v[0], v[1], v[2],
                                                 p.target, p.friction, true);
    add(p, change[0], change[1], change[2]);
    return fault;
  }
  S squared_change() const {
    Four sum{};
    for (const Point& p : points_) sum += (p.impulse - p.before) * (p.impulse - p.before);
    return sum[0] + sum[1] + sum[2];
  }
  void go_on(const S& share) {
    for (Point& p : points_) {
      const Four further = share * p.way;
      p.way = further + (p.impulse - p.before);
      add(p, further[0], further[1], further[2]);
    }
  }
  /// @}

 private:
  static constexpr std::size_t plane = 0;  ///< its place among the velocities
  using Three = std::array<Four, 3>;
  struct Velocity {
    Four linear{}, angular{};
  };
  struct Point {
    Three directions, second_arms, first_arms;  ///< [component]: of the three directions; first: negative
    Three along, second_spin, first_spin;       ///< [direction]: their components
    Four drift, impulse, before, way;           ///< along the three directions
    PointResponse<S> response;
    S target, friction, first_mass, second_mass;  ///< inverse masses
    std::size_t first, second;                    ///< places of the bodies' velocities
  };

  /// A step through so many places that comes to each of them once.
  static std::size_t stride(std::size_t size) {
    std::size_t stride = 1 + size * 3 / 8;
    while (std::gcd(stride, size) > 1) ++stride;
    return stride;
  }
  static void set(Four& to, const Vec3<S>& v) { to = Four{v.x, v.y, v.z, S(0)}; }
  static void set(Four& to, const std::array<S, 3>& v) { to = Four{v[0], v[1], v[2], S(0)}; }
  static void set_rows(Three& to, const Vec3<S>& a, const Vec3<S>& b, const Vec3<S>& c) {
    set(to[0], a);
    set(to[1], b);
    set(to[2], c);
  }
  static void set_columns(Three& to, const Vec3<S>& a, const Vec3<S>& b, const Vec3<S>& c) {
    set_rows(to, {a.x, b.x, c.x}, {a.y, b.y, c.y}, {a.z, b.z, c.z});
  }

  std::size_t place(int body, const Motion<S>& motion) {
    std::size_t& at = place_[static_cast<std::size_t>(body)];
    if (at == plane) {
      at = velocities_.size();
      Velocity& v = velocities_.emplace_back();
      set(v.linear, motion.velocity);
      set(v.angular, motion.angular_velocity);
      bodies_.push_back(body);
    }
    return at;
  }
  /// Adds an impulse along the three directions, N s.
  void add(Point& p, const S& normal, const S& u, const S& v) {
    p.impulse += Four{normal, u, v, S(0)};
    const Four push = normal * p.along[0] + u * p.along[1] + v * p.along[2];
    Velocity& b = velocities_[p.second];
    b.linear += p.second_mass * push;
    b.angular += normal * p.second_spin[0] + u * p.second_spin[1] + v * p.second_spin[2];
    if (p.first == plane) return;
    Velocity& a = velocities_[p.first];
    a.linear -= p.first_mass * push;
    a.angular -= normal * p.first_spin[0] + u * p.first_spin[1] + v * p.first_spin[2];
  }

  Reserved<Point> points_;
  std::size_t stride_ = 1;  ///< from a row's place among them to the next one's
  Reserved<Velocity> velocities_;
  PerBody<std::size_t, System::bodies> place_;
  Reserved<int> bodies_;  ///< that have a place while points are taken up
};

}  // namespace rbres::RBRES_ABI::detail
