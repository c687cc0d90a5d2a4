#pragma once

#include <cmath>
#include <numbers>

namespace rbres {

/// How the learning rate falls from epoch to epoch.
struct Schedule {
  enum class Kind {
    power,   ///< initial (1 + gamma t)^-power at epoch t (arXiv 2407.18798, section 3)
    cosine,  ///< from initial to 0 along half a cosine over all epochs (Loshchilov, Hutter 2017, equation 5)
    constant
  };
  Kind kind = Kind::power;
  double initial = 1e-3;
  double gamma = 0.1;
  double power = 0.75;

  /// The rate in epoch t = 0, 1, ..., epochs - 1.
  double rate(int t, int epochs) const noexcept {
    switch (kind) {
      case Kind::power:
        return initial * std::pow(1 + gamma * t, -power);
      case Kind::cosine:
        return initial * (1 + std::cos(std::numbers::pi * t / epochs)) / 2;
      case Kind::constant:
        break;
    }
    return initial;
  }
};

}  // namespace rbres
