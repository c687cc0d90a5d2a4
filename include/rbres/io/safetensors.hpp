#pragma once

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rbres/io/atomic_file.hpp>
#include <rbres/io/digest.hpp>
#include <rbres/io/file.hpp>
#include <rbres/io/json_string.hpp>
#include <rbres/io/safetensors_header.hpp>
#include <rbres/io/utf8.hpp>

namespace rbres::RBRES_ABI {

namespace detail {

[[gnu::cold]] inline std::string shape_text(const std::vector<Eigen::Index>& shape,
                                            std::string_view between = ", ") {
  std::string out = "[";
  for (const Eigen::Index extent : shape) out += text(out.size() > 1 ? between : "", extent);
  return out + "]";
}

/// A JSON object of values that are JSON themselves.
[[gnu::cold]] inline std::string json_object(const Metadata& members) {
  std::string out = "{";
  for (const auto& [name, value] : members)
    out += text(out.size() > 1 ? "," : "", json_string(name), ':', value);
  return out + "}";
}

template <class Scalar>
void require_finite(const std::string& what, const Scalar* values, std::size_t size) {
  if constexpr (!std::is_integral_v<Scalar>) {
    const Scalar* bad = std::find_if_not(values, values + size, [](auto x) { return std::isfinite(+x); });
    if (bad != values + size) refuse(what, "finite numbers", text(+*bad, " at index ", bad - values));
  }
}

/// Numbers of a tensor of this shape; Error that begins with `what` when there can be none.
inline std::size_t shape_size(const std::string& what, const std::vector<Eigen::Index>& shape) {
  std::size_t size = 1;
  for (const Eigen::Index extent : shape) {
    constexpr auto most = static_cast<std::size_t>(std::numeric_limits<std::int64_t>::max()) / 8;
    if (extent < 0 || (extent > 0 && size > most / static_cast<std::size_t>(extent)))
      refuse(what, "a shape of less than 2^63 bytes", shape_text(shape));
    size *= static_cast<std::size_t>(extent);
  }
  return size;
}

}  // namespace detail

/// Writes named tensors and metadata as one safetensors file (github.com/huggingface/safetensors). The
/// numbers are float, double, bfloat16, std::int64_t, std::uint64_t or std::uint8_t, are not copied, and must
/// stay until write() is done.
class SafetensorsWriter {
 public:
  /// What the file says of itself.
  Metadata metadata;

  /// `values` points to the tensor's numbers in row-major (C) order. Error when the name is taken, or the
  /// shape has a negative extent or 2^63 bytes.
  template <class Scalar>
  void add(const std::string& name, std::vector<Eigen::Index> shape, const Scalar* values) {
    insert<Scalar>(name, std::move(shape), [values](Output& file, const std::string& what, std::size_t size) {
      detail::require_finite(what, values, size);
      file.write(values, size * sizeof(Scalar));
    });
  }

  /// For numbers that stand in another order: fill(Scalar* to) puts them in row-major order when the file is
  /// written, so that only one tensor at a time is in memory twice.
  template <class Scalar, std::invocable<Scalar*> Fill>
  void add(const std::string& name, std::vector<Eigen::Index> shape, Fill fill) {
    insert<Scalar>(name, std::move(shape), [fill](Output& file, const std::string& what, std::size_t size) {
      std::vector<Scalar> values(size);
      fill(values.data());
      detail::require_finite(what, values.data(), size);
      file.write(values.data(), size * sizeof(Scalar));
    });
  }

  /// Writes the file atomically; see AtomicFile for the errors. Error too when a number is not finite, or a
  /// name or the metadata are not UTF-8.
  void write(const std::filesystem::path& path) const {
    AtomicFile file(path);
    write(file, false);
    file.commit();
  }

  /// The same with a digest of all its bytes in the metadata, "sha256", by which SafetensorsReader finds any
  /// change: the SHA-256 of the file in which the digest's own 64 digits are zeros.
  void write_with_digest(const std::filesystem::path& path) const {
    AtomicFile file(path);
    write_with_digest(file);
    file.commit();
  }
  /// To a file that is then to be committed.
  void write_with_digest(AtomicFile& file) const { write(file, true); }

 private:
  /// The file, and the digest of what has gone into it.
  struct Output {
    AtomicFile& file;
    Sha256 hash;

    void write(const void* data, std::size_t size) {
      hash.add(data, size);
      file.write(data, size);
    }
  };

  struct Tensor {
    std::string dtype;
    std::size_t number_bytes;
    std::vector<Eigen::Index> shape;
    std::size_t size;  ///< numbers: the product of the shape
    std::function<void(Output&, const std::string& what, std::size_t size)> write;
  };

  /// A template, so that only who writes compiles it.
  template <class File>
  void write(File& file, bool with_digest) const {
    const std::string path = file.path().string();
    Metadata all = metadata;
    if (!all.emplace(detail::digest_key, detail::no_digest).second)
      detail::refuse(path, "metadata that leave the digest's own key alone", "'sha256'");
    if (!with_digest) all.erase(std::string(detail::digest_key));
    // The widest type first keeps every tensor aligned, also for readers that map the file.
    std::vector<const std::pair<const std::string, Tensor>*> in_order;
    for (const auto& entry : tensors_) in_order.push_back(&entry);
    std::sort(in_order.begin(), in_order.end(), [](auto a, auto b) {
      const std::size_t first = a->second.number_bytes, second = b->second.number_bytes;
      return first != second ? first > second : a->first < b->first;
    });
    Metadata header;  // members as JSON, in the order of their names
    if (!all.empty()) {
      for (auto& entry : all) entry.second = detail::json_string(entry.second);
      header["__metadata__"] = detail::json_object(all);
    }
    std::size_t end = 0;
    for (const auto* entry : in_order) {
      const auto& [name, tensor] = *entry;
      const std::size_t begin = std::exchange(end, end + tensor.size * tensor.number_bytes);
      header[name] = detail::text(R"({"data_offsets":[)", begin, ',', end, R"(],"dtype":")", tensor.dtype,
                                  R"(","shape":)", detail::shape_text(tensor.shape, ","), '}');
    }
    std::string json = detail::json_object(header);
    if (!detail::is_utf8(json)) detail::refuse(path, "names and metadata in UTF-8", "bytes that are not");
    json.resize((json.size() + 7) / 8 * 8, ' ');
    const std::uint64_t size = json.size();
    Output out{file, {}};
    out.write(&size, sizeof size);
    out.write(json.data(), json.size());
    for (const auto* entry : in_order) {
      const auto& [name, tensor] = *entry;
      tensor.write(out, detail::text(path, ": tensor '", name, "'"), tensor.size);
    }
    if (!with_digest) return;
    const std::string digest = out.hash.text();
    file.write_at(sizeof size + detail::digest_place(json), digest.data(), digest.size());
  }

