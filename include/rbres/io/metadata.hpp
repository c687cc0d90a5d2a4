#pragma once

#include <cstddef>
#include <limits>
#include <locale>
#include <span>
#include <sstream>
#include <string>
#include <string_view>

#include <Eigen/Core>

#include <rbres/core/error.hpp>
#include <rbres/io/safetensors.hpp>

namespace rbres::RBRES_ABI {

/// Error that names the path and both values when the file's metadata lack one of these or have another: for
/// one's own metadata, that say what a model was made for.
[[gnu::cold]] inline void require_metadata(const SafetensorsReader& file, const Metadata& expected) {
  for (const auto& [key, value] : expected) {
    const auto found = file.metadata().find(key);
    if (found == file.metadata().end() || found->second != value)
      detail::refuse(detail::text(file.path().string(), ": metadata '", key, "'"), "'" + value + "'",
                     found == file.metadata().end() ? "none" : "'" + found->second + "'");
  }
}

namespace detail {

/// The numbers that a file may hold.
struct Bounds {
  double least = -1e30, most = 1e30;
};

[[gnu::cold]] inline void require_within(const std::string& what, double x, Bounds bounds) {
  if (!(x >= bounds.least && x <= bounds.most))
    refuse(what, text("numbers from ", bounds.least, " to ", bounds.most), x);
}
template <class Derived>
void require_within(const std::string& what, const Eigen::DenseBase<Derived>& numbers, Bounds bounds) {
  for (const auto number : numbers.derived().reshaped())
    require_within(what, static_cast<double>(number), bounds);
}

/// Numbers as text that reads back to the same bits, column by column: for the few that stand in a file's
/// metadata, where a tensor would be one too many for PyTorch's load_state_dict.
template <class Derived>
std::string numbers_to_text(const Eigen::DenseBase<Derived>& numbers) {
  std::ostringstream out;
  out.imbue(std::locale::classic());
  out.precision(std::numeric_limits<typename Derived::Scalar>::max_digits10);
  for (Eigen::Index column = 0; column < numbers.cols(); ++column)
    for (Eigen::Index row = 0; row < numbers.rows(); ++row) out << numbers(row, column) << ' ';
  return out.str();
}

/// See numbers_from_metadata(): one function for matrices of all sizes.
template <class T>
[[gnu::cold]] void read_numbers(const SafetensorsReader& file, std::string_view key, std::span<T> numbers,
                                Bounds bounds = {}) {
  const std::string what = text(file.path().string(), ": metadata '", key, "'");
  const std::string expected = text(numbers.size(), " finite numbers");
  const auto found = file.metadata().find(std::string(key));
  if (found == file.metadata().end()) refuse(what, expected, "none");
  std::istringstream in(found->second);
  in.imbue(std::locale::classic());
  for (T& number : numbers)
    if (!(in >> number)) refuse(what, expected, "fewer, or something else");
  if (!(in >> std::ws).eof()) refuse(what, expected, "more");
  for (const T number : numbers) require_within(what, static_cast<double>(number), bounds);
}

/// Reads as many numbers as `numbers` has from the file's metadata; Error when the key is missing or its text
/// holds anything else, or a number out of bounds.
template <class Derived>
void numbers_from_metadata(const SafetensorsReader& file, std::string_view key,
                           Eigen::PlainObjectBase<Derived>& numbers, Bounds bounds = {}) {
  static_assert(Derived::IsVectorAtCompileTime || !Derived::IsRowMajor);
  read_numbers<typename Derived::Scalar>(file, key,
                                         {numbers.data(), static_cast<std::size_t>(numbers.size())}, bounds);
}

}  // namespace detail
}  // namespace rbres::RBRES_ABI
