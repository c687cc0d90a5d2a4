#pragma once

#include <algorithm>
#include <rbres/contact/covered.hpp>
#include <rbres/contact/detect.hpp>
#include <rbres/contact/near_pairs.hpp>

namespace rbres::RBRES_ABI {

/// Where two bodies, or a plane and a body, touch: up to P points under one normal; of compounds, where two
/// of their parts do. In lanes it is there
/// where it touches in at least one of them; the points' gaps say in which.
template <class S, int P>
class Contact {
 public:
  /// A point of the two surfaces.
  struct Point {
    Vec3<S> position;  ///< halfway between the two surfaces; with a plane on the body's; world frame, m
    S gap;             ///< signed distance of the surfaces along the normal, m; negative: they overlap
  };

  int first = 0;        ///< index of a body; -1 - p for plane p of System::planes()
  int second = 0;       ///< index of a body, larger than first
  int first_part = 0;   ///< which part of the first body it is that touches, where that is a Compound; else 0
  int second_part = 0;  ///< the same of the second body
  Vec3<S> normal;       ///< unit, from the first surface to the second, world frame
  S gap;                ///< the least of the points', m

  /// Whether a body touches a plane, and which one.
  bool with_plane() const noexcept { return first < 0; }
  /// The number of that plane among System::planes().
  int plane() const noexcept { return -1 - first; }
  /// One or more: those whose gap is within the margin, in lanes in at least one of them.
  std::span<const Point> points() const noexcept { return {points_.data(), count_}; }

 private:
  template <class>
  friend class Contacts;

  std::array<Point, std::size_t(P)> points_;
  std::size_t count_ = 0;
};

/// The contacts of a state, each found when a loop comes to it: see contacts().
template <class System>
class Contacts {
  using S = typename System::Scalar;
  using Shape = typename System::Shape;
  using State = typename System::State;
  /// Balls that just touch stay in, whatever their rounding.
  struct Reach {
    const System* system;
    S margin;
    S operator()(int i) const { return as<S>(1.001) * (*system)[i].bounding_radius() + margin; }
  };
  using NearPairs = decltype(detail::near_pairs(std::declval<const System&>(), std::declval<const State&>(),
                                                std::declval<Reach>()));

 public:
  /// A Contact with room for all points that a pair may have.
  using value_type = Contact<S, std::max(PairManifold<S, Shape>::points, PlaneManifold<S, Shape>::points)>;

  /// See contacts().
  Contacts(const System& system, const State& state, const S& margin) noexcept
      : system_(&system),
        state_(&state),
        margin_(margin),
        pairs_(detail::near_pairs(system, state, Reach{&system, maximum(margin, S(0))})) {}

  /// Finds the next contact as it is moved on; for one pass.
  class Iterator {
   public:
    /// What the standard library asks of an iterator.
    /// @{
    using iterator_concept = std::input_iterator_tag;
    using value_type = Contacts::value_type;
    using difference_type = std::ptrdiff_t;
    /// @}

    /// At the first contact.
    explicit Iterator(const Contacts& contacts) noexcept
        : contacts_(&contacts), pair_(contacts.pairs_.begin()) {
      skip_apart();
    }
    /// The contact, which stays as it is until the iterator moves.
    /// @{
    const value_type& operator*() const noexcept { return contact_; }
    const value_type* operator->() const noexcept { return &contact_; }
    /// @}
    /// On to the next contact.
    /// @{
    Iterator& operator++() noexcept {
      ++parts_;
      skip_apart();
      return *this;
    }
    void operator++(int) noexcept { ++*this; }
    /// @}
    /// Whether there are no more contacts.
    friend bool operator==(const Iterator& i, std::default_sentinel_t end) noexcept { return i.pair_ == end; }

   private:
    /// On to the first pair, from this one on, that has a point.
    void skip_apart() noexcept {
      for (; !(pair_ == std::default_sentinel); ++pair_, parts_ = 0) {
        const Candidate who = (*pair_).who;
        const std::size_t count = detail::part_pairs(*contacts_->system_, who);
        for (; parts_ < count; ++parts_) {
          if (contacts_->find(who, parts_, contact_)) return;
        }
      }
    }

    const Contacts* contacts_;
    typename NearPairs::Iterator pair_;
    std::size_t parts_ = 0;  ///< of the pair, see detail::part_pair()
    value_type contact_;
  };

  /// The first contact.
  Iterator begin() const noexcept { return Iterator(*this); }
  /// Behind the last contact.
  std::default_sentinel_t end() const noexcept { return {}; }

 private:
  /// The points of a pair's parts within the margin. False where there are none.
  bool find(const Candidate& who, std::size_t number, value_type& contact) const noexcept {
    const auto parts = detail::part_pair(*system_, who, number);
    if (!detail::parts_near(*system_, *state_, who, parts, maximum(margin_, S(0)))) return false;
    contact.first = who.first;
    contact.second = who.second;
    contact.first_part = parts.first;
    contact.second_part = parts.second;
    contact.count_ = 0;
    detail::with_part_manifold(
        *system_, *state_, who.first, who.second, parts, [&](const auto& manifold, auto) {
          if (detail::meets_covered(*system_, *state_, who, parts, manifold, margin_)) return;
          contact.normal = manifold.normal;
          contact.gap = S(manifold.none);
          detail::each_point(manifold, [&](int, const Vec3<S>& position, const S& gap) {
            const S there = select(is_finite(gap), gap, S(manifold.none));  // not of bodies at infinity
            if (!any(there <= margin_)) return;
            contact.points_[contact.count_++] = {position, there};
            contact.gap = minimum(contact.gap, there);
          });
        });
    return contact.count_ > 0;
  }

  const System* system_;
  const State* state_;
  S margin_;
  NearPairs pairs_;
};

/// Where the bodies of a state touch one another and the planes:
///
///     for (const auto& contact : contacts(system, state))
///       for (const auto& point : contact.points()) draw(point.position, contact.normal);
///
/// A pair of bodies, or of a plane and a body, is a Contact where one of its points has a gap of `margin` (m)
/// at most; of compounds, each pair of parts. Bodies at rest stand a rounding error above or in what they
/// rest on: give them a margin, 1e-6 m, say. With a margin boxes need not have a point where only their edges
/// or corners are within it; where they overlap they have. Planes come first, then bodies, in order of
/// (first, second). A body whose position is not finite touches nothing.
///
/// Contacts are found while the loop goes; nothing allocates, and nothing throws but an Error where a state
/// has another number of bodies than a system of dynamic size. All pairs' bounding balls are compared.
/// `system` and `state` must outlive the loop.
template <class System>
Contacts<System> contacts(
    const System& system, const typename System::State& state,
    const typename System::Scalar& margin = typename System::Scalar(0)) noexcept(System::bodies != dynamic) {
  detail::check_size(system, state);
  return {system, state, margin};
}
template <class System>
void contacts(const System&&, const typename System::State&,
              const typename System::Scalar& = typename System::Scalar(0)) = delete;
template <class System>
void contacts(const System&, const typename System::State&&,
              const typename System::Scalar& = typename System::Scalar(0)) = delete;

}  // namespace rbres::RBRES_ABI
