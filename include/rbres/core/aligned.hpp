#pragma once

#include <algorithm>
#include <cstddef>
#include <new>
#include <rbres/core/abi.hpp>
#include <type_traits>
#include <utility>

namespace rbres::RBRES_ABI {

/// A flat block of numbers on the heap, aligned to a cache line; a copy is a copy. The size is fixed when it
/// is built.
template <class T>
class AlignedBuffer {
  static_assert(std::is_trivially_copyable_v<T>, "AlignedBuffer holds plain numbers");

 public:
  /// Of data(), in bytes.
  static constexpr std::size_t alignment = 64;

  /// No numbers.
  AlignedBuffer() noexcept = default;
  /// So many numbers, all zero.
  explicit AlignedBuffer(std::size_t size) : data_(allocate(size)), size_(size) {
    std::fill_n(data_, size, T{});
  }
  /// A copy has a block of its own; what was moved from holds no numbers.
  /// @{
  AlignedBuffer(const AlignedBuffer& other) : data_(allocate(other.size_)), size_(other.size_) {
    std::copy_n(other.data_, size_, data_);
  }
  AlignedBuffer(AlignedBuffer&& other) noexcept
      : data_(std::exchange(other.data_, nullptr)), size_(std::exchange(other.size_, 0)) {}
  /// @}
  /// Takes over the numbers of a copy.
  AlignedBuffer& operator=(AlignedBuffer other) noexcept {
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
    return *this;
  }
  ~AlignedBuffer() {
    if (data_ != nullptr) ::operator delete (data_, std::align_val_t{alignment});
  }

  /// The first number; null where there are none.
  /// @{
  T* data() noexcept { return data_; }
  const T* data() const noexcept { return data_; }
  /// @}
  /// How many numbers there are.
  std::size_t size() const noexcept { return size_; }
  /// Number i, which is not checked.
  /// @{
  T& operator[](std::size_t i) noexcept { return data_[i]; }
  const T& operator[](std::size_t i) const noexcept { return data_[i]; }
  /// @}
  /// For loops over all numbers.
  /// @{
  T* begin() noexcept { return data_; }
  T* end() noexcept { return data_ + size_; }
  const T* begin() const noexcept { return data_; }
  const T* end() const noexcept { return data_ + size_; }
  /// @}

 private:
  static T* allocate(std::size_t size) {
    return size == 0 ? nullptr
                     : static_cast<T*>(::operator new (size * sizeof(T), std::align_val_t{alignment}));
  }

  T* data_ = nullptr;
  std::size_t size_ = 0;
};

}  // namespace rbres::RBRES_ABI
