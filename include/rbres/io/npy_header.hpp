#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include <Eigen/Core>

#include <rbres/core/error.hpp>
#include <rbres/io/file.hpp>

namespace rbres::RBRES_ABI::detail {

/// NumPy's name of a type, as the key 'descr' of a .npy header gives it.
template <class Scalar>
constexpr std::string_view npy_descr() {
  if constexpr (std::is_same_v<Scalar, float>) return "<f4";
  if constexpr (std::is_same_v<Scalar, double>) return "<f8";
  if constexpr (std::is_same_v<Scalar, std::int32_t>) return "<i4";
  if constexpr (std::is_same_v<Scalar, std::int64_t>) return "<i8";
  if constexpr (std::is_same_v<Scalar, std::uint8_t>) return "|u1";
  return {};
}

inline constexpr std::string_view npy_magic = "\x93NUMPY";

/// What stands before the numbers of a .npy file.
struct NpyHeader {
  std::string descr;
  std::vector<Eigen::Index> shape;
  std::uint64_t data = 0;  ///< offset of the first number
};

/// The bytes of a format 1.0 header, padded with spaces to `size` bytes, or where that is 0 to the next
/// multiple of 64.
inline std::string npy_header(std::string_view descr, const std::vector<Eigen::Index>& shape,
                              std::size_t size) {
  std::string dictionary = text("{'descr': '", descr, "', 'fortran_order': False, 'shape': (");
  for (const Eigen::Index extent : shape) dictionary += text(extent, shape.size() == 1 ? "," : ", ");
  if (shape.size() > 1) dictionary.resize(dictionary.size() - 2);
  dictionary += "), }";
  constexpr std::size_t prefix = 10;  // magic, version, length
  if (size == 0) size = (prefix + dictionary.size() + 1 + 63) / 64 * 64;
  dictionary.resize(size - prefix - 1, ' ');
  dictionary += '\n';
  std::string header(npy_magic);
  header += {'\x01', '\x00', static_cast<char>(dictionary.size() & 0xff),
             static_cast<char>(dictionary.size() >> 8)};
  return header + dictionary;
}

/// Reads the one Python dictionary that a .npy header is; anything else is an Error that names the path.
class NpyHeaderParser {
 public:
  NpyHeaderParser(const std::filesystem::path& path, std::string_view rest) : path_(path), rest_(rest) {}

  NpyHeader parse() {
    std::optional<std::string> descr;
    std::optional<bool> fortran_order;
    std::optional<std::vector<Eigen::Index>> shape;
    expect('{');
    while (!accept('}')) {
      const std::string key = string();
      expect(':');
      if (key == "descr" && !descr) {
        descr = string();
      } else if (key == "fortran_order" && !fortran_order) {
        fortran_order = boolean();
      } else if (key == "shape" && !shape) {
        shape = tuple();
      } else {
        refuse(path_.string(), "the keys descr, fortran_order and shape, each once", key);
      }
      if (accept('}')) break;
      expect(',');
    }
    skip_space();
    if (!rest_.empty()) refuse(path_.string(), "the .npy header to end after }", printable(rest_.front()));
    if (!descr || !fortran_order || !shape)
      refuse(path_.string(), "the keys descr, fortran_order and shape", "a .npy header that lacks one");
    if (*fortran_order) refuse(path_.string(), "C order (numpy.ascontiguousarray makes it)", "Fortran order");
    if (shape->empty() || shape->size() > 4) refuse(path_.string(), "1 to 4 dimensions", shape->size());
    return {*descr, *shape, 0};
  }

 private:
  void skip_space() {
    const auto found = rest_.find_first_not_of(" \t\n");
    rest_.remove_prefix(found == std::string_view::npos ? rest_.size() : found);
  }
  static std::string printable(char c) {
    return c >= ' ' && c <= '~' ? std::string(1, c)
                                : text("byte ", static_cast<int>(static_cast<unsigned char>(c)));
  }
  bool accept(char c) {
    skip_space();
    if (rest_.empty() || rest_.front() != c) return false;
    rest_.remove_prefix(1);
    return true;
  }
  void expect(char c) {
    if (!accept(c))
      refuse(path_.string(), text("'", c, "' in the .npy header"),
             rest_.empty() ? "its end" : printable(rest_.front()));
  }
  std::string string() {
    skip_space();
    const char quote = rest_.empty() ? '\0' : rest_.front();
    const auto end = quote == '\'' || quote == '"' ? rest_.find(quote, 1) : std::string_view::npos;
    if (end == std::string_view::npos) refuse(path_.string(), "a quoted string in the .npy header", "none");
    const std::string value(rest_.substr(1, end - 1));
    for (const char c : value)
      if (c < ' ' || c > '~') refuse(path_.string(), "printable characters in the .npy header", printable(c));
    rest_.remove_prefix(end + 1);
    return value;
  }
  bool boolean() {
    skip_space();
    for (const bool value : {false, true}) {
      const std::string_view name = value ? "True" : "False";
      if (!rest_.starts_with(name)) continue;
      rest_.remove_prefix(name.size());
      return value;
    }
    refuse(path_.string(), "True or False for fortran_order", "neither");
  }
  std::vector<Eigen::Index> tuple() {
    std::vector<Eigen::Index> values;
    expect('(');
    while (!accept(')')) {
      values.push_back(integer());
      if (accept(')')) break;
      expect(',');
    }
    return values;
  }
  Eigen::Index integer() {
    skip_space();
    Eigen::Index value = 0;
    bool any = false;
    for (; !rest_.empty() && rest_.front() >= '0' && rest_.front() <= '9';
         rest_.remove_prefix(1), any = true) {
      const Eigen::Index digit = rest_.front() - '0';
      if (value > (std::numeric_limits<Eigen::Index>::max() - digit) / 10)
        refuse(path_.string(), "extents below 2^63", "a larger one");
      value = 10 * value + digit;
    }
    if (!any) refuse(path_.string(), "a number in the shape", "none");
    return value;
  }

  const std::filesystem::path& path_;
  std::string_view rest_;
};

/// Reads and checks everything before the numbers.
inline NpyHeader read_npy_header(const InputFile& file) {
  const std::string path = file.path().string();
  char prefix[12] = {};
  file.read_first(prefix, 10, "a NumPy .npy file");
  if (std::string_view(prefix, npy_magic.size()) != npy_magic)
    refuse(path, "a NumPy .npy file", "another magic number");
  const int major = prefix[6], minor = prefix[7];
  if (major < 1 || major > 3 || minor != 0)
    refuse(path, ".npy format 1.0, 2.0 or 3.0", text(major, ".", minor));
  const std::size_t start = major == 1 ? 10 : 12;
  if (major > 1) file.read(10, prefix + 10, 2);
  std::size_t size = 0;
  for (std::size_t i = start; i-- > 8;) size = size << 8 | static_cast<unsigned char>(prefix[i]);
  constexpr std::size_t largest = 10'000;  // NumPy's own limit (max_header_size)
  if (size > largest) refuse(path, text("a .npy header of at most ", largest, " bytes"), size);
  std::string dictionary(size, '\0');
  file.read(start, dictionary.data(), size);
  NpyHeader header = NpyHeaderParser(file.path(), dictionary).parse();
  header.data = start + size;
  return header;
}

}  // namespace rbres::RBRES_ABI::detail
