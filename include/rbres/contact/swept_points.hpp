#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <rbres/contact/contact_row.hpp>
#include <rbres/core/pack.hpp>
#include <rbres/core/reserved.hpp>

namespace rbres::RBRES_ABI::detail {

/// The contact points of an island as sweep() takes them, where rows are plain numbers: the three directions
/// of a point, or the three components of a velocity, stand side by side in a register. Each point waits for
/// what the one before it did to their bodies, so that what counts is how soon that is there.
template <class System>
class SweptPoints {
  using S = typename System::Scalar;
  using Four = Pack<S, 4>;

 public:
  SweptPoints(const System& system, std::size_t most_rows) : place_(per_body<std::size_t>(system)) {
    points_.reserve(most_rows);
    velocities_.reserve(place_.size() + 1);
    bodies_.reserve(place_.size());
    place_.fill(plane);
  }

  /// Takes up the rows that are active, and the velocities of their bodies.
  template <class Rows, class Motions>
  void take(Rows& rows, Motions& motion) {
    points_.clear();
    velocities_.clear();
    velocities_.push_back({Four(S(0)), Four(S(0))});  // of planes
    rows.each(motion, [&](auto& row, auto& contact, auto& first, auto& second) {
      if (!row.active) return;
      Point& p = points_.emplace_back();
      p.response = contact.response();
      p.target = row.target;
      p.friction = row.friction;
      p.impulse = four(contact.impulse());
      p.second = place(row.who.second, second);
      p.second_mass = second.inverse_mass;
      p.first = plane;
      p.first_mass = S(0);
      p.drift = Four(S(0));
      const Mat3<S> frame = contact.frame();
      p.along = {four(frame.x), four(frame.y), four(frame.z)};
      p.directions = across(frame.x, frame.y, frame.z);
      const auto arm = [&](std::size_t d) { return contact.second_arm(d); };
      p.second_arms = across(arm(0), arm(1), arm(2));
      for (std::size_t d = 0; d < 3; ++d) p.second_spin[d] = four(contact.second_spin(d));
      if constexpr (requires { contact.first_arm(0); }) {
        p.first = place(row.who.first, first);
        p.first_mass = first.inverse_mass;
        p.first_arms = across(-contact.first_arm(0), -contact.first_arm(1), -contact.first_arm(2));
        for (std::size_t d = 0; d < 3; ++d) p.first_spin[d] = four(contact.first_spin(d));
      } else {
        p.drift = four(contact.drift());
      }
    });
    for (const int body : bodies_) place_[static_cast<std::size_t>(body)] = plane;
    bodies_.clear();
  }
  /// Gives these rows the impulses here, and their bodies the velocities that they leave.
  template <class Rows, class Motions>
  void give(Rows& rows, Motions& motion) const {
    std::size_t k = 0;
    rows.each(motion, [&](auto& row, auto& contact, auto& first, auto& second) {
      if (!row.active) return;
      const Four& to = points_[k++].impulse;
      const std::array<S, 3>& from = contact.impulse();
      contact.add({to[0] - from[0], to[1] - from[1], to[2] - from[2]}, first, second);
    });
  }

  std::size_t size() const { return points_.size(); }
  /// See sweep().
  /// @{
  void start() {
    for (Point& p : points_) p.way = Four(S(0));
  }
  void start_round() {
    for (Point& p : points_) p.before = p.impulse;
  }
  S relax(std::size_t k, bool friction, bool) {
    using std::abs;
    Point& p = points_[k];
    const Velocity &a = velocities_[p.first], &b = velocities_[p.second];
    Four v = p.drift;
    for (std::size_t c = 0; c < 3; ++c) {
      const int lane = static_cast<int>(c);
      v += p.directions[c] * Four(b.linear[lane] - a.linear[lane]) + p.second_arms[c] * Four(b.angular[lane]);
      if (p.first != plane) v += p.first_arms[c] * Four(a.angular[lane]);
    }
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
    Four sum(S(0));
    for (const Point& p : points_) sum += (p.impulse - p.before) * (p.impulse - p.before);
    return sum[0] + sum[1] + sum[2];
  }
  void go_on(const S& share) {
    for (Point& p : points_) {
      const Four further = Four(share) * p.way;
      p.way = further + (p.impulse - p.before);
      add(p, further[0], further[1], further[2]);
    }
  }
  /// @}

 private:
  static constexpr std::size_t plane = 0;  ///< its place among the velocities
  using Three = std::array<Four, 3>;
  struct Velocity {
    Four linear, angular;
  };
  struct Point {
    Three directions, second_arms, first_arms;  ///< [component]: of the three directions; first: negative
    Three along, second_spin, first_spin;       ///< [direction]: their components
    Four drift, impulse, before, way;           ///< along the three directions
    PointResponse<S> response;
    S target, friction, first_mass, second_mass;  ///< inverse masses
    std::size_t first, second;                    ///< places of the bodies' velocities
  };

  static Four four(const S& x, const S& y, const S& z) {
    Four r(S(0));
    r.v[0] = x;
    r.v[1] = y;
    r.v[2] = z;
    return r;
  }
  static Four four(const Vec3<S>& v) { return four(v.x, v.y, v.z); }
  static Four four(const std::array<S, 3>& v) { return four(v[0], v[1], v[2]); }
  static Three across(const Vec3<S>& a, const Vec3<S>& b, const Vec3<S>& c) {
    return {four(a.x, b.x, c.x), four(a.y, b.y, c.y), four(a.z, b.z, c.z)};
  }

  std::size_t place(int body, const Motion<S>& motion) {
    std::size_t& at = place_[static_cast<std::size_t>(body)];
    if (at == plane) {
      at = velocities_.size();
      velocities_.push_back({four(motion.velocity), four(motion.angular_velocity)});
      bodies_.push_back(body);
    }
    return at;
  }
  /// Adds an impulse along the three directions, N s.
  void add(Point& p, const S& normal, const S& u, const S& v) {
    const Four n(normal), s(u), t(v);
    p.impulse += four(normal, u, v);
    const Four push = n * p.along[0] + s * p.along[1] + t * p.along[2];
    Velocity& b = velocities_[p.second];
    b.linear += Four(p.second_mass) * push;
    b.angular += n * p.second_spin[0] + s * p.second_spin[1] + t * p.second_spin[2];
    if (p.first == plane) return;
    Velocity& a = velocities_[p.first];
    a.linear -= Four(p.first_mass) * push;
    a.angular -= n * p.first_spin[0] + s * p.first_spin[1] + t * p.first_spin[2];
  }

  Reserved<Point> points_;
  Reserved<Velocity> velocities_;
  PerBody<std::size_t, System::bodies> place_;
  Reserved<int> bodies_;  ///< that have a place while points are taken up
};

}  // namespace rbres::RBRES_ABI::detail
