#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include <Eigen/Core>
#include <nlohmann/json.hpp>

#include <rbres/core/bfloat16.hpp>
#include <rbres/core/error.hpp>
#include <rbres/io/file.hpp>

namespace rbres::RBRES_ABI {

/// Strings by name: what rides in a safetensors file as `__metadata__`.
using Metadata = std::map<std::string, std::string>;

/// Where a tensor stands in a safetensors file, and what it is.
struct TensorInfo {
  std::string dtype;                       ///< "F32", "F64", "I64", ...
  std::vector<Eigen::Index> shape;         ///< row-major (C order); empty for a single number
  std::array<std::uint64_t, 2> offsets{};  ///< first byte and one past the last, from the start of the data
};

namespace detail {

/// The format's name of a type; empty where this library has no use for it.
template <class Scalar>
constexpr std::string_view safetensors_dtype() {
  if constexpr (std::is_same_v<Scalar, float>) return "F32";
  if constexpr (std::is_same_v<Scalar, double>) return "F64";
  if constexpr (std::is_same_v<Scalar, bfloat16>) return "BF16";
  if constexpr (std::is_same_v<Scalar, std::int64_t>) return "I64";
  if constexpr (std::is_same_v<Scalar, std::uint64_t>) return "U64";
  if constexpr (std::is_same_v<Scalar, std::uint8_t>) return "U8";
  return {};
}

/// Bytes of one number; 0 for a type that the format does not have.
inline std::uint64_t safetensors_dtype_size(std::string_view dtype) {
  for (const std::string_view one : {"BOOL", "U8", "I8", "F8_E5M2", "F8_E4M3"})
    if (dtype == one) return 1;
  for (const std::string_view two : {"I16", "U16", "F16", "BF16"})
    if (dtype == two) return 2;
  for (const std::string_view four : {"I32", "U32", "F32"})
    if (dtype == four) return 4;
  for (const std::string_view eight : {"I64", "U64", "F64"})
    if (dtype == eight) return 8;
  return 0;
}

/// Receives the header's JSON as it is parsed, and accepts what the format allows and nothing else: no tree
/// is built, so neither deep nesting nor a long list of anything else costs memory.
class SafetensorsHeader {
 public:
  using json = nlohmann::json;

  SafetensorsHeader(const std::filesystem::path& path, Metadata& metadata,
                    std::map<std::string, TensorInfo>& tensors)
      : path_(path), metadata_(metadata), tensors_(tensors) {}

  bool start_object(std::size_t) {
    if (place_ == Place::start) return enter(Place::names);
    if (place_ == Place::name) return enter(key_ == "__metadata__" ? Place::metadata : Place::fields);
    unexpected("an object");
  }
  bool end_object() {
    if (place_ == Place::fields && fields_.size() != 3)
      fail("dtype, shape and data_offsets", "a tensor that lacks one");
    return enter(place_ == Place::names ? Place::end : Place::names);
  }
  bool key(std::string& key) {
    if (place_ == Place::metadata) {
      metadata_key_ = key;
      if (!metadata_.try_emplace(key).second) fail("each key once", "'" + key + "' twice");
      return enter(Place::metadata_value);
    }
    if (place_ == Place::fields) {
      if (key != "dtype" && key != "shape" && key != "data_offsets")
        fail("dtype, shape, data_offsets", "'" + key + "'");
      if (!fields_.insert(key).second) fail("each key once", "'" + key + "' twice");
      return enter(key == "dtype" ? Place::dtype : key == "shape" ? Place::shape : Place::offsets);
    }
    const bool is_new =
        key == "__metadata__" ? !std::exchange(has_metadata_, true) : tensors_.try_emplace(key).second;
    if (!is_new) fail("each key once", "'" + key + "' twice");
    key_ = key;
    fields_.clear();
    return enter(Place::name);
  }
  bool string(std::string& value) {
    if (place_ == Place::metadata_value) {
      metadata_[metadata_key_] = std::move(value);
      return enter(Place::metadata);
    }
    if (place_ != Place::dtype) unexpected("a string");
    if (safetensors_dtype_size(value) == 0) fail("a dtype of the format", "'" + value + "'");
    tensors_[key_].dtype = std::move(value);
    return enter(Place::fields);
  }
  bool start_array(std::size_t) {
    numbers_ = 0;
    if (place_ == Place::shape) return enter(Place::extents);
    if (place_ == Place::offsets) return enter(Place::bounds);
    unexpected("an array");
  }
  bool end_array() {
    if (place_ == Place::bounds && numbers_ != 2) fail("two data_offsets", numbers_);
    return enter(Place::fields);
  }
  bool number_unsigned(json::number_unsigned_t value) {
    TensorInfo& tensor = tensors_[key_];
    checked_product(path_, value, 1);
    if (place_ == Place::extents) {
      constexpr int most = 8;
      if (++numbers_ > most) fail("at most 8 dimensions", "more");
      tensor.shape.push_back(static_cast<Eigen::Index>(value));
      return true;
    }
    if (place_ != Place::bounds) unexpected("a number");
    if (++numbers_ > 2) fail("two data_offsets", "more");
    tensor.offsets[static_cast<std::size_t>(numbers_ - 1)] = value;
    return true;
  }
  bool null() { unexpected("null"); }
  bool boolean(bool) { unexpected("a boolean"); }
  bool number_integer(json::number_integer_t) { unexpected("a negative number"); }
  bool number_float(json::number_float_t, const std::string&) { unexpected("a fraction"); }
  bool binary(json::binary_t&) { unexpected("binary data"); }
  bool parse_error(std::size_t, const std::string&, const nlohmann::detail::exception& problem) {
    fail("JSON", problem.what());
  }

