#pragma once

#include <algorithm>
#include <cstddef>
#include <rbres/core/reserved.hpp>
#include <rbres/core/scalar.hpp>
#include <span>
#include <type_traits>
#include <utility>

namespace rbres::RBRES_ABI::detail {

/// A matrix of 6 x 6 blocks, one row and column of blocks for each body of an island, that need not be
/// symmetric; plain scalars only. Its type has room for so many bodies, or is told when the program runs.
template <class S, std::size_t bodies = std::dynamic_extent>
class BlockSquare {
  static constexpr std::size_t rows = bodies == std::dynamic_extent ? bodies : 6 * bodies;

 public:
  explicit BlockSquare(std::size_t most_bodies) {
    swapped_.reserve(6 * most_bodies);
    weight_.reserve(6 * most_bodies);
    numbers_.reserve(36 * most_bodies * most_bodies);
  }

  /// Sets up a matrix of so many bodies. False where there is no room for it.
  bool shape(std::size_t size) {
    size_ = 6 * size;
    if (size_ * size_ > numbers_.capacity()) return false;
    swapped_.resize(size_);
    weight_.resize(size_);
    numbers_.resize(size_ * size_);
    return true;
  }
  void clear() { std::fill(numbers_.begin(), numbers_.end(), S(0)); }
  S& operator()(std::size_t row, std::size_t column) { return numbers_[row * size_ + column]; }

  /// Weighs the rows, whose units differ, by the diagonal as it is now: pivots are chosen by them.
  void weigh() {
    for (std::size_t i = 0; i < size_; ++i) weight_[i] = inverse((*this)(i, i));
  }

  /// Replaces the matrix by its factors L and U, rows swapped for the largest pivots; the diagonal holds one
  /// over U's.
  void factor() {
    with_size([&](auto n) {
      for (std::size_t k = 0; k < n; ++k) {
        S* const at = &numbers_[k * n];
        std::size_t most = k;
        S largest = weight_[k] * square(at[k]);
        for (std::size_t i = k + 1; i < n; ++i) {
          const S size = weight_[i] * square(numbers_[i * n + k]);
          if (largest < size) largest = size, most = i;
        }
        swapped_[k] = most;
        if (most != k) {
          std::swap_ranges(at, at + n, &numbers_[most * n]);
          std::swap(weight_[k], weight_[most]);
        }
        at[k] = inverse(at[k]);
        for (std::size_t i = k + 1; i < n; ++i) {
          S* const row = &numbers_[i * n];
          if (row[k] == S(0)) continue;
          row[k] *= at[k];
          for (std::size_t j = k + 1; j < n; ++j) row[j] -= row[k] * at[j];
        }
      }
    });
  }
  /// Solves L U x = b in place.
  void solve(std::span<S> b) const {
    with_size([&](auto n) {
      for (std::size_t k = 0; k < n; ++k) std::swap(b[k], b[swapped_[k]]);
      for (std::size_t i = 0; i < n; ++i) {
        const S* row = &numbers_[i * n];
        for (std::size_t j = 0; j < i; ++j) b[i] -= row[j] * b[j];
      }
      for (std::size_t i = n; i-- > 0;) {
        const S* row = &numbers_[i * n];
        for (std::size_t j = i + 1; j < n; ++j) b[i] -= row[j] * b[j];
        b[i] *= row[i];
      }
    });
  }

 private:
  /// Calls f(size): most islands have one or two bodies, and loops of a known length are faster.
  template <class F>
  void with_size(const F& f) const {
    if (size_ == 6) return f(std::integral_constant<std::size_t, 6>{});
    if (size_ == 12) return f(std::integral_constant<std::size_t, 12>{});
    f(size_);
  }

  std::size_t size_ = 0;
  Reserved<std::size_t, rows> swapped_;  ///< with which row each pivot's row was swapped
  Reserved<S, rows> weight_;             ///< of each row, one over the square of its unit
  Reserved<S, bodies == std::dynamic_extent ? bodies : rows * rows> numbers_;
};

}  // namespace rbres::RBRES_ABI::detail
