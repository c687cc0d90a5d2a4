#pragma once

#include <array>
#include <rbres/contact/contact_pair.hpp>
#include <variant>

namespace rbres::RBRES_ABI::detail {

/// A contact point as solvers of islands see it: it leaves its normal at a target speed (m/s) or faster, and
/// obeys Coulomb's law.
template <class S>
struct ContactRow {
  using Scalar = S;
  Candidate who, moved;  ///< as in ContactPair
  MaskOf<S> active;
  S target, friction;
  std::variant<ContactPoint<S, true>, ContactPoint<S, false>> at;  ///< with a plane, or between two bodies

  bool plane() const { return who.first < 0; }
  const std::array<S, 3>& impulse() const {
    return std::visit(
        [](const auto& p) -> auto& { return p.impulse(); }, at);
  }
};

/// Calls f(contact point, first motion, second motion) for a row.
template <class Row, class Motions, class F>
void with_point(Row& row, Motions& motion, const F& f) {
  auto& second = motion[static_cast<std::size_t>(row.who.second)];
  if (row.plane()) {
    f(*std::get_if<0>(&row.at), second, second);
  } else {
    f(*std::get_if<1>(&row.at), motion[static_cast<std::size_t>(row.who.first)], second);
  }
}

}  // namespace rbres::RBRES_ABI::detail
