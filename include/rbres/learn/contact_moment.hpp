#pragma once

#include <rbres/learn/contact_flight.hpp>

#include <algorithm>
#include <cmath>
#include <optional>
#include <string_view>

namespace rbres::RBRES_ABI {

/// Where in a frame a contact law looks at a contact.
enum class ContactMoment {
  halfway,  ///< in the middle of the free flight, all at once: for soft contacts, which last for frames
  impact    ///< at the times of impact, one after the other where they share a body: for hard contacts, which
            ///< are over at once. Impulses are counted in units of the speed of approach.
};
/// As files name it.
inline constexpr std::string_view name(ContactMoment m) {
  return m == ContactMoment::halfway ? "halfway" : "impact";
}

/// The speeds and lengths that a contact law counts in, so that a small, slow world and a large, fast one
/// look alike to its network.
struct ContactScales {
  double frame_time = 0.01;  ///< s
  double speed = 1;          ///< of contacts that matter, m/s
  double margin = 2e-3;      ///< contacts whose gap is smaller, before or after free flight, take part, m
  ContactMoment moment = ContactMoment::halfway;  ///< when contacts are looked at

  /// The way of a frame, m.
  double gap() const { return speed * frame_time; }
  /// Slower slip and spin have no clear direction: tangential impulses fade with them, m/s.
  double slip() const { return 0.02 * speed; }
};

namespace detail {

/// A moment of a frame of free flight.
struct Moment {
  double share = 0.5;     ///< of the frame's time that has passed
  double bend = 0;        ///< how far paths are from their chords, in frame_time * (velocity - mean_velocity)
  double late = 1;        ///< velocities are mean_velocity + late * (velocity - mean_velocity)
  bool touching = false;  ///< surfaces touch at this moment, which therefore depends on the flights

  /// A share of the frame under a constant force.
  static Moment at(double share, bool touching = false) {
    const double since_middle = share - 0.5;
    return {share, square(since_middle) - 0.25, 2 * since_middle, touching};
  }
};

/// Velocity of the centre, m/s.
inline Vec3<double> velocity_at(const ContactFlight& f, const Moment& m) {
  return m.late * f.velocity + (1 - m.late) * f.mean_velocity;
}
/// Position of the centre; frame_time in s.
inline Vec3<double> position_at(const ContactFlight& f, const Moment& m, double frame_time) {
  return f.middle +
         frame_time * ((m.share - 0.5) * f.mean_velocity + m.bend * (f.velocity - f.mean_velocity));
}
/// How far the body has turned since halfway, as a rotation vector in the world frame, rad.
inline Vec3<double> turn_at(const ContactFlight& f, const Moment& m, double frame_time) {
  return ((m.share - 0.5) * frame_time) * f.spin;
}
inline Quat<double> orientation_at(const ContactFlight& f, const Moment& m, double frame_time) {
  return quaternion_exp(turn_at(f, m, frame_time)) * f.turned;
}

/// The way back through position_at(): adds to the derivatives by the flight and by the moment's share.
inline void add_position_gradient(const ContactFlight& f, const Moment& m, double frame_time,
                                  const Vec3<double>& by_position, ContactFlight& by_flight,
                                  double& by_share) {
  by_flight.middle += by_position;
  by_flight.mean_velocity += (frame_time * (m.share - 0.5 - m.bend)) * by_position;
  by_flight.velocity += (frame_time * m.bend) * by_position;
  by_share += frame_time * dot(velocity_at(f, m), by_position);
}
/// The way back through orientation_at(), for a moment that is given.
inline void add_orientation_gradient(const ContactFlight& f, const Moment& m, double frame_time,
                                     const Quat<double>& by_orientation, ContactFlight& by_flight) {
  if (m.share == 0.5) {
    by_flight.turned = by_flight.turned + by_orientation;
    return;
  }
  const Vec3<double> angle = turn_at(f, m, frame_time);
  const Quat<Dual<3>> turn = quaternion_exp(dual_vector<3>(angle, 0));
  const Eigen::Vector3d by_angle = pull_back<3>(by_orientation * f.turned.conjugate(), turn);
  by_flight.spin += ((m.share - 0.5) * frame_time) * Vec3<double>{by_angle[0], by_angle[1], by_angle[2]};
  by_flight.turned = by_flight.turned + quaternion_exp(-angle) * by_orientation;
}

/// The distance of a pair's surfaces at some moment, and how it changes, for each share of a frame.
struct Separation {
  double value, rate;  ///< m
};

/// The first moment from share `from` on at which surfaces touch and close in, by Newton's method within a
/// bracket; none where they miss. separation(Moment) gives a Separation.
template <class F>
std::optional<Moment> find_impact(double from, const F& separation) {
  Separation now = separation(Moment::at(from));
  if (now.value <= 0) {
    if (!(now.rate < 0)) return std::nullopt;
    // Surfaces that an impact of this frame has left touching.
    constexpr double rounding = 1e-12;  // m
    return Moment::at(from, from > 0 && now.value > -rounding);
  }
  const bool crosses = separation(Moment::at(1)).value <= 0;
  double share = from, low = from, high = 1;
  constexpr int most_steps = 60;
  for (int k = 0; k < most_steps; ++k) {
    double next = now.rate < 0 ? share - now.value / now.rate : high + 1;
    if (std::abs(next - share) < 1e-15) break;
    if (!(next > low && next < high)) {
      // A bracket is needed from here on. Until surfaces overlap there is none, but where the end is one.
      if (!crosses && high == 1) return std::nullopt;
      next = 0.5 * (low + high);
    }
    share = next;
    now = separation(Moment::at(share));
    if (now.value == 0) break;
    (now.value > 0 ? low : high) = share;
  }
  return Moment::at(share, true);
}

}  // namespace detail
}  // namespace rbres::RBRES_ABI
