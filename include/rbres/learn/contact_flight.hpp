#pragma once

#include <rbres/body/body.hpp>
#include <rbres/body/state.hpp>
#include <rbres/core/lie.hpp>
#include <unsupported/Eigen/AutoDiff>

namespace rbres::RBRES_ABI::detail {

/// Numbers with their derivatives by N inputs.
template <int N>
using Dual = Eigen::AutoDiffScalar<Eigen::Matrix<double, N, 1>>;
template <int N>
Vec3<Dual<N>> constant_vector(const Vec3<double>& v) {
  return {Dual<N>(v.x), Dual<N>(v.y), Dual<N>(v.z)};
}
template <int N>
Vec3<Dual<N>> dual_vector(const Vec3<double>& v, int first) {
  return {Dual<N>(v.x, N, first), Dual<N>(v.y, N, first + 1), Dual<N>(v.z, N, first + 2)};
}
template <int N>
Quat<Dual<N>> dual_quaternion(const Quat<double>& q, int first) {
  return {Dual<N>(q.x, N, first), Dual<N>(q.y, N, first + 1), Dual<N>(q.z, N, first + 2),
          Dual<N>(q.w, N, first + 3)};
}

/// The derivative by all inputs, from those by a quaternion and a vector.
template <int N>
Eigen::Matrix<double, N, 1> pull_back(const Vec3<double>& by, const Vec3<Dual<N>>& v) {
  return by.x * v.x.derivatives() + by.y * v.y.derivatives() + by.z * v.z.derivatives();
}
template <int N>
Eigen::Matrix<double, N, 1> pull_back(const Quat<double>& by, const Quat<Dual<N>>& q) {
  return by.x * q.x.derivatives() + by.y * q.y.derivatives() + by.z * q.z.derivatives() +
         by.w * q.w.derivatives();
}

inline Quat<double> operator+(const Quat<double>& a, const Quat<double>& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z, a.w + b.w};
}
inline Quat<double> operator*(double s, const Quat<double>& q) {
  return {s * q.x, s * q.y, s * q.z, s * q.w};
}
inline Mat3<double>& operator+=(Mat3<double>& a, const Mat3<double>& b) {
  a.x += b.x, a.y += b.y, a.z += b.z;
  return a;
}
/// a b^T
inline Mat3<double> outer(const Vec3<double>& a, const Vec3<double>& b) {
  return {b.x * a, b.y * a, b.z * a};
}

/// The way back through rotate(q, v): adds to the derivatives by q and v.
inline void add_rotation_gradient(const Quat<double>& q, const Vec3<double>& v,
                                  const Vec3<double>& by_rotated, Quat<double>& by_q, Vec3<double>& by_v) {
  // rotate(q, v) = v + 2 w u x v + 2 u x (u x v), u the imaginary part
  const Vec3<double> u = q.imaginary(), uv = cross(u, v);
  const Vec3<double> by_u =
      2 * (q.w * cross(v, by_rotated) + cross(uv, by_rotated) + cross(v, cross(by_rotated, u)));
  by_q = by_q + Quat<double>{by_u.x, by_u.y, by_u.z, 2 * dot(uv, by_rotated)};
  by_v += rotate_back(q, by_rotated);
}

/// What contacts have to know of a body's free flight through a frame: where it is halfway, taken as the mean
/// of its states before and after, and how it moves afterwards. World frame. With doubles this is also the
/// layout of a derivative by these numbers.
struct ContactFlight {
  Vec3<double> middle;           ///< position halfway, m
  Quat<double> turned;           ///< orientation halfway
  Vec3<double> mean_velocity;    ///< over the frame, m/s
  Vec3<double> end;              ///< position at its end, or where another law has put the body since, m
  Vec3<double> velocity;         ///< at its end, m/s
  Vec3<double> spin;             ///< angular velocity at its end, rad/s
  Mat3<double> inverse_inertia;  ///< halfway, 1/(kg m^2)
  double inverse_mass;           ///< 1/kg; the same in every state
};

/// From the states where the free flight begins and ends, `time` (s) apart.
template <class Shape>
ContactFlight contact_flight(const Body<double, Shape>& body, const RigidState<double>& from,
                             const RigidState<double>& to, double time) {
  ContactFlight f;
  f.middle = 0.5 * (from.position + to.position);
  f.turned = normalized(from.orientation + to.orientation);
  f.mean_velocity = (1 / time) * (to.position - from.position);
  f.end = to.position;
  f.velocity = to.velocity;
  f.spin = rotate(to.orientation, to.angular_velocity);
  f.inverse_inertia = rotated_diagonal(rotation_matrix(f.turned), body.inverse_inertia());
  f.inverse_mass = body.inverse_mass();
  return f;
}

