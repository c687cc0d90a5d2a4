#pragma once

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <filesystem>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include <rbres/core/error.hpp>
#include <rbres/core/philox.hpp>
#include <rbres/io/architecture.hpp>
#include <rbres/io/metadata.hpp>
#include <rbres/io/safetensors.hpp>
#include <rbres/nn/network.hpp>

namespace rbres {

/// How a type of model stands in a safetensors file: write() adds its tensors and metadata, read() gives the
/// model or throws Error. Specialise it for a type that holds a network and more, and write both into the one
/// file.
template <class Model>
struct ModelFormat;

/// Saves a model as a safetensors file, atomically (see AtomicFile), with the user's own metadata; the
/// model's own keys are taken (for a network "architecture", "scalar", "probe_inputs" and "probe_outputs").
template <class Model>
void save(const std::filesystem::path& path, const Model& model, const Metadata& metadata = {}) {
  SafetensorsWriter file;
  ModelFormat<Model>::write(file, model);
  for (const auto& entry : metadata)
    if (!file.metadata.insert(entry).second)
      detail::refuse(path.string(), "metadata that leave the model's own keys alone",
                     "'" + entry.first + "'");
  file.write(path);
}

/// Loads a model that save() wrote; for a network also one that PyTorch wrote. Every other file is an Error
/// that names the path and what is wrong.
template <class Model>
Model load(const std::filesystem::path& path) {
  return ModelFormat<Model>::read(SafetensorsReader(path));
}

/// A network's file is what `safetensors.torch.save_file(module.state_dict(), path)` writes for the
/// nn.Sequential of the same layers, and loads there: tensors "0.weight" [outputs, inputs] and "0.bias"
/// [outputs]. Its metadata say the architecture and the scalar type, and hold a few inputs with their
/// outputs, which are computed again at loading: they must agree within 2^13 epsilon of the largest output
/// (1e-3 in float, 2e-12 in double), which other processors and flags keep by far and wrong numbers do not. A
/// file without these metadata, as PyTorch writes it, must hold the network's tensors and no others.
template <std::floating_point T, class Layers>
struct ModelFormat<Network<T, Layers>> {
  using Model = Network<T, Layers>;

  /// The network must stay until the file is written.
  static void write(SafetensorsWriter& file, const Model& network) {
    for (const ParameterTensor& tensor : Model::tensors())
      file.add<T>(tensor.name, shape(tensor), [&network, tensor](T* to) {
        for (int row = 0; row < tensor.rows; ++row)
          for (int column = 0; column < tensor.columns; ++column)
            *to++ = network.parameters()[tensor.index(row, column)];
      });
    Inputs inputs;
    Random random(0);
    for (T& number : inputs.reshaped()) number = static_cast<T>(random.normal());
    const Outputs outputs = probe(network, inputs);
    detail::require_finite("the network's outputs", outputs.data(), static_cast<std::size_t>(outputs.size()));
    file.metadata["architecture"] = architecture();
    file.metadata["scalar"] = detail::scalar_name<T>;
    file.metadata["probe_inputs"] = detail::numbers_to_text(inputs);
    file.metadata["probe_outputs"] = detail::numbers_to_text(outputs);
  }

  static Model read(const SafetensorsReader& file) {
    const std::string path = file.path().string();
    const auto metadata = [&](const char* key) {
      const auto found = file.metadata().find(key);
      if (found == file.metadata().end()) detail::refuse(path, detail::text("metadata '", key, "'"), "none");
      return found->second;
    };
    const bool is_ours = file.metadata().contains("architecture");
    if (is_ours) {
      if (metadata("architecture") != architecture())
        detail::refuse(path, "the architecture " + architecture(), metadata("architecture"));
      if (metadata("scalar") != detail::scalar_name<T>)
        detail::refuse(path, detail::text("the scalar type ", detail::scalar_name<T>), metadata("scalar"));
    }
    Model network;
    const auto tensors = Model::tensors();
    for (const ParameterTensor& tensor : tensors) {
      std::vector<T> numbers(static_cast<std::size_t>(tensor.rows) *
                             static_cast<std::size_t>(tensor.columns));
      file.read(tensor.name, shape(tensor), numbers.data());
      const T* from = numbers.data();
      for (int row = 0; row < tensor.rows; ++row)
        for (int column = 0; column < tensor.columns; ++column)
          network.parameters()[tensor.index(row, column)] = *from++;
    }
    if (!is_ours && file.tensors().size() != tensors.size())
      detail::refuse(path, detail::text("the ", tensors.size(), " tensors of ", architecture()),
                     file.tensors().size());
    if (is_ours) check_probes(file, network, metadata("probe_inputs"), metadata("probe_outputs"));
    return network;
  }

 private:
  static constexpr int probes = 3;
  using Inputs = Eigen::Matrix<T, Model::input_size, probes>;
  using Outputs = Eigen::Matrix<T, Model::output_size, probes>;

  static std::string architecture() { return detail::LayerName<Layers>::text(detail::LayerText::shortened); }

  static std::vector<Eigen::Index> shape(const ParameterTensor& tensor) {
    return tensor.is_bias ? std::vector<Eigen::Index>{tensor.rows}
                          : std::vector<Eigen::Index>{tensor.rows, tensor.columns};
  }

  static Outputs probe(const Model& network, const Inputs& inputs) {
    Outputs outputs;
    for (int i = 0; i < probes; ++i) outputs.col(i) = network.forward(inputs.col(i));
    return outputs;
  }

  static void check_probes(const SafetensorsReader& file, const Model& network, const std::string& inputs,
                           const std::string& outputs) {
    const std::string what = file.path().string() + ": probe ";
    Inputs x;
    Outputs expected;
    detail::numbers_from_text(what + "inputs", inputs, x);
    detail::numbers_from_text(what + "outputs", outputs, expected);
    const Outputs found = probe(network, x);
    const T tolerance = 8192 * std::numeric_limits<T>::epsilon() * expected.cwiseAbs().maxCoeff();
    const T error = (found - expected).cwiseAbs().maxCoeff();
    if (!(error <= tolerance))
      detail::refuse(what + "outputs", detail::text("an error of at most ", tolerance), error);
  }
};

}  // namespace rbres
