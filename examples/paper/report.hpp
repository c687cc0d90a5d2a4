// Prints the experiment's tables.
#pragma once

#include "measure.hpp"

namespace paper {

/// What arXiv 2407.18798 claims, at 5 s: mean square errors of position (m^2), orientation, velocity
/// ((m/s)^2) and angular velocity ((rad/s)^2).
struct Claim {
  const char* method;
  double value[4];
};
inline constexpr Claim claims[] = {{"residual network", {2.37e-3, 4.62e-4, 1.85e-2, 3.21e-3}},
                                   {"RK4", {3.15e-3, 5.89e-4, 2.41e-2, 4.05e-3}},
                                   {"feed-forward", {5.84e-3, 1.23e-3, 3.76e-2, 7.92e-3}}};
inline constexpr const char* quantities[] = {"position", "orientation", "velocity", "angular_velocity"};

inline void print_row(const std::string& method, const Json& m) {
  std::printf("  %-38s", method.c_str());
  for (const char* q : quantities) std::printf(" %10.3g", m[q].get<double>());
  std::printf(" %9.2f %8.2f %7.3f %7.1f %10.1f\n", m["angle_deg"].get<double>(),
              100 * m["energy"].get<double>(), m["pearson"].get<double>(),
              100 * m["within_half"].get<double>(), m["us_per_scenario"].get<double>());
}

/// The tables: for each world, set and horizon every method beside the predictability floor, the cheapest
/// first.
inline void report(const Plan& plan, Json& results) {
  std::printf(
      "\nMean square errors per component; r and +-0.5 m/s: velocities of bodies in scenarios that had a "
      "contact.\n");
  std::printf("The paper claims, at 5 s:\n");
  for (const Claim& claim : claims) {
    std::printf("  %-38s", claim.method);
    for (const double value : claim.value) std::printf(" %10.3g", value);
    std::printf("\n");
    for (int q = 0; q < 4; ++q) results["paper"][claim.method][quantities[q]] = claim.value[q];
  }
  for (const auto& [label, baselines] : results["baselines"].items()) {
    for (std::size_t h = 0; h < plan.horizons.size(); ++h) {
      const std::string at = std::to_string(h);
      std::printf("\n%s, %g s ahead\n  %-38s %10s %10s %10s %10s %9s %8s %7s %7s %10s\n", label.c_str(),
                  plan.horizons[h], "", "position", "orient.", "velocity", "ang. vel.", "angle deg", "ECE %",
                  "r", "+-0.5 %", "us");
      for (const auto& [method, m] : baselines[at].items()) print_row(method, m);
      for (const Unit& unit : plan.units) {
        if (label != std::string(rbres::name(unit.world)) + "-" + std::string(rbres::name(unit.set)) ||
            unit.horizon != h) {
          continue;
        }
        const std::string part = name(unit, plan);
        print_row(name(unit.architecture) + ", " + name(unit.target) + ", " +
                      std::to_string(unit.protocol.scenarios / 1000) + "k, seed " + std::to_string(unit.seed),
                  results["networks"][part]);
      }
      print_row("(truth, step halved)", results["floor"][label][at]["all"]);
      std::printf("  had a contact:");
      for (const auto& [family, f] : results["floor"][label][at]["families"].items()) {
        std::printf("  %s %.0f %%", family.c_str(), 100 * f["contact_share"].get<double>());
      }
      std::printf("\n");
    }
  }
}

}  // namespace paper
