#pragma once

#include <rbres/body/state.hpp>
#include <rbres/core/error.hpp>

namespace rbres::RBRES_ABI::detail {

/// Refuses a state with a number that is not finite, or with a quaternion whose length is off by more than
/// 1e-3.
template <class S>
void check_rigid_state(const RigidState<S>& state) {
  constexpr const char* names[] = {
      "position x",         "position y",         "position z",        "orientation x", "orientation y",
      "orientation z",      "orientation w",      "velocity x",        "velocity y",    "velocity z",
      "angular velocity x", "angular velocity y", "angular velocity z"};
  const auto numbers = state.vector();
  for (int k = 0; k < numbers.size(); ++k) {
    if (!is_finite(numbers(k))) refuse(names[k], "a finite number", numbers(k));
  }
  using std::abs;
  using std::sqrt;
  const S length = sqrt(squared_norm(state.orientation));
  if (!(abs(S(length - S(1))) < as<S>(1e-3)))
    refuse("orientation", "a unit quaternion", Line("one of length ", length));
}

/// Makes a quaternion unit; one that is, but for rounding, keeps its bits.
template <class S>
void make_unit(Quat<S>& q) {
  using std::abs;
  const S off = abs(S(squared_norm(q) - S(1)));
  if (off > S(as<S>(16) * S(Constants<S>::epsilon))) q = normalized(q);
}

}  // namespace rbres::RBRES_ABI::detail
