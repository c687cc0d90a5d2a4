#pragma once

#include <concepts>
#include <cstddef>
#include <string>
#include <tuple>
#include <vector>

#include <Eigen/Core>

#include <rbres/io/model.hpp>

namespace rbres::RBRES_ABI {

/// The first inputs and outputs of a network, whose other inputs are 0: what a program saves that knows its
/// sizes only when it runs. The file is that of the Network of these sizes, which loads it. The network
/// begins and ends with a Linear, and must stay until the file is written.
template <class Net>
struct CroppedNetwork {
  /// Of which the file has a part.
  const Net& network;
  /// So many, the first ones.
  /// @{
  int inputs, outputs;
  /// @}
};

namespace detail {

template <class Layer>
inline constexpr bool is_linear = false;
template <int In, int Out>
inline constexpr bool is_linear<Linear<In, Out>> = true;

}  // namespace detail

/// The file of a network of the cropped sizes.
template <std::floating_point T, class... Layers>
struct ModelFormat<CroppedNetwork<Network<T, Sequential<Layers...>>>> {
  /// The whole network.
  using Model = Network<T, Sequential<Layers...>>;
  static_assert(detail::is_linear<std::tuple_element_t<0, std::tuple<Layers...>>> &&
                    detail::is_linear<std::tuple_element_t<sizeof...(Layers) - 1, std::tuple<Layers...>>> &&
                    sizeof...(Layers) > 1,
                "CroppedNetwork: of a network that begins and ends with a Linear");

  /// Throws Error where the network has not so many inputs or outputs.
  static void write(SafetensorsWriter& file, const CroppedNetwork<Model>& model) {
    const auto check = [](const char* what, int found, int most) {
      if (found < 1 || found > most)
        detail::refuse(detail::text("CroppedNetwork::", what), detail::text("1 to ", most), found);
    };
    check("inputs", model.inputs, Model::input_size);
    check("outputs", model.outputs, Model::output_size);

    const T* numbers = model.network.parameters().data();
    const std::vector<ParameterTensor> tensors = Model::tensors();
    for (std::size_t i = 0; i < tensors.size(); ++i) {
      ParameterTensor part = tensors[i];
      if (i == 0) part.columns = model.inputs;
      if (i + 2 >= tensors.size()) part.rows = model.outputs;
      file.add<T>(part.name, detail::torch_shape(part), [numbers, part, whole = tensors[i]](T* to) {
        for (int row = 0; row < part.rows; ++row)
          for (int column = 0; column < part.columns; ++column) *to++ = numbers[whole.index(row, column)];
      });
    }

    constexpr auto how = detail::LayerText::shortened;
    std::vector<std::string> layers{detail::LayerName<Layers>::text(how)...};
    layers.front() = detail::text("rbres::Linear<", model.inputs, ", ", tensors.front().rows, ">");
    layers.back() =
        detail::text("rbres::Linear<", tensors[tensors.size() - 2].columns, ", ", model.outputs, ">");
    file.metadata = network_metadata<Model>();
    file.metadata["architecture"] = detail::layer_list("rbres::Sequential", layers, how);
    detail::add_probes(file, model.network, model.inputs, model.outputs);
  }
};

}  // namespace rbres::RBRES_ABI