/// The way back: adds to the derivatives by the two states, given those by the flight.
template <class Shape>
void add_flight_gradient(const Body<double, Shape>& body, const RigidState<double>& from,
                         const RigidState<double>& to, double time, const ContactFlight& by_flight,
                         RigidState<double>& by_from, RigidState<double>& by_to) {
  by_from.position += 0.5 * by_flight.middle - (1 / time) * by_flight.mean_velocity;
  by_to.position += 0.5 * by_flight.middle + (1 / time) * by_flight.mean_velocity + by_flight.end;
  by_to.velocity += by_flight.velocity;
  add_rotation_gradient(to.orientation, to.angular_velocity, by_flight.spin, by_to.orientation,
                        by_to.angular_velocity);
  using D = Dual<4>;
  const Quat<double> sum = from.orientation + to.orientation;
  const Quat<D> turned = normalized(dual_quaternion<4>(sum, 0));
  const Vec3<double>& inertia = body.inverse_inertia();
  Eigen::Vector4d by = pull_back<4>(by_flight.turned, turned);
  if (!(inertia.x == inertia.y && inertia.y == inertia.z)) {
    const Mat3<D> world = rotated_diagonal(rotation_matrix(turned), constant_vector<4>(inertia));
    by += pull_back<4>(by_flight.inverse_inertia.x, world.x);
    by += pull_back<4>(by_flight.inverse_inertia.y, world.y);
    by += pull_back<4>(by_flight.inverse_inertia.z, world.z);
  }
  const Quat<double> by_sum{by[0], by[1], by[2], by[3]};
  by_from.orientation = by_from.orientation + by_sum;
  by_to.orientation = by_to.orientation + by_sum;
}

/// The flight of a body that impulses have brought to `to`, as if it had always moved as it does after them.
/// `gained` is what forces add to its velocity from the frame's mean to its end, m/s.
template <class Shape>
ContactFlight flight_after(const Body<double, Shape>& body, const RigidState<double>& to,
                           const Vec3<double>& gained, double time) {
  ContactFlight f;
  f.end = to.position;
  f.velocity = to.velocity;
  f.mean_velocity = to.velocity - gained;
  f.middle = to.position - (0.5 * time) * f.mean_velocity;
  f.spin = rotate(to.orientation, to.angular_velocity);
  f.turned = quaternion_exp((-0.5 * time) * f.spin) * to.orientation;
  f.inverse_inertia = rotated_diagonal(rotation_matrix(f.turned), body.inverse_inertia());
  f.inverse_mass = body.inverse_mass();
  return f;
}

/// The way back: adds to the derivatives by the state and by what is gained.
template <class Shape>
void add_flight_after_gradient(const Body<double, Shape>& body, const RigidState<double>& to, double time,
                               const ContactFlight& by_flight, RigidState<double>& by_to,
                               Vec3<double>& by_gained) {
  const Vec3<double> by_mean = by_flight.mean_velocity - (0.5 * time) * by_flight.middle;
  by_to.position += by_flight.middle + by_flight.end;
  by_to.velocity += by_flight.velocity + by_mean;
  by_gained -= by_mean;
  using D = Dual<7>;
  const Quat<D> orientation = dual_quaternion<7>(to.orientation, 0);
  const Vec3<D> spin = rotate(orientation, dual_vector<7>(to.angular_velocity, 4));
  const Quat<D> turned = quaternion_exp(D(-0.5 * time) * spin) * orientation;
  const Mat3<D> world = rotated_diagonal(rotation_matrix(turned), constant_vector<7>(body.inverse_inertia()));
  Eigen::Matrix<double, 7, 1> by =
      pull_back<7>(by_flight.spin, spin) + pull_back<7>(by_flight.turned, turned);
  by += pull_back<7>(by_flight.inverse_inertia.x, world.x);
  by += pull_back<7>(by_flight.inverse_inertia.y, world.y);
  by += pull_back<7>(by_flight.inverse_inertia.z, world.z);
  by_to.orientation = by_to.orientation + Quat<double>{by[0], by[1], by[2], by[3]};
  by_to.angular_velocity += Vec3<double>{by[4], by[5], by[6]};
}

}  // namespace rbres::RBRES_ABI::detail
