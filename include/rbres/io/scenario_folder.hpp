#pragma once

#include <string>
#include <vector>

#include <rbres/io/dataset_folder.hpp>
#include <rbres/paper/scenario_data.hpp>

/// @file
/// What the folder of a data set of scenarios says and holds.
namespace rbres::RBRES_ABI::detail {

inline constexpr DatasetKind scenario_kind{"scenarios", 2,
                                           ": rbres 0.1.0 before digests made it, and truth of boxes that "
                                           "hit planes was wrong then; make it anew in "
                                           "another folder"};

/// The file of truth at a horizon.
inline std::string state_file(double horizon) {
  return "state_" + Json(horizon).dump() + "s.npy";  // not by locale, as streams would
}

/// What a data set depends on, and nothing else.
template <BodySet Set>
Json dataset_setting(const ScenarioSampler<Set>& sampler, Eigen::Index count,
                     const std::vector<double>& horizons, const TruthOptions& options) {
  const bool continuous = SimulationOptions{}.contacts == ContactMode::continuous;
  return {{"format", scenario_kind.format},
          {"scenario_version", scenario_version},
          {"world", name(sampler.world())},
          {"set", name(Set)},
          {"seed", sampler.seed()},
          {"truth_step", options.step},
          {"contacts", continuous ? "continuous" : "discrete"},
          {"sample_rate", options.sample_rate},
          {"horizons", horizons},
          {"scenarios", count}};
}

}  // namespace rbres::RBRES_ABI::detail
