#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <map>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rbres/core/bfloat16.hpp>
#include <rbres/core/error.hpp>
#include <rbres/io/file.hpp>
#include <rbres/io/json_string.hpp>

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
[[gnu::cold]] inline std::uint64_t safetensors_dtype_size(std::string_view dtype) {
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

/// Reads the header's JSON, and accepts what the format allows and nothing else: no tree is built, so
/// neither deep nesting nor a long list of anything else costs memory.
class SafetensorsHeader {
 public:
  SafetensorsHeader(const std::filesystem::path& path, std::string_view json, Metadata& metadata,
                    std::map<std::string, TensorInfo>& tensors)
      : path_(path), json_(json), metadata_(metadata), tensors_(tensors) {}

  /// Throws Error that names the path.
  [[gnu::cold]] void read() {
    bool has_metadata = false;
    members([&](const std::string& name) {
      const bool is_metadata = name == "__metadata__";
      if (is_metadata ? std::exchange(has_metadata, true) : tensors_.contains(name)) found_twice(name);
      under_ = name;
      if (is_metadata)
        members([&](const std::string& key) {
          if (metadata_.contains(key)) found_twice(key);
          metadata_[key] = string();
        });
      else
        read_tensor(tensors_[name]);
    });
    next();
    if (at_ != json_.size()) no_json();
  }

 private:
  [[gnu::cold]] void read_tensor(TensorInfo& tensor) {
    bool has_dtype = false, has_shape = false, has_offsets = false;
    members([&](const std::string& key) {
      const bool is_dtype = key == "dtype", is_shape = key == "shape";
      if (!is_dtype && !is_shape && key != "data_offsets")
        fail("dtype, shape, data_offsets", "'" + key + "'");
      if (std::exchange(is_dtype ? has_dtype : is_shape ? has_shape : has_offsets, true)) found_twice(key);
      if (is_dtype) {
        tensor.dtype = string();
        if (safetensors_dtype_size(tensor.dtype) == 0)
          fail("a dtype of the format", "'" + tensor.dtype + "'");
        return;
      }
      std::size_t count = 0;
      parts('[', ']', [&] {
        const std::uint64_t value = number();
        if (is_shape) {
          if (++count > 8) fail("at most 8 dimensions", "more");
          tensor.shape.push_back(static_cast<Eigen::Index>(value));
        } else {
          if (++count > 2) fail("two data_offsets", "more");
          tensor.offsets[count - 1] = value;
        }
      });
      if (!is_shape && count != 2) fail("two data_offsets", text(count));
    });
    if (!has_dtype || !has_shape || !has_offsets)
      fail("dtype, shape and data_offsets", "a tensor that lacks one");
  }

  /// The next character that is no space; '\0', which JSON has nowhere, behind the last.
  char next() {
    at_ = std::min(json_.find_first_not_of(" \t\r\n", at_), json_.size());
    return at_ < json_.size() ? json_[at_] : '\0';
  }
  /// Calls take() where each part between brackets begins; commas stand between them.
  template <class Take>
  void parts(char open, char close, const Take& take) {
    if (next() != open) unexpected();
    ++at_;
    if (next() == close) {
      ++at_;
      return;
    }
    for (;; ++at_) {
      take();
      if (next() == close) break;
      if (next() != ',') no_json();
    }
    ++at_;
  }
  /// Calls take(key) where each value of an object begins.
  template <class Take>
  void members(const Take& take) {
    parts('{', '}', [&] {
      if (next() != '"') no_json();
      const std::string key = string();
      if (next() != ':') no_json();
      ++at_;
      take(key);
    });
  }
  [[gnu::cold]] std::string string() {
    std::string out;
    if (next() != '"') unexpected();
    if (!read_quoted(json_, at_, out)) no_json();
    return out;
  }
  /// A number of 0 or more, which is less than 2^63.
  [[gnu::cold]] std::uint64_t number() {
    const char first = next();
    if (first < '0' || first > '9') unexpected();
    std::uint64_t value = 0;
    const std::size_t begin = at_;
    bool fits = true;
    for (; at_ < json_.size() && json_[at_] >= '0' && json_[at_] <= '9'; ++at_) {
      const auto digit = static_cast<std::uint64_t>(json_[at_] - '0');
      fits = fits && value <= (std::numeric_limits<std::uint64_t>::max() - digit) / 10;
      value = 10 * value + digit;
    }
    if (first == '0' && at_ - begin > 1) no_json();
    const char behind = next();
    if (!fits || behind == '.' || behind == 'e' || behind == 'E') unexpected("a fraction");
    return checked_product(path_, value, 1);
  }

  [[noreturn, gnu::cold]] void fail(std::string_view expected, std::string_view found) const {
    refuse(path_.string() + ": safetensors header", expected, found);
  }
  [[noreturn, gnu::cold]] void found_twice(const std::string& key) const {
    fail("each key once", "'" + key + "' twice");
  }
  [[noreturn, gnu::cold]] void no_json() const {
    fail("JSON", at_ < json_.size() ? text("something else at byte ", at_) : "its end");
  }
  [[noreturn, gnu::cold]] void unexpected(std::string_view found) const {
    fail("{name: {dtype, shape, data_offsets}, __metadata__: {name: string}}",
         text(found, under_.empty() ? "" : " under '", under_, under_.empty() ? "" : "'"));
  }
  /// Refuses what begins here.
  [[noreturn, gnu::cold]] void unexpected() {
    switch (next()) {
      case '{':
        unexpected("an object");
      case '[':
        unexpected("an array");
      case '"':
        unexpected("a string");
      case '-':
        unexpected("a negative number");
      case 't':
      case 'f':
        unexpected("a boolean");
      case 'n':
        unexpected("null");
      default:
        break;
    }
    if (next() >= '0' && next() <= '9') unexpected("a number");
    no_json();
  }

  const std::filesystem::path& path_;
  std::string_view json_;
  Metadata& metadata_;
  std::map<std::string, TensorInfo>& tensors_;
  std::size_t at_ = 0;
  std::string under_;  ///< the name in whose value at_ is
};

/// Refuses tensors whose bytes are not what their shape says, or which overlap, leave gaps, or do not fill
/// the data.
[[gnu::cold]] inline void check_offsets(const std::filesystem::path& path,
                                        const std::map<std::string, TensorInfo>& tensors,
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
