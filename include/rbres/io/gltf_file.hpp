#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <string>
#include <type_traits>
#include <vector>

#include <nlohmann/json.hpp>

#include <rbres/core/error.hpp>
#include <rbres/io/atomic_file.hpp>

namespace rbres::RBRES_ABI::detail {

/// What a buffer view holds, by the format's numbers.
enum class GltfTarget { none = 0, vertices = 34962, indices = 34963 };

/// A glTF document with its one buffer, written as a .glb file (Khronos, glTF 2.0 specification,
/// section 4.4).
class GltfFile {
 public:
  nlohmann::json json = {{"asset", {{"version", "2.0"}, {"generator", "rbres"}}}};

  /// Appends an object to one of the document's arrays; returns its index there.
  std::size_t append(const char* array, nlohmann::json object) {
    json[array].push_back(std::move(object));
    return json[array].size() - 1;
  }

  /// Appends numbers, `width` per element, with their bounds; returns the accessor's index. Indices, times
  /// and positions must have bounds or may, and they cost nothing elsewhere.
  template <class Scalar>
  std::size_t append_accessor(const std::vector<Scalar>& numbers, std::size_t width, GltfTarget target) {
    constexpr bool is_float = std::is_same_v<Scalar, float>;
    static_assert(is_float || std::is_same_v<Scalar, std::uint16_t>);
    nlohmann::json view = {
        {"buffer", 0}, {"byteOffset", data_.size()}, {"byteLength", numbers.size() * sizeof(Scalar)}};
    if (target != GltfTarget::none) view["target"] = static_cast<int>(target);
    std::vector<Scalar> low(numbers.begin(), numbers.begin() + static_cast<std::ptrdiff_t>(width)),
        high = low;
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      low[i % width] = std::min(low[i % width], numbers[i]);
      high[i % width] = std::max(high[i % width], numbers[i]);
    }
    const auto* bytes = reinterpret_cast<const char*>(numbers.data());
    data_.append(bytes, numbers.size() * sizeof(Scalar));
    pad(data_, '\0');
    return append("accessors", {{"bufferView", append("bufferViews", std::move(view))},
                                {"componentType", is_float ? 5126 : 5123},
                                {"type", width == 1   ? "SCALAR"
                                         : width == 3 ? "VEC3"
                                                      : "VEC4"},
                                {"count", numbers.size() / width},
                                {"min", low},
                                {"max", high}});
  }

  /// Writes the document and its buffer; see AtomicFile for the errors.
  void write(const std::filesystem::path& path) const {
    nlohmann::json whole = json;
    whole["buffers"][0]["byteLength"] = data_.size();
    std::string text = whole.dump();
    pad(text, ' ');
    const std::uint64_t size = 12 + 8 + text.size() + 8 + data_.size();
    if (size > std::numeric_limits<std::uint32_t>::max())
      refuse(path.string(), "a scene of less than 4 GiB", detail::text(size, " bytes"));
    AtomicFile file(path);
    write_numbers(file, {0x46546C67 /* glTF */, 2, size});
    write_numbers(file, {text.size(), 0x4E4F534A /* JSON */});
    file.write(text.data(), text.size());
    write_numbers(file, {data_.size(), 0x004E4942 /* BIN */});
    file.write(data_.data(), data_.size());
    file.commit();
  }

 private:
  static void pad(std::string& bytes, char with) { bytes.resize((bytes.size() + 3) / 4 * 4, with); }
  static void write_numbers(AtomicFile& file, std::initializer_list<std::uint64_t> numbers) {
    for (const std::uint64_t number : numbers) {
      const auto four_bytes = static_cast<std::uint32_t>(number);
      file.write(&four_bytes, sizeof four_bytes);
    }
  }

  std::string data_;
};

}  // namespace rbres::RBRES_ABI::detail
