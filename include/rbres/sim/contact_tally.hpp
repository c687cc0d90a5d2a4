#pragma once

#include <rbres/core/scalar.hpp>

namespace rbres::RBRES_ABI {

/// What happened during some steps, lane by lane.
template <class S>
struct ContactTally {
  CountOf<S> impacts{};   ///< impacts resolved: pairs whose approach was answered by an impulse
  CountOf<S> touching{};  ///< discrete contacts: pairs found touching, summed over steps
  CountOf<S> overruns{};  ///< steps that met the event cap and were finished discretely
};

}  // namespace rbres::RBRES_ABI