 private:
  /// What the parser has just entered or is about to read.
  enum class Place {
    start,
    names,
    name,
    metadata,
    metadata_value,
    fields,
    dtype,
    shape,
    extents,
    offsets,
    bounds,
    end
  };

  bool enter(Place place) {
    place_ = place;
    return true;
  }
  template <class Found>
  [[noreturn]] void fail(std::string_view expected, const Found& found) const {
    refuse(path_.string() + ": safetensors header", expected, found);
  }
  [[noreturn]] void unexpected(std::string_view found) const {
    fail("{name: {dtype, shape, data_offsets}, __metadata__: {name: string}}",
         text(found, key_.empty() ? "" : " under '", key_, key_.empty() ? "" : "'"));
  }

  const std::filesystem::path& path_;
  Metadata& metadata_;
  std::map<std::string, TensorInfo>& tensors_;
  Place place_ = Place::start;
  std::string key_, metadata_key_;
  std::set<std::string> fields_;
  bool has_metadata_ = false;
  int numbers_ = 0;
};

/// Refuses tensors whose bytes are not what their shape says, or which overlap, leave gaps, or do not fill
/// the data.
inline void check_offsets(const std::filesystem::path& path, const std::map<std::string, TensorInfo>& tensors,
                          std::uint64_t data_size) {
  std::vector<const std::pair<const std::string, TensorInfo>*> in_order;
  for (const auto& entry : tensors) in_order.push_back(&entry);
  std::sort(in_order.begin(), in_order.end(),
            [](auto a, auto b) { return a->second.offsets < b->second.offsets; });
  std::uint64_t end = 0;
  for (const auto* entry : in_order) {
    const auto& [name, tensor] = *entry;
    const std::string what = text(path.string(), ": tensor '", name, "'");
    if (tensor.offsets[0] != end) refuse(what, text("data from offset ", end), tensor.offsets[0]);
    std::uint64_t bytes = safetensors_dtype_size(tensor.dtype);
    for (const Eigen::Index extent : tensor.shape)
      bytes = checked_product(path, bytes, static_cast<std::uint64_t>(extent));
    end = tensor.offsets[1];
    if (end < tensor.offsets[0] || end - tensor.offsets[0] != bytes)
      refuse(what, text(bytes, " bytes, as its shape says"),
             text("offsets ", tensor.offsets[0], " to ", end));
  }
  if (end != data_size) refuse(path.string(), text(end, " bytes of tensors, as the header says"), data_size);
}

}  // namespace detail
}  // namespace rbres::RBRES_ABI
