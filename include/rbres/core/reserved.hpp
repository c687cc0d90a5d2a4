#pragma once

#include <algorithm>
#include <cstddef>
#include <rbres/core/abi.hpp>
#include <rbres/core/fixed_list.hpp>
#include <span>
#include <vector>

namespace rbres::RBRES_ABI::detail {

/// What is filled in a loop that must not allocate: a list whose room its type knows.
template <class T, std::size_t most = std::dynamic_extent>
class Reserved : public FixedList<T, most> {};

/// A vector that is given its capacity once, and whose copies have it too.
template <class T>
class Reserved<T, std::dynamic_extent> : public std::vector<T> {
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

/// Takes the elements out of a list of which is(element).
template <class List, class Is>
void remove_where(List& list, const Is& is) {
  const auto end = std::remove_if(list.begin(), list.end(), is);
  list.resize(static_cast<std::size_t>(end - list.begin()));
}

}  // namespace rbres::RBRES_ABI::detail