  template <class Scalar, class Write>
  void insert(const std::string& name, std::vector<Eigen::Index> shape, Write write) {
    constexpr std::string_view dtype = detail::safetensors_dtype<Scalar>();
    static_assert(!dtype.empty(), "rbres: no safetensors of this type");
    const std::size_t size = detail::shape_size("tensor '" + name + "'", shape);
    Tensor tensor{std::string(dtype), sizeof(Scalar), std::move(shape), size, std::move(write)};
    if (name == "__metadata__" || !tensors_.emplace(name, std::move(tensor)).second)
      detail::refuse("tensor names", "each once", "'" + name + "' twice");
  }

  std::map<std::string, Tensor> tensors_;
};

/// Reads a safetensors file: the header at once, every tensor when it is asked for. Every malformed file
/// (truncated, trailing bytes, offsets that overlap, leave gaps or point outside, wrong JSON, ...) is an
/// rbres::Error that names the path and what is wrong. Memory is bounded by the file's own size, whatever its
/// header promises. A digest that SafetensorsWriter::write_with_digest() stored is checked: of such a file
/// every change is an Error, of every single bit.
class SafetensorsReader {
 public:
  /// Opens a file and reads its header.
  explicit SafetensorsReader(std::filesystem::path path) : file_(std::move(path)) {
    std::uint64_t size = 0;
    file_.read_first(&size, sizeof size, "a safetensors file");
    constexpr std::uint64_t largest = 100'000'000;  // the reference implementation's limit
    data_ = sizeof size + std::min(size, largest);
    if (size > largest || data_ > file_.size())
      detail::refuse(file_.path().string(),
                     detail::text("a safetensors header within ", file_.size(), " bytes"),
                     detail::text("a length of ", size));
    std::string json(static_cast<std::size_t>(size), '\0');
    file_.read(sizeof size, json.data(), json.size());
    if (!json.starts_with('{')) detail::refuse(file_.path().string(), "a safetensors file", "no { at byte 8");
    detail::SafetensorsHeader(file_.path(), json, metadata_, tensors_).read();
    detail::check_offsets(file_.path(), tensors_, file_.size() - data_);
    if (has_digest()) check_digest(std::move(json));
  }

  /// Of the file.
  const std::filesystem::path& path() const noexcept { return file_.path(); }
  /// What the file says of itself.
  const Metadata& metadata() const noexcept { return metadata_; }
  /// What the file holds, by name.
  const std::map<std::string, TensorInfo>& tensors() const noexcept { return tensors_; }
  /// Whether it holds a tensor of this name.
  bool contains(const std::string& name) const { return tensors_.contains(name); }
  /// Whether the file says its own digest, which then is right.
  bool has_digest() const { return metadata_.contains(std::string(detail::digest_key)); }
  /// Error when the file has no digest; the message ends with `otherwise`, what may be done about it.
  void require_digest(
      const std::string& otherwise = "; load(path, Digest::optional) takes it unchecked") const {
    if (has_digest()) return;
    const bool is_ours = metadata_.contains("architecture");
    detail::refuse(
        path().string(), "a SHA-256 digest of the file (metadata 'sha256')",
        (is_ours ? "none: rbres 0.1.0 before digests wrote it" : "none: another program wrote it") +
            otherwise);
  }

  /// Reads a tensor's numbers in row-major (C) order to `values`. Error when there is none of that name, when
  /// its type or shape is another, or when a number is not finite.
  template <class Scalar>
  void read(const std::string& name, const std::vector<Eigen::Index>& shape, Scalar* values) const {
    static_assert(!detail::safetensors_dtype<Scalar>().empty(), "rbres: no safetensors of this type");
    const std::string what = detail::text(path().string(), ": tensor '", name, "'");
    const auto found = tensors_.find(name);
    if (found == tensors_.end()) detail::fail(what + " is missing");
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
  void check_digest(std::string json) const {
    const std::string& expected = metadata_.at(std::string(detail::digest_key));
    const std::size_t place = detail::digest_place(json);
    if (place == json.npos)
      detail::refuse(path().string(), "a digest of 64 digits (metadata 'sha256')", "'" + expected + "'");
    json.replace(place, detail::no_digest.size(), detail::no_digest);
    Sha256 hash;
    const std::uint64_t size = json.size();
    hash.add(&size, sizeof size);
    hash.add(json.data(), json.size());
    detail::add_bytes(hash, file_, data_, file_.size());
    detail::require_digest(path(), expected, hash);
  }

  detail::InputFile file_;
  std::uint64_t data_ = 0;  ///< where the data start in the file
  Metadata metadata_;
  std::map<std::string, TensorInfo> tensors_;
};

}  // namespace rbres::RBRES_ABI
