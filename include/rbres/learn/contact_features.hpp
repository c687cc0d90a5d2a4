#pragma once

#include <rbres/contact/contact_pair.hpp>
#include <rbres/learn/contact_points.hpp>

#include <array>
#include <cmath>

namespace rbres::RBRES_ABI {

namespace detail {

/// x / sqrt(1 + x^2), and its derivative.
inline double squash(double x) { return x / std::sqrt(1 + x * x); }
inline double squash_slope(double x) { return 1 / ((1 + x * x) * std::sqrt(1 + x * x)); }

/// A contact as a law sees it: everything is measured along its normal, along its slip and across both. None
/// of the features changes when the world is turned or mirrored, or the bodies are numbered otherwise.
struct Contact {
  static constexpr int features = 20;
  using Features = std::array<double, features>;

  int first, second;  ///< indices of bodies; first is -1 - p for plane p
  int place;          ///< of the pair's manifold
  Moment moment;      ///< at which it is looked at
  Surface<double> surface;
  ContactPlace at;

  std::array<Vec3<double>, 2> arm;  ///< from the bodies' centres to the point, m
  Vec3<double> relative, mean;      ///< velocity of the second body's point less the first's, m/s: after the
                                    ///< free flight or at the impact, and over the frame
  double gap_before, gap_after;     ///< m
  double presence;                  ///< 1 where the surfaces touch, 0 at the margin
  double normal_speed, slip;        ///< m/s; slip is never quite 0
  double unit;                      ///< of speed, in which the network counts this contact's impulses, m/s
  Vec3<double> tangent;             ///< along the slip, shorter than 1 where it is slow
  double twist, twist_size, twist_sign;  ///< spin about the normal, rad/s: signed, its size and its soft sign
  double normal_mobility, tangent_mobility;  ///< 1/kg; tangent: mean over the plane's directions
  double twist_mobility;                     ///< 1/(kg m^2)
  double length;                             ///< of the arms: 1 / (1/|arm 1| + 1/|arm 2|), m

  // What measure_responses() fills in.
  double push;        ///< trial impulse along the normal, N s
  double response;    ///< what all pushes change of the normal speed, m/s
  double swerve;      ///< what they change of the velocity along the surface, m/s; never quite 0
  Vec3<double> side;  ///< along that change, shorter than 1 where it is slow
  double along_tangent, across, along_side;  ///< mobilities between tangent and side, 1/kg

