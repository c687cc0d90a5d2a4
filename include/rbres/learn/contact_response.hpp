#pragma once

#include <rbres/learn/contact_features.hpp>

#include <span>

/// @file
/// How the contacts of a frame feel one another, and their own bodies' shapes: each is pushed along its
/// normal as if it were alone, and all see what the pushes together change of their velocities.
namespace rbres::RBRES_ABI::detail {

/// What all trial pushes do to a body. With doubles this is also the layout of a derivative.
struct BodyResponse {
  Vec3<double> impulse, moment;             ///< sums, N s and N m s
  Vec3<double> velocity, angular_velocity;  ///< what they change, world frame, m/s and rad/s
};

/// The speed that a trial push makes up for, m/s: that of an impact's approach, or that which ends the
/// overlap in which the free flight ends.
struct TrialSpeed {
  double value, by_speed, by_gap;
  TrialSpeed(const Contact& c, const ContactScales& scales) {
    const bool impact = scales.moment == ContactMoment::impact;
    const double x = impact ? -c.normal_speed : -c.gap_after / scales.frame_time;
    const double size = std::sqrt(x * x + square(scales.slip()));
    value = 0.5 * (x + size);  // never quite 0, and smooth
    const double slope = 0.5 * (1 + x / size);
    by_speed = impact ? -slope : 0;
    by_gap = impact ? 0 : -slope / scales.frame_time;
  }
};

/// What an impulse along y changes of the velocity of a contact's point along x, 1/kg.
inline double mobility_between(const Contact& c, const FlightPair<const ContactFlight>& flight,
                               const Vec3<double>& x, const Vec3<double>& y) {
  double sum = 0;
  for (std::size_t b = c.plane() ? 1 : 0; b < 2; ++b)
    sum += flight[b]->inverse_mass * dot(x, y) +
           dot(cross(c.arm[b], x), flight[b]->inverse_inertia * cross(c.arm[b], y));
  return sum;
}

/// What the pushes change of the relative velocity of a contact's point, m/s.
inline Vec3<double> velocity_gained(const Contact& c, const FlightPair<const BodyResponse>& body) {
  Vec3<double> gained;
  for (std::size_t b = c.plane() ? 1 : 0; b < 2; ++b)
    gained += (b == 1 ? 1.0 : -1.0) * (body[b]->velocity + cross(body[b]->angular_velocity, c.arm[b]));
  return gained;
}

/// Fills in what contacts know of the pushes: of those of one scene, whose bodies are `flights` and `bodies`
/// from `first` on.
inline void measure_responses(std::span<Contact> contacts, std::span<const ContactFlight> flights,
                              std::size_t first, const ContactScales& scales,
                              std::span<BodyResponse> bodies) {
  for (Contact& c : contacts) {
    c.push = c.presence * TrialSpeed(c, scales).value / c.normal_mobility;
    const auto sums = pair_of(c, bodies);
    for (std::size_t b = c.plane() ? 1 : 0; b < 2; ++b) {
      const Vec3<double> impulse = (b == 1 ? c.push : -c.push) * c.at.normal;
      sums[b]->impulse += impulse;
      sums[b]->moment += cross(c.arm[b], impulse);
    }
  }
  for (std::size_t i = first; i < bodies.size(); ++i) {
    bodies[i].velocity = flights[i].inverse_mass * bodies[i].impulse;
    bodies[i].angular_velocity = flights[i].inverse_inertia * bodies[i].moment;
  }
  const std::span<const BodyResponse> responses(bodies);
  for (Contact& c : contacts) {
    const Vec3<double> gained = velocity_gained(c, pair_of(c, responses));
    c.response = dot(c.at.normal, gained);
    const Vec3<double> swerve = gained - c.response * c.at.normal;
    c.swerve = std::sqrt(squared_norm(swerve) + square(scales.slip()));
    c.side = (1 / c.swerve) * swerve;
    const auto flight = pair_of(c, flights);
    c.along_tangent = mobility_between(c, flight, c.tangent, c.tangent);
    c.across = mobility_between(c, flight, c.tangent, c.side);
    c.along_side = mobility_between(c, flight, c.side, c.side);
  }
}

/// The way back through mobility_between(), given the derivative by it.
inline void add_mobility_gradient(const Contact& c, const FlightPair<const ContactFlight>& flight,
                                  const Vec3<double>& x, const Vec3<double>& y, double by_mobility,
                                  Vec3<double>& by_x, Vec3<double>& by_y, ContactGradient& by,
                                  const FlightPair<ContactFlight>& by_flight) {
  for (std::size_t b = c.plane() ? 1 : 0; b < 2; ++b) {
    const Vec3<double>& r = c.arm[b];
    const Mat3<double>& inertia = flight[b]->inverse_inertia;
    const Vec3<double> rx = cross(r, x), ry = cross(r, y), wx = inertia * rx, wy = inertia * ry;
    const double m = flight[b]->inverse_mass;
    by_x += by_mobility * (m * y + cross(wy, r));
    by_y += by_mobility * (m * x + cross(wx, r));
    by.arm[b] += by_mobility * (cross(x, wy) + cross(y, wx));
    by_flight[b]->inverse_inertia += outer(by_mobility * rx, ry);
  }
}

/// The way back from what a contact knows of the pushes, by.response, ..., to what they do to its bodies.
inline void add_response_gradient(const Contact& c, const FlightPair<const ContactFlight>& flight,
                                  const FlightPair<const BodyResponse>& body, ContactGradient& by,
                                  const FlightPair<ContactFlight>& by_flight,
                                  const FlightPair<BodyResponse>& by_body) {
  const Vec3<double>& n = c.at.normal;
  Vec3<double> by_side = by.side;
  add_mobility_gradient(c, flight, c.tangent, c.tangent, by.along_tangent, by.tangent, by.tangent, by,
                        by_flight);
  add_mobility_gradient(c, flight, c.tangent, c.side, by.across, by.tangent, by_side, by, by_flight);
  add_mobility_gradient(c, flight, c.side, c.side, by.along_side, by_side, by_side, by, by_flight);
  // side = swerve / size, size = sqrt(|swerve|^2 + ...)
  const Vec3<double> by_swerve =
      (1 / c.swerve) * by_side + (by.swerve - dot(c.side, by_side) / c.swerve) * c.side;
  const Vec3<double> gained = velocity_gained(c, body);
  const double by_response = by.response - dot(n, by_swerve);
  by.at.normal += by_response * gained - c.response * by_swerve;
  const Vec3<double> by_gained = by_swerve + by_response * n;
  for (std::size_t b = c.plane() ? 1 : 0; b < 2; ++b) {
    const double sign = b == 1 ? 1 : -1;
    by_body[b]->velocity += sign * by_gained;
    by_body[b]->angular_velocity += sign * cross(c.arm[b], by_gained);
    by.arm[b] += sign * cross(by_gained, body[b]->angular_velocity);
  }
}

/// The way back through a body's response: completes its derivative.
inline void complete_response_gradient(const ContactFlight& flight, const BodyResponse& body,
                                       BodyResponse& by, ContactFlight& by_flight) {
  by.impulse = flight.inverse_mass * by.velocity;
  by.moment = flight.inverse_inertia * by.angular_velocity;
  by_flight.inverse_inertia += outer(by.angular_velocity, body.moment);
}

/// The way back through a contact's push.
inline void add_push_gradient(const Contact& c, const ContactScales& scales,
                              const FlightPair<const BodyResponse>& by_body, ContactGradient& by) {
  const Vec3<double>& n = c.at.normal;
  double by_push = 0;
  for (std::size_t b = c.plane() ? 1 : 0; b < 2; ++b) {
    const double sign = b == 1 ? 1 : -1;
    const Vec3<double> by_impulse = by_body[b]->impulse + cross(by_body[b]->moment, c.arm[b]);
    by_push += sign * dot(n, by_impulse);
    by.at.normal += (sign * c.push) * by_impulse;
    by.arm[b] += (sign * c.push) * cross(n, by_body[b]->moment);
  }
  const TrialSpeed speed(c, scales);
  by.presence += speed.value / c.normal_mobility * by_push;
  by.gap_after += c.presence * speed.by_gap / c.normal_mobility * by_push;
  by.normal_speed += c.presence * speed.by_speed / c.normal_mobility * by_push;
  by.normal_mobility -= c.push / c.normal_mobility * by_push;
}

}  // namespace rbres::RBRES_ABI::detail
