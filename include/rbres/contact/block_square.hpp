#pragma once

#include <algorithm>
#include <cstddef>
#include <rbres/core/reserved.hpp>
#include <rbres/core/scalar.hpp>
#include <span>
#include <type_traits>
#include <utility>

namespace rbres::RBRES_ABI::detail {

/// Gaussian elimination in place: n equations of `width` > n numbers each, of which number n is the right
/// side and those behind it fill up registers. Rows are swapped for the largest pivots by their `weight`, one
/// over the square of a row's unit. Writes the solution to x.
template <class S, class Size, class Width>
void eliminate(Size n, Width width, S* numbers, S* weight, S* x) {
  for (std::size_t k = 0; k < n; ++k) {
    S* const at = numbers + k * width;
    std::size_t most = k;
    S largest = weight[k] * square(at[k]);
    for (std::size_t i = k + 1; i < n; ++i) {
      const S size = weight[i] * square(numbers[i * width + k]);
      if (largest < size) largest = size, most = i;
    }
    if (most != k) {
      std::swap_ranges(at, at + width, numbers + most * width);
      std::swap(weight[k], weight[most]);
    }
    const S over = inverse(at[k]);
    for (std::size_t i = k + 1; i < n; ++i) {
      S* const row = numbers + i * width;
      if (row[k] == S(0)) continue;
      const S factor = row[k] * over;
      for (std::size_t part = k / 8; part < width / 8; ++part) {  // whole registers
        for (std::size_t j = 8 * part; j < 8 * part + 8; ++j) row[j] -= factor * at[j];
      }
    }
    at[k] = over;
  }
  for (std::size_t i = n; i-- > 0;) {
    const S* const row = numbers + i * width;
    x[i] = row[n];
    for (std::size_t j = i + 1; j < n; ++j) x[i] -= row[j] * x[j];
    x[i] *= row[i];
  }
}

/// The width of so many equations there.
constexpr std::size_t elimination_width(std::size_t equations) { return (equations + 8) / 8 * 8; }

/// Linear equations whose matrix is of 6 x 6 blocks, one row and column of blocks for each body of an island,
/// and need not be symmetric; plain scalars only. Its type has room for so many bodies, or is told when the
/// program runs.
template <class S, std::size_t bodies = std::dynamic_extent>
class BlockSquare {
  static constexpr std::size_t rows = bodies == std::dynamic_extent ? bodies : 6 * bodies;

 public:
  explicit BlockSquare(std::size_t most_bodies) {
    weight_.reserve(6 * most_bodies);
    numbers_.reserve(6 * most_bodies * elimination_width(6 * most_bodies));
  }

  /// Sets up a matrix of so many bodies. False where there is no room for it.
  bool shape(std::size_t size) {
    size_ = 6 * size;
    width_ = elimination_width(size_);
    if (size_ * width_ > numbers_.capacity()) return false;
    weight_.resize(size_);
    numbers_.resize(size_ * width_);
    return true;
  }
  void clear() { std::fill(numbers_.begin(), numbers_.end(), S(0)); }
  S& operator()(std::size_t row, std::size_t column) { return numbers_[row * width_ + column]; }

  /// Weighs the rows, whose units differ, by the diagonal as it is now: pivots are chosen by them.
  void weigh() {
    for (std::size_t i = 0; i < size_; ++i) weight_[i] = inverse((*this)(i, i));
  }

  /// Replaces b by the solution. The matrix is lost.
  void solve(std::span<S> b) {
    for (std::size_t i = 0; i < size_; ++i) (*this)(i, size_) = b[i];
    if (size_ == 12) {  // many islands have two bodies, and loops of a known length are faster
      constexpr std::size_t n = 12;
      eliminate(std::integral_constant<std::size_t, n>(),
                std::integral_constant<std::size_t, elimination_width(n)>(), numbers_.data(), weight_.data(),
                b.data());
    } else {
      eliminate(size_, width_, numbers_.data(), weight_.data(), b.data());
    }
  }

 private:
  std::size_t size_ = 0, width_ = 0;
  Reserved<S, rows> weight_;  ///< of each row, one over the square of its unit
  Reserved<S, bodies == std::dynamic_extent ? bodies : rows * elimination_width(rows)> numbers_;
};

}  // namespace rbres::RBRES_ABI::detail
