#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <initializer_list>
#include <iterator>
#include <rbres/core/error.hpp>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

namespace rbres::RBRES_ABI {

/// A list with room for at most `most` elements inside itself, so that it needs no heap. It is used as a
/// std::vector is; what has no room is refused with an Error.
template <class T, std::size_t most>
class FixedList {
 public:
  /// What the standard library asks of a container.
  /// @{
  using value_type = T;
  using iterator = T*;
  using const_iterator = const T*;
  /// @}

  /// No elements.
  constexpr FixedList() = default;
  /// These elements.
  constexpr FixedList(std::initializer_list<T> elements) { assign(elements.begin(), elements.end()); }

  /// How many elements there are, and may be.
  /// @{
  constexpr std::size_t size() const noexcept { return size_; }
  static constexpr std::size_t capacity() noexcept { return most; }
  constexpr bool empty() const noexcept { return size_ == 0; }
  /// @}
  /// The elements.
  /// @{
  constexpr T* data() noexcept { return elements_.data(); }
  constexpr const T* data() const noexcept { return elements_.data(); }
  constexpr T* begin() noexcept { return data(); }
  constexpr const T* begin() const noexcept { return data(); }
  constexpr T* end() noexcept { return data() + size_; }
  constexpr const T* end() const noexcept { return data() + size_; }
  /// @}
  /// Element i, which is not checked.
  /// @{
  constexpr T& operator[](std::size_t i) noexcept { return data()[i]; }
  constexpr const T& operator[](std::size_t i) const noexcept { return data()[i]; }
  /// @}

  /// As of std::vector.
  /// @{
  constexpr void clear() noexcept { size_ = 0; }
  constexpr void reserve(std::size_t size) const { check(size); }
  constexpr void resize(std::size_t size) {
    check(size);
    for (; size_ < size; ++size_) elements_[size_] = T{};
    size_ = size;
  }
  template <std::input_iterator Iterator>
  constexpr void assign(Iterator first, Iterator last) {
    clear();
    for (; first != last; ++first) push_back(*first);
  }
  constexpr void assign(std::size_t size, const T& element) {
    check(size);
    std::fill_n(begin(), size, element);
    size_ = size;
  }
  constexpr void push_back(const T& element) {
    check(size_ + 1);
    elements_[size_++] = element;
  }
  template <class... Values>
  constexpr T& emplace_back(const Values&... values) {
    push_back(T(values...));
    return elements_[size_ - 1];
  }
  constexpr void swap(FixedList& other) noexcept {
    std::swap_ranges(begin(), begin() + std::max(size_, other.size_), other.begin());
    std::swap(size_, other.size_);
  }
  /// @}

 private:
  static constexpr void check(std::size_t size) {
    if (size > most) detail::refuse("elements of a list", detail::Line("at most ", most), size);
  }

  std::array<T, std::max(most, std::size_t{1})> elements_{};  ///< one at least: data() is not null
  std::size_t size_ = 0;
};

namespace detail {
/// A list with room for so many elements, or with std::dynamic_extent a vector.
template <class T, std::size_t most>
using ListOf = std::conditional_t<most == std::dynamic_extent, std::vector<T>, FixedList<T, most>>;
}  // namespace detail

}  // namespace rbres::RBRES_ABI
