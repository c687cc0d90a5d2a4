#pragma once

#include <cstddef>
#include <filesystem>
#include <vector>

#include <rbres/io/safetensors.hpp>

template <class Scalar>
void read_tensor(const rbres::SafetensorsReader& file, const std::string& name,
                 const rbres::TensorInfo& tensor) {
  std::vector<Scalar> values(static_cast<std::size_t>(tensor.offsets[1] - tensor.offsets[0]) /
                             sizeof(Scalar));
  file.read(name, tensor.shape, values.data());
}

/// Reads every floating-point tensor of a safetensors file.
inline void read_all_tensors(const std::filesystem::path& path) {
  const rbres::SafetensorsReader file(path);
  for (const auto& [name, tensor] : file.tensors()) {
    if (tensor.dtype == "F32") read_tensor<float>(file, name, tensor);
    if (tensor.dtype == "F64") read_tensor<double>(file, name, tensor);
  }
}
