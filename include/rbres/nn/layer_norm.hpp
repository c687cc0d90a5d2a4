#pragma once

#include <rbres/nn/linear.hpp>

#include <cmath>

/// @file
/// What a LayerNorm needs, sample by sample. Weights and biases stand one after the other, each filled up
/// with zeros to whole panels.
namespace rbres::RBRES_ABI::detail {

/// The first `count` lanes of a register; those beyond hold nothing and become zero.
template <class T>
[[gnu::always_inline]] inline Simd<T> first_lanes(Simd<T> x, int count) noexcept {
  for (int i = std::max(count, 0); i < simd_width<T>; ++i) x[static_cast<std::size_t>(i)] = T{};
  return x;
}

template <class T>
T sum_of_lanes(const Simd<T>& x) noexcept {
  T sum{};
  for (int i = 0; i < simd_width<T>; ++i) sum += x[static_cast<std::size_t>(i)];
  return sum;
}

/// x -> (x - mean) / sqrt(variance + 1e-5) for one column of `size` numbers.
template <class T>
class Standard {
 public:
  Standard(int size, Panels<const T> x, std::ptrdiff_t column) noexcept
      : size_(size), x_(x), column_(column) {
    mean_ = mean_of([](Simd<T> value, int) { return value; });
    const T variance = mean_of([this](Simd<T> value, int) { return (value - mean_) * (value - mean_); });
    scale_ = 1 / std::sqrt(variance + T(1e-5));
  }

  T scale() const noexcept { return scale_; }
  [[gnu::always_inline]] Simd<T> at(int lane) const noexcept {
    return first_lanes<T>((load(x_.at(lane, column_)) - mean_) * scale_, size_ - lane);
  }
  /// The mean of f(x, lane) over the features.
  template <class F>
  T mean_of(const F& f) const noexcept {
    Simd<T> sum{};
    for (int lane = 0; lane < size_; lane += simd_width<T>)
      sum += first_lanes<T>(f(load(x_.at(lane, column_)), lane), size_ - lane);
    return sum_of_lanes<T>(sum) / static_cast<T>(size_);
  }

 private:
  int size_;
  Panels<const T> x_;
  std::ptrdiff_t column_;
  T mean_{}, scale_{};
};

/// out = chain(norm(in))
template <class Chain, bool Recorded, class T, class W>
void norm(int size, int count, const W* weights, Panels<T> in, Panels<T> out, Panels<T> slope) noexcept {
  const W* bias = weights + padded<T>(size);
  for (int c = 0; c < count; ++c) {
    const Standard<T> standard(size, {in.data, in.columns}, c);
    for (int lane = 0; lane < padded<T>(size); lane += simd_width<T>) {
      const Simd<T> z = standard.at(lane) * load(weights + lane) + load(bias + lane);
      store(out.at(lane, c), apply<Chain, Recorded>(z, slope.at(lane, c)));
    }
  }
}

/// finish(0, lane, z') of one sample x whose tangent is `in`.
template <class T, class W, class Finish>
void norm_tangent(int size, const W* weights, Panels<const T> x, const T* in, const Finish& finish) noexcept {
  const Standard<T> standard(size, x, 0);
  const T mean = standard.mean_of([&](Simd<T>, int lane) { return load(in + lane); });
  const T along = standard.mean_of([&](Simd<T>, int lane) { return load(in + lane) * standard.at(lane); });
  for (int lane = 0; lane < padded<T>(size); lane += simd_width<T>)
    finish(0, lane,
           load(weights + lane) * standard.scale() * (load(in + lane) - mean - along * standard.at(lane)));
}

/// finish(c, lane, gradient by x) from the gradient by z.
template <class T, class W, class Finish>
void norm_backward(int size, int count, const W* weights, Panels<T> x, Panels<T> gradient,
                   const Finish& finish) noexcept {
  for (int c = 0; c < count; ++c) {
    const Standard<T> standard(size, {x.data, x.columns}, c);
    const auto weighted = [&](int lane) { return load(gradient.at(lane, c)) * load(weights + lane); };
    const T mean = standard.mean_of([&](Simd<T>, int lane) { return weighted(lane); });
    const T along = standard.mean_of([&](Simd<T>, int lane) { return weighted(lane) * standard.at(lane); });
    for (int lane = 0; lane < padded<T>(size); lane += simd_width<T>)
      finish(c, lane,
             first_lanes<T>(standard.scale() * (weighted(lane) - mean - along * standard.at(lane)),
                            size - lane));
  }
}

/// The gradients by weights and biases, summed over all samples: sink(place, g, false) for each register,
/// counted from the first weight at `offset`. `sums` has twice as many numbers as there are weights.
template <class T, class Sink>
void norm_gradient(int size, int count, Panels<const T> x, Panels<const T> gradient, std::size_t offset,
                   T* sums, const Sink& sink) {
  const int weights = padded<T>(size);
  std::fill_n(sums, 2 * weights, T{});
  for (int c = 0; c < count; ++c) {
    const Standard<T> standard(size, x, c);
    for (int lane = 0; lane < weights; lane += simd_width<T>) {
      const Simd<T> g = load(gradient.at(lane, c));
      store(sums + lane, load(sums + lane) + g * standard.at(lane));
      store(sums + weights + lane, load(sums + weights + lane) + g);
    }
  }
  for (int lane = 0; lane < 2 * weights; lane += simd_width<T>)
    sink(offset + static_cast<std::size_t>(lane), load(sums + lane), false);
}

}  // namespace rbres::RBRES_ABI::detail
