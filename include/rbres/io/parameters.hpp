#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include <Eigen/Core>

#include <rbres/core/error.hpp>
#include <rbres/io/architecture.hpp>
#include <rbres/io/safetensors.hpp>
#include <rbres/nn/network.hpp>

/// @file
/// What the files of networks and of training runs have in common.
namespace rbres::RBRES_ABI {

namespace detail {

/// "scalar", the type that a network computes in, and "weights" where they are kept in another type.
template <class Net>
Metadata number_metadata() {
  Metadata all{{"scalar", std::is_same_v<typename Net::Scalar, float> ? "float32" : "float64"}};
  if (!std::is_same_v<typename Net::Weight, typename Net::Scalar>) all["weights"] = "bfloat16";
  return all;
}

/// Whether the file's tensors are of numbers W.
template <class W>
bool keeps_parameters_as(const SafetensorsReader& file) {
  return !file.tensors().empty() && file.tensors().begin()->second.dtype == safetensors_dtype<W>();
}

}  // namespace detail

/// The metadata of every file with a network: its "architecture", as the C++ type with runs of equal layers
/// as "10 x ...", its "scalar", and "weights" where they are kept in another type.
template <class Net>
Metadata network_metadata() {
  using detail::LayerName, detail::LayerText;
  Metadata all = detail::number_metadata<Net>();
  all["architecture"] = LayerName<typename Net::Architecture>::text(LayerText::shortened);
  return all;
}

namespace detail {

/// [outputs, inputs] of a weight, [outputs] of a bias.
inline std::vector<Eigen::Index> torch_shape(const ParameterTensor& tensor) {
  if (tensor.is_bias) return {tensor.rows};
  return {tensor.rows, tensor.columns};
}

/// Adds a block of a network's layout (its parameters, or an optimiser's moments) as the tensors PREFIX +
/// name, of PyTorch's shapes. The block must stay until the file is written.
template <class Net, class Number>
void add_parameters(SafetensorsWriter& file, const std::string& prefix, const Number* block) {
  for (const ParameterTensor& tensor : Net::tensors())
    file.add<Number>(prefix + tensor.name, torch_shape(tensor), [block, tensor](Number* to) {
      for (int row = 0; row < tensor.rows; ++row)
        for (int column = 0; column < tensor.columns; ++column) *to++ = block[tensor.index(row, column)];
    });
}

/// Calls take(place in the block, number) for all that add_parameters() wrote, tensor by tensor. Error when a
/// tensor is missing or of another type or shape.
template <class Net, class Number = typename Net::Weight, class Take>
void each_parameter(const SafetensorsReader& file, const std::string& prefix, const Take& take) {
  for (const ParameterTensor& tensor : Net::tensors()) {
    std::vector<Number> numbers(static_cast<std::size_t>(tensor.rows) *
                                static_cast<std::size_t>(tensor.columns));
    file.read(prefix + tensor.name, torch_shape(tensor), numbers.data());
    const Number* from = numbers.data();
    for (int row = 0; row < tensor.rows; ++row)
      for (int column = 0; column < tensor.columns; ++column) take(tensor.index(row, column), *from++);
  }
}

/// Reads what add_parameters() wrote to a block of the network's layout.
template <class Net, class Number>
void read_parameters(const SafetensorsReader& file, const std::string& prefix, Number* block) {
  each_parameter<Net, Number>(file, prefix,
                              [block](std::size_t place, auto number) { block[place] = number; });
}

/// Adds metadata; Error that names the path when a key is taken.
inline void add_metadata(SafetensorsWriter& file, const Metadata& more, const std::filesystem::path& path) {
  for (const auto& entry : more)
    if (!file.metadata.insert(entry).second)
      refuse(path.string(), "metadata that leave the file's own keys alone", "'" + entry.first + "'");
}

}  // namespace detail
}  // namespace rbres::RBRES_ABI
