#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include <Eigen/Core>
#include <nlohmann/json.hpp>

#include <rbres/io/atomic_file.hpp>
#include <rbres/io/file.hpp>
#include <rbres/io/safetensors_header.hpp>

namespace rbres {

namespace detail {

inline std::string shape_text(const std::vector<Eigen::Index>& shape) {
  std::string out = "[";
  for (const Eigen::Index extent : shape) out += text(out.size() > 1 ? ", " : "", extent);
  return out + "]";
}

template <class Scalar>
void require_finite(const std::string& what, const Scalar* values, std::size_t size) {
  if constexpr (std::is_floating_point_v<Scalar>) {
    const Scalar* bad = std::find_if_not(values, values + size, [](Scalar x) { return std::isfinite(x); });
    if (bad != values + size) refuse(what, "finite numbers", text(*bad, " at index ", bad - values));
  }
}

}  // namespace detail

/// Writes named tensors and metadata as one safetensors file (github.com/huggingface/safetensors). It keeps
/// views: the numbers must outlive write(), and are not copied. Numbers are float, double, std::int64_t,
/// std::uint64_t or std::uint8_t.
class SafetensorsWriter {
 public:
  Metadata metadata;

  /// `values` points to the tensor's numbers in row-major (C) order. Error when the name is taken or a number
  /// is not finite.
  template <class Scalar>
  void add(const std::string& name, std::vector<Eigen::Index> shape, const Scalar* values) {
    static_assert(!detail::safetensors_dtype<Scalar>().empty(), "rbres: no safetensors of this type");
    std::size_t size = 1;
    for (const Eigen::Index extent : shape) size *= static_cast<std::size_t>(extent);
    detail::require_finite("tensor '" + name + "'", values, size);
    Tensor tensor{std::string(detail::safetensors_dtype<Scalar>()), std::move(shape), values,
                  size * sizeof(Scalar)};
    if (name == "__metadata__" || !tensors_.emplace(name, std::move(tensor)).second)
      detail::refuse("tensor names", "each once", "'" + name + "' twice");
  }

  /// Writes the file atomically; see AtomicFile for the errors.
  void write(const std::filesystem::path& path) const {
    // The widest type first keeps every tensor aligned, also for readers that map the file.
    std::vector<const std::pair<const std::string, Tensor>*> in_order;
    for (const auto& entry : tensors_) in_order.push_back(&entry);
    std::stable_sort(in_order.begin(), in_order.end(), [](auto a, auto b) {
      return detail::safetensors_dtype_size(a->second.dtype) >
             detail::safetensors_dtype_size(b->second.dtype);
    });
    nlohmann::json header = nlohmann::json::object();
    if (!metadata.empty()) header["__metadata__"] = metadata;
    std::size_t end = 0;
    for (const auto* entry : in_order) {
      const auto& [name, tensor] = *entry;
      header[name] = {
          {"dtype", tensor.dtype}, {"shape", tensor.shape}, {"data_offsets", {end, end + tensor.bytes}}};
      end += tensor.bytes;
    }
    std::string json;
    try {
      json = header.dump();
    } catch (const nlohmann::json::exception& problem) {
      throw Error(detail::text(path.string(), ": names and metadata must be UTF-8: ", problem.what()));
    }
    json.resize((json.size() + 7) / 8 * 8, ' ');
    AtomicFile file(path);
    const std::uint64_t size = json.size();
    file.write(&size, sizeof size);
    file.write(json.data(), json.size());
    for (const auto* entry : in_order) file.write(entry->second.data, entry->second.bytes);
    file.commit();
  }

 private:
  struct Tensor {
    std::string dtype;
    std::vector<Eigen::Index> shape;
    const void* data;
    std::size_t bytes;
  };
  std::map<std::string, Tensor> tensors_;
};

/// Reads a safetensors file: the header at once, every tensor when it is asked for. Every malformed file
/// (truncated, trailing bytes, offsets that overlap, leave gaps or point outside, wrong JSON, ...) is an
/// rbres::Error that names the path and what is wrong. Memory is bounded by the file's own size, whatever its
/// header promises.
class SafetensorsReader {
 public:
  explicit SafetensorsReader(std::filesystem::path path) : file_(std::move(path)) {
    std::uint64_t size = 0;
    file_.read(0, &size, sizeof size);
    constexpr std::uint64_t largest = 100'000'000;  // the reference implementation's limit
    data_ = sizeof size + std::min(size, largest);
    if (size > largest || data_ > file_.size())
      detail::refuse(file_.path().string(),
                     detail::text("a safetensors header within ", file_.size(), " bytes"),
                     detail::text("a length of ", size));
    std::string json(static_cast<std::size_t>(size), '\0');
    file_.read(sizeof size, json.data(), json.size());
    if (!json.starts_with('{')) detail::refuse(file_.path().string(), "a safetensors file", "no { at byte 8");
    detail::SafetensorsHeader header(file_.path(), metadata_, tensors_);
    nlohmann::json::sax_parse(json, &header);
    detail::check_offsets(file_.path(), tensors_, file_.size() - data_);
  }

  const std::filesystem::path& path() const noexcept { return file_.path(); }
  const Metadata& metadata() const noexcept { return metadata_; }
  const std::map<std::string, TensorInfo>& tensors() const noexcept { return tensors_; }
  bool contains(const std::string& name) const { return tensors_.contains(name); }

  /// Reads a tensor's numbers in row-major (C) order to `values`. Error when there is none of that name, when
  /// its type or shape is another, or when a number is not finite.
  template <class Scalar>
  void read(const std::string& name, const std::vector<Eigen::Index>& shape, Scalar* values) const {
    static_assert(!detail::safetensors_dtype<Scalar>().empty(), "rbres: no safetensors of this type");
    const std::string what = detail::text(path().string(), ": tensor '", name, "'");
    const auto found = tensors_.find(name);
    if (found == tensors_.end()) throw Error(what + " is missing");
    const TensorInfo& tensor = found->second;
    if (tensor.dtype != detail::safetensors_dtype<Scalar>())
      detail::refuse(what, detail::text("dtype ", detail::safetensors_dtype<Scalar>()), tensor.dtype);
    if (tensor.shape != shape)
      detail::refuse(what, "shape " + detail::shape_text(shape), detail::shape_text(tensor.shape));
    const auto bytes = static_cast<std::size_t>(tensor.offsets[1] - tensor.offsets[0]);
    file_.read(data_ + tensor.offsets[0], values, bytes);
    detail::require_finite(what, values, bytes / sizeof(Scalar));
  }

 private:
  detail::InputFile file_;
  std::uint64_t data_ = 0;  ///< where the data start in the file
  Metadata metadata_;
  std::map<std::string, TensorInfo> tensors_;
};

}  // namespace rbres
