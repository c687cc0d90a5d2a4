#pragma once

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <filesystem>
#include <limits>
#include <span>
#include <string>

#include <Eigen/Core>

#include <rbres/core/error.hpp>
#include <rbres/core/philox.hpp>
#include <rbres/io/metadata.hpp>
#include <rbres/io/parameters.hpp>
#include <rbres/io/safetensors.hpp>
#include <rbres/nn/network.hpp>

namespace rbres::RBRES_ABI {

/// How a type of model stands in a safetensors file: write() adds its tensors and metadata, read() gives the
/// model or throws Error. Specialise it for a type that holds a network and more, and write both into the one
/// file.
template <class Model>
struct ModelFormat;

/// Saves a model as a safetensors file with a digest, and with the user's own metadata; the model's own keys
/// are taken (for a network "architecture", "scalar", "probe_inputs" and "probe_outputs"; "sha256"). The file
/// is then to be committed: for a program that opens it before long work.
template <class Model>
void save(AtomicFile& file, const Model& model, const Metadata& metadata = {}) {
  SafetensorsWriter tensors;
  ModelFormat<Model>::write(tensors, model);
  detail::add_metadata(tensors, metadata, file.path());
  tensors.write_with_digest(file);
}

/// The same in one step: what is at `path` then is the whole old file or the whole new one (see AtomicFile).
template <class Model>
void save(const std::filesystem::path& path, const Model& model, const Metadata& metadata = {}) {
  AtomicFile file(path);
  save(file, model, metadata);
  file.commit();
}

/// Loads a model that save() wrote. Every other file, be it one bit that differs, is an Error that names the
/// path and what is wrong. With Digest::optional also a file without a digest: a network that PyTorch wrote,
/// or a model of rbres from before it stored digests. Of such a file nobody knows whether it is whole.
template <class Model>
Model load(const std::filesystem::path& path, Digest digest = Digest::required) {
  const SafetensorsReader file(path);
  if (digest == Digest::required) file.require_digest();
  return ModelFormat<Model>::read(file);
}

namespace detail {

/// A few samples, by which a file is checked when it is loaded.
template <class T, int Size>
using Probes = Eigen::Matrix<T, Size, 3>;

/// What the network says of them. By plain copies: loading instantiates no more of Eigen than it must.
template <class Net>
auto probe(const Net& network, const Probes<typename Net::Scalar, Net::input_size>& inputs) {
  Probes<typename Net::Scalar, Net::output_size> outputs;
  for (int i = 0; i < 3; ++i) {
    typename Net::Input x;
    std::copy_n(inputs.data() + i * Net::input_size, Net::input_size, x.data());
    const typename Net::Output y = network.forward(x);
    std::copy_n(y.data(), Net::output_size, outputs.data() + i * Net::output_size);
  }
  return outputs;
}

/// Adds a few inputs, of which only the first so many are not 0, and the first so many of their outputs.
template <class Net>
void add_probes(SafetensorsWriter& file, const Net& network, int inputs, int outputs) {
  using T = typename Net::Scalar;
  Probes<T, Net::input_size> in = Probes<T, Net::input_size>::Zero();
  Random random(0);
  for (T& number : in.topRows(inputs).reshaped()) number = static_cast<T>(random.normal());
  const auto out = probe(network, in);
  require_finite("the network's outputs", out.data(), static_cast<std::size_t>(out.size()));
  file.metadata["probe_inputs"] = numbers_to_text(in.topRows(inputs));
  file.metadata["probe_outputs"] = numbers_to_text(out.topRows(outputs));
}

/// Error where these outputs for the stored inputs are not those that are stored.
template <class T>
[[gnu::cold]] void check_probes(const SafetensorsReader& file, std::span<const T> found, const T* stored) {
  T largest = 0, error = 0;
  for (std::size_t i = 0; i < found.size(); ++i) {
    largest = std::max(largest, std::abs(stored[i]));
    const T e = std::abs(found[i] - stored[i]);
    if (e > error || std::isnan(e)) error = e;  // once NaN it stays so
  }
  const T tolerance = 8192 * std::numeric_limits<T>::epsilon() * largest;
  if (!(error <= tolerance))
    refuse(file.path().string() + ": outputs for the stored inputs", text("an error of at most ", tolerance),
           error);
}

}  // namespace detail

/// A network's file is what `safetensors.torch.save_file(module.state_dict(), path)` writes for the
/// nn.Sequential of the same layers, and loads there: tensors "0.weight" [outputs, inputs] and "0.bias"
/// [outputs]. Its metadata say the architecture and the scalar type, and hold a few inputs with their
/// outputs, which are computed again at loading: they must agree within 2^13 epsilon of the largest output
/// (1e-3 in float, 2e-12 in double), which other processors and flags keep by far and wrong numbers do not. A
/// file without these metadata, as PyTorch writes it, must hold the network's tensors and no others.
///
/// A network of half-size weights (bfloat16) is saved as such, and is read from the file of a float one, too:
/// its numbers are then rounded.
template <std::floating_point T, class Layers, class W>
struct ModelFormat<Network<T, Layers, W>> {
  /// The network's type.
  using Model = Network<T, Layers, W>;

  /// The network must stay until the file is written.
  static void write(SafetensorsWriter& file, const Model& network) {
    detail::add_parameters<Model>(file, "", network.parameters().data());
    file.metadata = network_metadata<Model>();
    detail::add_probes(file, network, Model::input_size, Model::output_size);
  }

  /// Throws Error where the file is of another network.
  static Model read(const SafetensorsReader& file) {
    if constexpr (!std::is_same_v<W, T>) {
      if (!detail::keeps_parameters_as<W>(file)) return Model(ModelFormat<Network<T, Layers>>::read(file));
    }
    const bool is_ours = file.metadata().contains("architecture");
    if (is_ours) require_metadata(file, network_metadata<Model>());
    Model network;
    detail::read_parameters<Model>(file, "", network.parameters().data());
    if (is_ours) {
      check_probes(file, network);
    } else if (const auto expected = Model::tensors().size(); file.tensors().size() != expected) {
      const auto architecture = network_metadata<Model>().at("architecture");
      detail::refuse(file.path().string(), detail::text("the ", expected, " tensors of ", architecture),
                     file.tensors().size());
    }
    return network;
  }

 private:
  static void check_probes(const SafetensorsReader& file, const Model& network) {
    detail::Probes<T, Model::input_size> inputs;
    detail::Probes<T, Model::output_size> expected;
    detail::numbers_from_metadata(file, "probe_inputs", inputs);
    detail::numbers_from_metadata(file, "probe_outputs", expected);
    const auto found = detail::probe(network, inputs);
    detail::check_probes<T>(file, {found.data(), std::size_t(found.size())}, expected.data());
  }
};

}  // namespace rbres::RBRES_ABI
