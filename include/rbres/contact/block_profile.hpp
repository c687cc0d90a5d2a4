#pragma once

#include <algorithm>
#include <cstddef>
#include <rbres/core/reserved.hpp>
#include <rbres/core/scalar.hpp>
#include <span>

namespace rbres::RBRES_ABI::detail {

/// A symmetric positive definite matrix of 6 x 6 blocks, one row of blocks for each body of an island, stored
/// row by row from its first block that is not zero; its Cholesky factor stays within the same profile. Its
/// type has room for so many bodies and numbers, or is told when the program runs.
template <class S, std::size_t bodies = std::dynamic_extent, std::size_t numbers = std::dynamic_extent>
class BlockProfile {
  static constexpr std::size_t rows = bodies == std::dynamic_extent ? bodies : 6 * bodies;

 public:
  explicit BlockProfile(std::size_t most_bodies, std::size_t most_numbers) : capacity_(most_numbers) {
    first_.reserve(most_bodies);
    start_.reserve(6 * most_bodies);
    numbers_.reserve(most_numbers);
  }

  /// Sets up a matrix in which the row of block i starts at block first[i] <= i. False where factoring it
  /// would take more than `most_products` multiplications.
  bool shape(std::span<const std::size_t> first, std::size_t most_products) {
    first_.assign(first.begin(), first.end());
    start_.clear();
    std::size_t size = 0, products = 0;
    for (std::size_t i = 0; i < first_.size(); ++i) {
      for (std::size_t k = 0; k < 6; ++k) {
        const std::size_t length = 6 * (i - first_[i]) + k + 1;
        start_.push_back(size);
        size += length;
        products += length * length / 2;
        if (products > most_products || size > capacity_) return false;
      }
    }
    numbers_.resize(size);
    return true;
  }
  void clear() { std::fill(numbers_.begin(), numbers_.end(), S(0)); }
  /// Entry (row, column), column <= row, both inside the profile.
  S& operator()(std::size_t row, std::size_t column) { return numbers_[start_[row] + column - begin(row)]; }

  /// Replaces the matrix by its Cholesky factor L; the diagonal holds one over L's.
  void factor() {
    for (std::size_t i = 0; i < start_.size(); ++i) {
      S* row = &numbers_[start_[i]];
      const std::size_t begin_i = begin(i);
      S rest = row[i - begin_i];
      for (std::size_t j = begin_i; j < i; ++j) {
        const S* other = &numbers_[start_[j]];
        const std::size_t begin_j = begin(j), from = std::max(begin_i, begin_j);
        S sum = row[j - begin_i];
        for (std::size_t k = from; k < j; ++k) sum -= row[k - begin_i] * other[k - begin_j];
        row[j - begin_i] = sum * other[j - begin_j];
        rest -= square(row[j - begin_i]);
      }
      row[i - begin_i] = S(1) / root(maximum(rest, S(Constants<S>::tiny)));
    }
  }
  /// Solves L L^T x = b in place.
  void solve(std::span<S> b) const {
    for (std::size_t i = 0; i < start_.size(); ++i) {
      const S* row = &numbers_[start_[i]];
      const std::size_t begin_i = begin(i);
      for (std::size_t j = begin_i; j < i; ++j) b[i] -= row[j - begin_i] * b[j];
      b[i] *= row[i - begin_i];
    }
    for (std::size_t i = start_.size(); i-- > 0;) {
      const S* row = &numbers_[start_[i]];
      const std::size_t begin_i = begin(i);
      b[i] *= row[i - begin_i];
      for (std::size_t j = begin_i; j < i; ++j) b[j] -= row[j - begin_i] * b[i];
    }
  }

 private:
  std::size_t begin(std::size_t row) const { return 6 * first_[row / 6]; }

  std::size_t capacity_;
  Reserved<std::size_t, bodies> first_;
  Reserved<std::size_t, rows> start_;
  Reserved<S, numbers> numbers_;
};

}  // namespace rbres::RBRES_ABI::detail