  bool plane() const { return first < 0; }
  double smallest_gap() const { return std::min(gap_before, gap_after); }
  /// The gap that decides whether the contact takes part, m.
  double nearest(const ContactScales& scales) const {
    return scales.moment == ContactMoment::impact ? at.gap : smallest_gap();
  }
};

/// Whatever one body adds to a contact's mobilities.
struct Mobility {
  double normal, trace, twist;
};
inline Mobility mobility_of(double inverse_mass, const Mat3<double>& inverse_inertia, const Vec3<double>& arm,
                            const Vec3<double>& normal) {
  const Vec3<double> lever = cross(arm, normal);
  const double trace = inverse_inertia.x.x + inverse_inertia.y.y + inverse_inertia.z.z;
  return {inverse_mass + dot(lever, inverse_inertia * lever),
          3 * inverse_mass + trace * squared_norm(arm) - dot(arm, inverse_inertia * arm),
          dot(normal, inverse_inertia * normal)};
}

/// The flights of a contact's bodies, [1] the second body's; of a plane there is none.
template <class Flight>
using FlightPair = std::array<Flight*, 2>;

/// The two of `all` that a contact joins; no first one where that is a plane.
template <class Vector>
auto pair_of(const Contact& c, Vector& all) {
  using Element = std::remove_pointer_t<decltype(all.data())>;
  return FlightPair<Element>{c.plane() ? nullptr : all.data() + c.first, all.data() + c.second};
}

/// Fills in what follows from place, flights and masses.
inline void measure(Contact& c, const FlightPair<const ContactFlight>& flight, const ContactScales& scales) {
  const Vec3<double>& n = c.at.normal;
  c.relative = {}, c.mean = {};
  Vec3<double> spin;
  Mobility mobility{};
  double inverse_length = 0;
  for (std::size_t b = c.plane() ? 1 : 0; b < 2; ++b) {
    const ContactFlight& f = *flight[b];
    const double sign = b == 1 ? 1 : -1;
    c.arm[b] = c.at.point - position_at(f, c.moment, scales.frame_time);
    const Vec3<double> turning = cross(f.spin, c.arm[b]);
    c.relative += sign * (velocity_at(f, c.moment) + turning);
    c.mean += sign * (f.mean_velocity + turning);
    spin += sign * f.spin;
    const Mobility own = mobility_of(f.inverse_mass, f.inverse_inertia, c.arm[b], n);
    mobility.normal += own.normal, mobility.trace += own.trace, mobility.twist += own.twist;
    inverse_length += 1 / norm(c.arm[b]);
  }
  const double opening = scales.frame_time * dot(n, c.mean);
  c.gap_before = c.at.gap - c.moment.share * opening;
  c.gap_after = c.at.gap + (1 - c.moment.share) * opening;
  c.presence = clamp(1 - c.nearest(scales) / scales.margin, 0.0, 1.0);
  c.normal_speed = dot(n, c.relative);
  c.unit = scales.moment == ContactMoment::impact ? std::sqrt(square(c.normal_speed) + square(scales.slip()))
                                                  : scales.speed;
  const Vec3<double> along = c.relative - c.normal_speed * n;
  c.slip = std::sqrt(squared_norm(along) + square(scales.slip()));
  c.tangent = (1 / c.slip) * along;
  c.length = 1 / inverse_length;
  c.twist = dot(n, spin);
  c.twist_size = std::sqrt(square(c.twist) + square(scales.slip() / c.length));
  c.twist_sign = c.twist / c.twist_size;
  c.normal_mobility = mobility.normal;
  c.tangent_mobility = 0.5 * (mobility.trace - mobility.normal);
  c.twist_mobility = mobility.twist;
}

/// What the network is told of a contact.
inline Contact::Features features_of(const Contact& c, const ContactScales& scales) {
  const double g = scales.gap(), v = scales.speed;
  return {4 * squash(c.gap_before / (4 * g)),
          4 * squash(c.gap_after / (4 * g)),
          squash(10 * c.gap_before / g),
          squash(10 * c.gap_after / g),
          c.normal_speed / v,
          c.slip / v,
          squash(10 * c.slip / v),
          c.twist_size * c.length / v,
          std::log(c.normal_mobility),
          std::log(c.tangent_mobility / c.normal_mobility),
          std::log(c.length),
          c.plane() ? 1.0 : 0.0,
          c.surface.restitution,
          c.surface.friction,
          c.response / v,
          c.swerve / v,
          dot(c.tangent, c.side),
          c.along_tangent / c.tangent_mobility,
          c.across / c.tangent_mobility,
          c.along_side / c.tangent_mobility};
}

/// Derivatives by what measure() fills in, where something depends on it directly; the others are worked out
/// on the way back.
struct ContactGradient {
  ContactPlace at{};
  std::array<Vec3<double>, 2> arm{};
  Vec3<double> tangent{}, side{};
  double share = 0;  ///< of the moment
  double gap_before = 0, gap_after = 0, presence = 0, normal_speed = 0, unit = 0, twist_sign = 0,
         normal_mobility = 0, tangent_mobility = 0, twist_mobility = 0, length = 0, response = 0, swerve = 0,
         along_tangent = 0, across = 0, along_side = 0;
};

/// The way back through the features that measure_responses() fills in.
inline void add_response_features_gradient(const Contact& c, const ContactScales& scales,
                                           const Contact::Features& f, ContactGradient& by) {
  by.response += f[14] / scales.speed;
  by.swerve += f[15] / scales.speed;
  by.tangent += f[16] * c.side;
  by.side += f[16] * c.tangent;
  by.along_tangent += f[17] / c.tangent_mobility;
  by.across += f[18] / c.tangent_mobility;
  by.along_side += f[19] / c.tangent_mobility;
  by.tangent_mobility -=
      (f[17] * c.along_tangent + f[18] * c.across + f[19] * c.along_side) / square(c.tangent_mobility);
}

/// The way back through the other features and measure(): completes `by.at` and `by.share`, and adds to the
/// derivatives by the flights.
inline void add_measure_gradient(const Contact& c, const FlightPair<const ContactFlight>& flight,
                                 const ContactScales& scales, const Contact::Features& by_features,
                                 ContactGradient& by, const FlightPair<ContactFlight>& by_flight) {
  const Vec3<double>& n = c.at.normal;
  Vec3<double>& by_n = by.at.normal;
  const double g = scales.gap(), v = scales.speed;
  const auto& f = by_features;
  double by_before = by.gap_before + f[0] * squash_slope(c.gap_before / (4 * g)) / g +
                     f[2] * squash_slope(10 * c.gap_before / g) * 10 / g;
  double by_after = by.gap_after + f[1] * squash_slope(c.gap_after / (4 * g)) / g +
                    f[3] * squash_slope(10 * c.gap_after / g) * 10 / g;
  double by_normal_speed = f[4] / v + by.normal_speed;
  if (scales.moment == ContactMoment::impact) by_normal_speed += by.unit * c.normal_speed / c.unit;
  double by_slip = f[5] / v + f[6] * squash_slope(10 * c.slip / v) * 10 / v;
  const double by_twist_size = f[7] * c.length / v;
  double by_length = by.length + f[7] * c.twist_size / v + f[10] / c.length;
  double by_normal_mobility = by.normal_mobility + (f[8] - f[9]) / c.normal_mobility;
  const double by_tangent_mobility = by.tangent_mobility + f[9] / c.tangent_mobility;

  if (c.presence > 0 && c.presence < 1) {
    double& by_nearest = scales.moment == ContactMoment::impact ? by.at.gap
                         : c.gap_before < c.gap_after           ? by_before
                                                                : by_after;
    by_nearest -= by.presence / scales.margin;
  }

  const Vec3<double> by_along = (1 / c.slip) * by.tangent;
  by_slip -= dot(c.tangent, by_along);
  const Vec3<double> by_relative_tangent = by_along + by_slip * c.tangent;
  // along = relative - (n . relative) n
  by_normal_speed -= dot(n, by_relative_tangent);
  by_n -= c.normal_speed * by_relative_tangent;
  by_n += by_normal_speed * c.relative;
  const Vec3<double> by_relative = by_relative_tangent + by_normal_speed * n;

  by.at.gap += by_before + by_after;
  const double share = c.moment.share;
  const double by_opening = scales.frame_time * ((1 - share) * by_after - share * by_before);
  by_n += by_opening * c.mean;
  const Vec3<double> by_mean = by_opening * n;
  by.share -= scales.frame_time * dot(n, c.mean) * (by_before + by_after);

  const double faint2 = square(scales.slip() / c.length), size = c.twist_size;
  const double by_twist = by_twist_size * c.twist_sign + by.twist_sign * faint2 / (size * size * size);
  // size = sqrt(twist^2 + (slip / length)^2), sign = twist / size
  const double by_size = by_twist_size - by.twist_sign * c.twist_sign / size;
  by_length -= by_size * faint2 / (size * c.length);

  const double by_trace = 0.5 * by_tangent_mobility;
  by_normal_mobility -= by_trace;
  const double by_inverse_length = -by_length * square(c.length);
  for (std::size_t b = c.plane() ? 1 : 0; b < 2; ++b) {
    const ContactFlight& own = *flight[b];
    ContactFlight& to = *by_flight[b];
    const Mat3<double>& inertia = own.inverse_inertia;
    const double sign = b == 1 ? 1 : -1;
    const Vec3<double>& r = c.arm[b];
    Vec3<double> by_arm = by.arm[b];

    to.velocity += (sign * c.moment.late) * by_relative;
    to.mean_velocity += sign * (by_mean + (1 - c.moment.late) * by_relative);
    by.share += 2 * sign * dot(own.velocity - own.mean_velocity, by_relative);
    const Vec3<double> by_turning = sign * (by_relative + by_mean);
    to.spin += cross(r, by_turning) + (sign * by_twist) * n;
    by_arm += cross(by_turning, own.spin);
    by_n += (sign * by_twist) * own.spin;

    const Vec3<double> lever = cross(r, n), by_lever = (2 * by_normal_mobility) * (inertia * lever);
    by_arm += cross(n, by_lever);
    by_n += cross(by_lever, r);
    to.inverse_inertia += outer(by_normal_mobility * lever, lever);

    const double trace = inertia.x.x + inertia.y.y + inertia.z.z, r2 = squared_norm(r);
    by_arm += (2 * by_trace) * (trace * r - inertia * r);
    to.inverse_inertia += outer(-by_trace * r, r);
    to.inverse_inertia.x.x += by_trace * r2;
    to.inverse_inertia.y.y += by_trace * r2;
    to.inverse_inertia.z.z += by_trace * r2;

    by_n += (2 * by.twist_mobility) * (inertia * n);
    to.inverse_inertia += outer(by.twist_mobility * n, n);

    by_arm -= (by_inverse_length / (norm(r) * r2)) * r;

    by.at.point += by_arm;
    add_position_gradient(own, c.moment, scales.frame_time, -by_arm, to, by.share);
  }
}

}  // namespace detail
}  // namespace rbres::RBRES_ABI
