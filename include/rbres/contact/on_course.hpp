#pragma once

#include <rbres/contact/contact_pair.hpp>
#include <rbres/core/reserved.hpp>

namespace rbres::RBRES_ABI::detail {

/// The bodies of a crowd whose motion to the end of a step is known, because no impact has changed it since
/// it was found: a part of the step that an impact has ended goes on for them as it was. So an impact costs
/// as much as the bodies that it reaches, however many others there are.
template <class System>
class OnCourse {
  using Bodies = BodyIndices<System>;

 public:
  static constexpr bool possible = may_be_crowd<System>;

  explicit OnCourse(const System& system) {
    if constexpr (possible) {
      has_ = per_body<bool>(system);
      has_.fill(false);
      others_.reserve(static_cast<std::size_t>(system.size()));
    }
  }

  /// None of `bodies`.
  void clear(const Bodies& bodies) {
    choose(bodies, [](int) { return false; });
  }
  /// Those that stay(i).
  template <class Stay>
  void choose(const Bodies& bodies, const Stay& stay) {
    if constexpr (possible) {
      others_.clear();
      for (const int i : bodies) {
        has_[index(i)] = stay(i);
        if (!has_[index(i)]) others_.push_back(i);
      }
    } else {
      others_ = bodies;
    }
  }

  /// Takes the bodies of a pair out, which others() knows after the next choose().
  template <class Pair>
  void drop(const Pair& pair) {
    has_[index(pair.who.second)] = false;
    if (!pair.plane()) has_[index(pair.who.first)] = false;
  }

  /// Whether body i is on course.
  bool has(int i) const {
    if constexpr (possible) return has_[index(i)];
    return false;
  }
  /// Whether both bodies of a pair are.
  template <class Pair>
  bool has(const Pair& pair) const {
    return has(pair.who.second) && (pair.plane() || has(pair.who.first));
  }
  /// The bodies that are not.
  Bodies others() const {
    if constexpr (possible) {
      return {others_.data(), others_.size()};
    } else {
      return others_;
    }
  }

 private:
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }

  PerBody<bool, System::bodies> has_{};
  std::conditional_t<possible, Reserved<int, std::dynamic_extent>, Bodies> others_{};
};

}  // namespace rbres::RBRES_ABI::detail
