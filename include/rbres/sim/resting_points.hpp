#pragma once

#include <rbres/contact/contact_pair.hpp>

namespace rbres::RBRES_ABI::detail {

/// At which rates (1/s) resting contacts close their gaps and open their overlaps.
template <class S>
struct ClosingRate {
  S in_step;  ///< over a whole step
  S in_part;  ///< where its parts must be short; else 0
  S slack;    ///< overlaps that stay as they are, as a share of the smaller bounding radius

  S largest() const { return maximum(in_step, in_part); }
};

/// Marks the points of a pair that rest: those that are close and slow.
template <class Pair, class Mask>
void mark_resting(Pair& pair, const Mask& running) {
  using S = typename Pair::S;
  pair.any_resting = Mask(false);
  for (std::size_t i = 0; i < pair.manifold.used; ++i) {
    const Mask close = pair.manifold.gap[i] <= pair.near;
    const Mask slow = square(pair.speed[i]) <= square(pair.rest_speed);
    const Mask comes = pair.speed[i] <= S(0);  // impacts are answered: what is left is rounding
    pair.resting[i] = running & ((close & slow) | (pair.touching[i] & comes));
    pair.any_resting = pair.any_resting | pair.resting[i];
  }
}

/// The least speed (m/s) at which a resting point is to leave: gaps close slowly, overlaps open slowly. A
/// step opens them with less energy than a fall so deep gives, however short it is.
template <class Pair, class S>
S closing_speed(const Pair& pair, const typename Pair::Contact& contact, std::size_t i,
                const ClosingRate<S>& pull) {
  const S depth = maximum(S(-contact.gap[i] - pull.slack * pair.size), S(0)), share = depth / pair.size;
  const S fastest = as<S>(0.3) * pair.speed_scale * positive_root(S(share + S(Constants<S>::tiny)));
  const S opens = maximum(minimum(S(pull.in_step * depth), fastest), S(pull.in_part * depth));
  return select(contact.gap[i] > S(0), S(-pull.largest() * contact.gap[i]), opens);
}

}  // namespace rbres::RBRES_ABI::detail
