#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <memory>
#include <rbres/core/abi.hpp>
#include <rbres/core/scalar.hpp>
#include <span>
#include <type_traits>
#include <vector>

namespace rbres::RBRES_ABI {

/// In place of a number of bodies: known when the program runs, not when it is compiled.
inline constexpr int dynamic = -1;

namespace detail {

/// An array whose length is given when it is made. Unlike std::vector it holds bool as bool.
template <class T>
class HeapArray {
 public:
  HeapArray() = default;
  explicit HeapArray(std::size_t size) : data_(std::make_unique<T[]>(size)), size_(size) {}
  HeapArray(const HeapArray& other) { *this = other; }
  HeapArray& operator=(const HeapArray& other) {
    if (size_ != other.size_) {
      data_ = std::make_unique<T[]>(other.size_);
      size_ = other.size_;
    }
    std::copy(other.begin(), other.end(), begin());
    return *this;
  }

  std::size_t size() const { return size_; }
  T& operator[](std::size_t i) { return data_[i]; }
  const T& operator[](std::size_t i) const { return data_[i]; }
  T* begin() { return data_.get(); }
  T* end() { return data_.get() + size_; }
  const T* begin() const { return data_.get(); }
  const T* end() const { return data_.get() + size_; }
  void fill(const T& value) { std::fill(begin(), end(), value); }

 private:
  std::unique_ptr<T[]> data_;
  std::size_t size_ = 0;
};

template <class T, int N>
struct PerBodyOf {
  using type = std::array<T, std::size_t(N)>;
};
template <class T>
struct PerBodyOf<T, dynamic> {
  using type = HeapArray<T>;
};
/// A T for each of N bodies.
template <class T, int N>
using PerBody = typename PerBodyOf<T, N>::type;

/// The same, as a user gives and reads it.
template <class T, int N>
using BodyList =
    std::conditional_t<N == dynamic, std::vector<T>, std::array<T, std::size_t(N == dynamic ? 1 : N)>>;

/// Counts bodies.
struct BodyCounter {
  int i;
  constexpr int operator*() const { return i; }
  constexpr BodyCounter& operator++() {
    ++i;
    return *this;
  }
  friend constexpr bool operator==(const BodyCounter&, const BodyCounter&) = default;
};
/// The indices of all N bodies.
template <int N>
struct AllBodies {
  static constexpr BodyCounter begin() { return {0}; }
  static constexpr BodyCounter end() { return {N}; }
};
template <>
struct AllBodies<dynamic> {
  int count;
  constexpr BodyCounter begin() const { return {0}; }
  constexpr BodyCounter end() const { return {count}; }
};
/// The indices of all bodies of a system.
template <class System>
AllBodies<System::bodies> all_bodies(const System& system) {
  if constexpr (System::bodies == dynamic) {
    return {system.size()};
  } else {
    return {};
  }
}

/// Whether bodies may take a step in groups, each at its own time: lanes would be grouped differently.
template <class System>
constexpr bool has_groups = System::bodies != 1 && !Packed<typename System::Scalar>;
/// The indices of the bodies that something is done with, in order: some, or all where there are no groups of
/// a fixed number.
template <class System>
using BodyIndices = std::conditional_t<has_groups<System> || System::bodies == dynamic, std::span<const int>,
                                       AllBodies<System::bodies>>;

/// One for each body of a system.
template <class T, class System>
PerBody<T, System::bodies> per_body(const System& system) {
  if constexpr (System::bodies == dynamic) {
    return PerBody<T, dynamic>(static_cast<std::size_t>(system.size()));
  } else {
    return {};
  }
}

}  // namespace detail
}  // namespace rbres::RBRES_ABI
