#pragma once

#include <rbres/io/export_header.hpp>
#include <rbres/io/predictor.hpp>
#include <rbres/predict/predictor.hpp>

#include <array>
#include <concepts>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace rbres::RBRES_ABI {

namespace detail {

/// A number as C++ spells it, without losing a bit.
inline std::string exact_literal(double number) {
  std::ostringstream out;
  out.imbue(std::locale::classic());
  out << std::hexfloat << number;
  return out.str();
}
inline std::string exact_vector(const Vec3<double>& v) {
  return text("{", exact_literal(v.x), ", ", exact_literal(v.y), ", ", exact_literal(v.z), "}");
}

/// The expression that makes a body of a predictor's flow again.
inline std::string body_text(const Body<double>& body) {
  struct {
    std::string operator()(const Sphere<double>& s) const {
      return text("Sphere<double>(", exact_literal(s.radius));
    }
    std::string operator()(const Box<double>& b) const {
      return text("Box<double>(rbres::Vec3<double>", exact_vector(b.half));
    }
    std::string operator()(const Capsule<double>& c) const {
      return text("Capsule<double>(", exact_literal(c.radius), ", ", exact_literal(c.half_length));
    }
  } shape_text;
  const std::string shape = text("rbres::", std::visit(shape_text, body.shape()), ")");
  if (body.is_kinematic()) return text("rbres::Body<double>::kinematic(", shape, ")");
  return text("rbres::Body<double>(", shape, ", ", exact_literal(body.mass()), ", rbres::Vec3<double>",
              exact_vector(body.inertia()), ")");
}

}  // namespace detail

/// Writes a C++ header that holds the predictor, network, normalisers and contact-free flow, so that a
/// program without files, and without a heap, runs it with rbres and Eigen alone:
///
///     #include "model.hpp"
///     const NAME::Predictor predictor = NAME::predictor();
///     state = predictor.predict(state, wrench);
///
/// Numbers lose no bit. Atomic; see AtomicFile for the errors. Error too where save() would refuse the
/// predictor, or `name` is no name for a namespace of one's own.
template <std::floating_point T, class Layers, class W, int N>
void export_header(const Predictor<Network<T, Layers, W>, N>& p, const std::filesystem::path& path,
                   std::string_view name = "rbres_model") {
  detail::check_namespace_name(name);
  ModelFormat<Predictor<Network<T, Layers, W>, N>>::check(p);
  const std::string constants = detail::constant_network_text(p.network, path);
  const auto numbers = [&](const char* what, const auto& vector) {
    return detail::array_text<T>(what, detail::text(path.string(), ": ", what),
                                 std::span<const T>(vector.data(), static_cast<std::size_t>(vector.size())));
  };
  const auto& flow = p.flow;
  const std::array<double, 6> forces{p.horizon,           flow.friction.density,
                                     flow.friction.drag,  flow.friction.rotational_drag,
                                     flow.damping.linear, flow.damping.angular};
  std::string bodies;
  for (int b = 0; b < N; ++b)
    bodies += detail::text(b == 0 ? "" : ",\n      ", detail::body_text(flow.system[b]));
  const auto number = [&](std::size_t i) { return detail::exact_literal(forces[i]); };
  const std::string text = detail::text(
      "// Written by rbres::export_header.\n#pragma once\n\n#include <rbres/nn/constant_network.hpp>\n"
      "#include <rbres/predict/predictor.hpp>\n\nnamespace ",
      name, "::RBRES_ABI {\n\n", constants, "using Predictor = rbres::Predictor<Network, ", N, ">;\n\n",
      numbers("input_mean", p.input.mean), numbers("input_deviation", p.input.deviation),
      numbers("output_mean", p.output.mean), numbers("output_deviation", p.output.deviation), R"(
inline Predictor predictor() {
  Predictor p{Network(), {}, {}, {rbres::FreeFlow<)",
      N, ">::System({\n      ", bodies, "}),\n      {", detail::exact_vector(flow.gravity.g), "}, {",
      number(1), ", ", number(2), ", ", number(3), "}, {", number(4), ", ", number(5),
      "}}, rbres::Target::", p.target == Target::residual ? "residual" : "state", ", ", number(0), "};\n",
      R"(  std::copy(std::begin(input_mean), std::end(input_mean), p.input.mean.data());
  std::copy(std::begin(input_deviation), std::end(input_deviation), p.input.deviation.data());
  std::copy(std::begin(output_mean), std::end(output_mean), p.output.mean.data());
  std::copy(std::begin(output_deviation), std::end(output_deviation), p.output.deviation.data());
  return p;
}

}  // namespace )",
      name, "\n");
  AtomicFile file(path);
  file.write(text.data(), text.size());
  file.commit();
}

}  // namespace rbres::RBRES_ABI
