#pragma once

#include <rbres/core/error.hpp>
#include <rbres/core/scalar.hpp>

namespace rbres::RBRES_ABI {

/// The largest numbers of a body, and, as their inverses, the smallest: what contacts make of them, products
/// of three of their squares and inverses, overflows nowhere.
template <class S>
struct BodyLimits {
  /// Whether S computes in float.
  static constexpr bool single = std::is_same_v<typename Constants<S>::Real, float>;
  static constexpr double length = single ? 1e4 : 1e15;   ///< m
  static constexpr double mass = single ? 1e12 : 1e40;    ///< kg
  static constexpr double moment = single ? 1e10 : 1e60;  ///< kg m^2
  static constexpr double friction = 1e6;                 ///< from 0
};

namespace detail {

template <class S>
void check_within(std::string_view what, const S& found, double least, double most, const char* unit) {
  if (!(found >= as<S>(least) && found <= as<S>(most)))
    refuse(what, Line("from ", least, " to ", most, unit), found);
}

/// Refuses what is no length of a body.
template <class S>
void check_length(std::string_view what, const S& length) {
  if (!(length > S(0)) || !is_finite(length)) refuse(what, "a positive length", length);
  check_within(what, length, 1 / BodyLimits<S>::length, BodyLimits<S>::length, " m");
}

}  // namespace detail
}  // namespace rbres::RBRES_ABI
