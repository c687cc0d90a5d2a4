#pragma once

#include <rbres/io/export_header.hpp>
#include <rbres/learn/hybrid_law.hpp>

namespace rbres::RBRES_ABI {

namespace detail {

template <class Law>
void export_law(const Law& law, const std::filesystem::path& path, std::string_view name) {
  using T = typename Law::Scalar;
  using Net = typename Law::Network;
  check_namespace_name(name);
  check_weights(law.network, path);
  constexpr std::size_t features = static_cast<std::size_t>(Net::inputs);
  const std::array<double, 4> numbers{law.scales.frame_time, law.scales.speed, law.scales.margin, law.weight};
  AtomicFile file(path);
  const std::string all = text(
      "// Written by rbres::export_header.\n#pragma once\n\n#include <rbres/learn/hybrid_law.hpp>\n\n"
      "namespace ",
      name, "::RBRES_ABI {\n\nusing Law = rbres::", Law::corrects ? "HybridLaw<" : "ContactLaw<", Net::width,
      ", ", Net::rounds, ", ", scalar_name<T>, weight_argument<T, typename Net::Weight>, ";\n\n",
      weights_text(law.network.parameters(), path),
      array_text<T>("input_mean", path.string(), {law.input.mean.data(), features}),
      array_text<T>("input_deviation", path.string(), {law.input.deviation.data(), features}),
      "// Frame time (s), speed (m/s), margin (m), strength of a correction.\n",
      array_text<double>("scales", path.string(), numbers), "\ninline Law law() {\n  Law law;\n",
      "  std::copy(std::begin(weights), std::end(weights), law.network.parameters().begin());\n"
      "  for (int i = 0; i < Law::Network::inputs; ++i) {\n    law.input.mean[i] = input_mean[i];\n"
      "    law.input.deviation[i] = input_deviation[i];\n  }\n"
      "  law.scales = {.frame_time = scales[0], .speed = scales[1], .margin = scales[2], .moment = "
      "rbres::ContactMoment::",
      rbres::name(law.scales.moment), "};\n", Law::corrects ? "  law.weight = scales[3];\n" : "",
      "  return law;\n}\n\n}  // namespace ", name, "\n");
  file.write(all.data(), all.size());
  file.commit();
}

}  // namespace detail

/// Writes a C++ header that holds a learned contact law, so that a program without files simulates by it with
/// rbres and Eigen alone, to the same bits:
///
///     #include "law.hpp"
///     const NAME::Law law = NAME::law();
///     simulate(system, state, Gravity{}, Rk4{}, law, {.step = law.scales.frame_time, .duration = 2});
///
/// Errors as of export_header() of a network.
template <int Width, int Rounds, std::floating_point T, class W>
void export_header(const ContactLaw<Width, Rounds, T, W>& law, const std::filesystem::path& path,
                   std::string_view name = "rbres_law") {
  detail::export_law(law, path, name);
}
/// The same with NAME::Law a HybridLaw.
template <int Width, int Rounds, std::floating_point T, class W>
void export_header(const HybridLaw<Width, Rounds, T, W>& law, const std::filesystem::path& path,
                   std::string_view name = "rbres_law") {
  detail::export_law(law, path, name);
}

}  // namespace rbres::RBRES_ABI
