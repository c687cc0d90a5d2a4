#pragma once

#include <iterator>
#include <rbres/core/reserved.hpp>

namespace rbres::RBRES_ABI::detail {

/// A list that is renewed again and again and keeps most of its elements: those stay where they are in memory
/// while others come and go between them.
template <class T>
class Pool {
  template <class List, class Element>
  class Iterator {
   public:
    using iterator_category = std::forward_iterator_tag;
    using value_type = T;
    using difference_type = std::ptrdiff_t;
    using pointer = Element*;
    using reference = Element&;

    Iterator() = default;
    Iterator(List* list, std::size_t at) : list_(list), at_(at) {}
    reference operator*() const { return (*list_)[at_]; }
    pointer operator->() const { return &**this; }
    Iterator& operator++() {
      ++at_;
      return *this;
    }
    Iterator operator++(int) {
      const Iterator before = *this;
      ++at_;
      return before;
    }
    friend bool operator==(const Iterator& a, const Iterator& b) { return a.at_ == b.at_; }

   private:
    List* list_ = nullptr;
    std::size_t at_ = 0;
  };

 public:
  using value_type = T;

  void reserve(std::size_t most) {
    room_.reserve(most);
    for (auto* places : {&order_, &before_, &free_}) places->reserve(most);
  }
  std::size_t size() const { return order_.size(); }
  bool empty() const { return order_.empty(); }
  T& operator[](std::size_t k) { return room_[order_[k]]; }
  const T& operator[](std::size_t k) const { return room_[order_[k]]; }
  auto begin() { return Iterator<Pool, T>(this, 0); }
  auto end() { return Iterator<Pool, T>(this, size()); }
  auto begin() const { return Iterator<const Pool, const T>(this, 0); }
  auto end() const { return Iterator<const Pool, const T>(this, size()); }
  /// Takes the last elements out, until no more than so many are left.
  void resize(std::size_t most) {
    for (; size() > most; order_.pop_back()) free_.push_back(order_.back());
  }

  /// Empties the list. The elements that it had are left(), the first of them next(), until each is kept as
  /// the last of the new list or dropped.
  void renew() {
    order_.swap(before_);
    order_.clear();
    at_ = 0;
  }
  bool left() const { return at_ < before_.size(); }
  T& next() { return room_[before_[at_]]; }
  T& keep_next() {
    order_.push_back(before_[at_++]);
    return room_[order_.back()];
  }
  void drop_next() { free_.push_back(before_[at_++]); }
  /// Adds an element.
  template <class... From>
  T& emplace_back(const From&... from) {
    if (free_.empty()) {
      order_.push_back(room_.size());
      return room_.emplace_back(from...);
    }
    order_.push_back(free_.back());
    free_.pop_back();
    return room_[order_.back()] = T(from...);
  }

 private:
  Reserved<T> room_;
  Reserved<std::size_t> order_, before_, free_;  ///< places in the room
  std::size_t at_ = 0;                           ///< which of those before is next
};

}  // namespace rbres::RBRES_ABI::detail
