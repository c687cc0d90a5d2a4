#pragma once

#include <limits>
#include <rbres/io/metadata.hpp>
#include <rbres/io/model.hpp>
#include <rbres/predict/predictor.hpp>

namespace rbres::RBRES_ABI {

/// A predictor's file is its network's (see ModelFormat<Network>), with the rest in the metadata: the
/// normalisation
/// ("input_mean", "input_deviation", "output_mean", "output_deviation"), what the network says ("target"),
/// the "horizon" (s), and the contact-free flow ("flow_bodies": for each body its shape as 0 ball, 1 box, 2
/// capsule, three lengths (m), mass (kg), three principal moments (kg m^2), zeros for a kinematic one;
/// "flow_forces": gravity (m/s^2), then density, drag and rotational drag of the fluid, then both damping
/// rates). PyTorch still loads the network. Shapes must stand along the principal axes.
template <class Net, int N>
struct ModelFormat<Predictor<Net, N>> {
  /// The predictor's type.
  using Model = Predictor<Net, N>;

  /// Refuses what read() would not take.
  static void check(const Model& p) {
    detail::require_within("horizon of a saved predictor", Eigen::Matrix<double, 1, 1>(p.horizon), horizons);
    detail::require_within("input deviation of a saved predictor", p.input.deviation, deviations);
    detail::require_within("output deviation of a saved predictor", p.output.deviation, deviations);
    detail::require_within("input mean of a saved predictor", p.input.mean, finite);
    detail::require_within("output mean of a saved predictor", p.output.mean, finite);
    const Forces forces = forces_of(p);
    detail::require_within("gravity of a saved predictor", forces.head<3>(), finite);
    detail::require_within("fluid and damping of a saved predictor", forces.tail<5>(), {0, finite.most});
    for (int b = 0; b < N; ++b)
      if (!(p.flow.system[b].shape_rotation() == Quat<double>{}))
        detail::refuse(detail::text("body ", b, " of a saved predictor"), "a shape along the principal axes",
                       "a turned one");
  }

  /// The predictor must stay until the file is written. Throws Error where check() does.
  static void write(SafetensorsWriter& file, const Model& p) {
    check(p);
    ModelFormat<Net>::write(file, p.network);
    const Eigen::Matrix<double, 1, 1> horizon(p.horizon);
    file.metadata["input_mean"] = detail::numbers_to_text(p.input.mean);
    file.metadata["input_deviation"] = detail::numbers_to_text(p.input.deviation);
    file.metadata["output_mean"] = detail::numbers_to_text(p.output.mean);
    file.metadata["output_deviation"] = detail::numbers_to_text(p.output.deviation);
    file.metadata["target"] = p.target == Target::residual ? "residual" : "state";
    file.metadata["horizon"] = detail::numbers_to_text(horizon);
    Bodies bodies;
    for (int b = 0; b < N; ++b) {
      const auto& body = p.flow.system[b];
      bodies.col(b) << static_cast<double>(body.shape().index()), lengths(body.shape()), body.mass(),
          body.inertia().x, body.inertia().y, body.inertia().z;
    }
    file.metadata["flow_bodies"] = detail::numbers_to_text(bodies);
    file.metadata["flow_forces"] = detail::numbers_to_text(forces_of(p));
  }

  /// Throws Error where the file is of another predictor.
  static Model read(const SafetensorsReader& file) {
    Net network = ModelFormat<Net>::read(file);
    double bodies[std::size_t(N)][8], f[8], horizon;
    detail::read_numbers<double>(file, "flow_bodies", {bodies[0], 8 * std::size_t(N)});
    detail::read_numbers<double>(file, "flow_forces", f);
    detail::read_numbers<double>(file, "horizon", {&horizon, 1}, horizons);
    for (int i = 3; i < 8; ++i)
      if (f[i] < 0)
        detail::refuse(file.path().string() + ": flow_forces", "a fluid and damping of 0 or more", f[i]);
    const auto system = [&]<std::size_t... I>(std::index_sequence<I...>) {
      return typename FreeFlow<N>::System({body(file, bodies[I])...});
    }
    (std::make_index_sequence<std::size_t(N)>{});
    Model p{std::move(network), {}, {}, {system, {{f[0], f[1], f[2]}}, {f[3], f[4], f[5]}, {f[6], f[7]}}};
    detail::numbers_from_metadata(file, "input_mean", p.input.mean);
    detail::numbers_from_metadata(file, "input_deviation", p.input.deviation, deviations);
    detail::numbers_from_metadata(file, "output_mean", p.output.mean);
    detail::numbers_from_metadata(file, "output_deviation", p.output.deviation, deviations);
    p.horizon = horizon;
    const std::string& target = entry(file, "target");
    if (target != "residual" && target != "state")
      detail::refuse(file.path().string() + ": target", "'residual' or 'state'", target);
    p.target = target == "residual" ? Target::residual : Target::state;
    return p;
  }

 private:
  static constexpr detail::Bounds horizons{FreeFlow<N>::shortest, FreeFlow<N>::longest},
      deviations{1e-30, 1e30},
      finite{-std::numeric_limits<double>::max(), std::numeric_limits<double>::max()};
  using Bodies = Eigen::Matrix<double, 8, N>;
  using Forces = Eigen::Matrix<double, 8, 1>;

  static Forces forces_of(const Model& p) {
    Forces forces;
    forces << p.flow.gravity.g.x, p.flow.gravity.g.y, p.flow.gravity.g.z, p.flow.friction.density,
        p.flow.friction.drag, p.flow.friction.rotational_drag, p.flow.damping.linear, p.flow.damping.angular;
    return forces;
  }

  static Eigen::Vector3d lengths(const AnyShape<double>& shape) {
    if (const auto* ball = std::get_if<Sphere<double>>(&shape)) return {ball->radius, 0, 0};
    if (const auto* box = std::get_if<Box<double>>(&shape)) return box->half;
    const auto& capsule = std::get<Capsule<double>>(shape);
    return {capsule.radius, capsule.half_length, 0};
  }
  static Body<double> body(const SafetensorsReader& file, const double (&n)[8]) {
    const auto of = [&](const AnyShape<double>& shape) -> Body<double> {
      if (n[4] == 0 && n[5] == 0 && n[6] == 0 && n[7] == 0) return Body<double>::kinematic(shape);
      return {shape, n[4], Vec3<double>{n[5], n[6], n[7]}};
    };
    if (n[0] == 0) return of(Sphere<double>{n[1]});
    if (n[0] == 1) return of(Box<double>{n[1], n[2], n[3]});
    if (n[0] == 2) return of(Capsule<double>{n[1], n[2]});
    detail::refuse(file.path().string() + ": flow_bodies: shape", "0, 1 or 2", n[0]);
  }
  static const std::string& entry(const SafetensorsReader& file, const char* key) {
    const auto found = file.metadata().find(key);
    if (found == file.metadata().end())
      detail::refuse(file.path().string(), detail::text("metadata '", key, "'"), "none");
    return found->second;
  }
};

}  // namespace rbres::RBRES_ABI
