#pragma once

#include <string>
#include <string_view>
#include <tuple>
#include <vector>

#include <rbres/core/error.hpp>
#include <rbres/nn/layers.hpp>

namespace rbres::RBRES_ABI::detail {

/// How a list of layers is written: `spelled` as the C++ type, else with runs of equal layers as "10 x
/// Residual<...>".
enum class LayerText { spelled, shortened };

/// The name of a layer's type in C++. A user's own layer gives it as `static constexpr std::string_view
/// name`.
template <class Layer>
struct LayerName {
  static std::string text(LayerText) { return std::string(Layer::name); }
};
template <>
struct LayerName<Relu> {
  static std::string text(LayerText) { return "rbres::Relu"; }
};
template <>
struct LayerName<Tanh> {
  static std::string text(LayerText) { return "rbres::Tanh"; }
};
template <>
struct LayerName<Silu> {
  static std::string text(LayerText) { return "rbres::Silu"; }
};
template <>
struct LayerName<Dropout> {
  static std::string text(LayerText) { return "rbres::Dropout"; }
};
template <int Percent>
struct LayerName<FixedDropout<Percent>> {
  static std::string text(LayerText) { return detail::text("rbres::FixedDropout<", Percent, ">"); }
};
template <int Size>
struct LayerName<LayerNorm<Size>> {
  static std::string text(LayerText) { return detail::text("rbres::LayerNorm<", Size, ">"); }
};
template <int In, int Out>
struct LayerName<Linear<In, Out>> {
  static std::string text(LayerText) { return detail::text("rbres::Linear<", In, ", ", Out, ">"); }
};

[[gnu::cold]] inline std::string layer_list(std::string_view container,
                                            const std::vector<std::string>& layers, LayerText how) {
  std::string out(container);
  for (std::size_t i = 0, run = 1; i < layers.size(); i += run, run = 1) {
    if (how == LayerText::shortened)
      while (i + run < layers.size() && layers[i + run] == layers[i]) ++run;
    out += text(i == 0 ? "<" : ", ", run > 1 ? text(run, " x ") : "", layers[i]);
  }
  return out + ">";
}
template <class... Layers>
struct LayerName<Sequential<Layers...>> {
  static std::string text(LayerText how) {
    return layer_list("rbres::Sequential", {LayerName<Layers>::text(how)...}, how);
  }
};
template <class... Layers>
struct LayerName<Residual<Layers...>> {
  static std::string text(LayerText how) {
    return layer_list("rbres::Residual", {LayerName<Layers>::text(how)...}, how);
  }
};
/// Of networks that share a block of parameters.
template <class... Parts>
struct LayerName<std::tuple<Parts...>> {
  static std::string text(LayerText how) {
    return layer_list("std::tuple", {LayerName<Parts>::text(how)...}, how);
  }
};

}  // namespace rbres::RBRES_ABI::detail
