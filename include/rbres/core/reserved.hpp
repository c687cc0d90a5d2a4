#pragma once

#include <rbres/core/abi.hpp>
#include <vector>

namespace rbres::RBRES_ABI::detail {

/// A vector that is given its capacity once, and whose copies have it too: what is filled in a loop that must
/// not allocate.
template <class T>
class Reserved : public std::vector<T> {
  using Base = std::vector<T>;

 public:
  Reserved() = default;
  Reserved(const Reserved& other) : Base() { *this = other; }
  Reserved& operator=(const Reserved& other) {
    if (this == &other) return *this;
    Base::reserve(other.capacity());
    Base::operator=(other);
    return *this;
  }
};

}  // namespace rbres::RBRES_ABI::detail
