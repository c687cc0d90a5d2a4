// The scenarios of a run: simulated now, or of a folder.
#pragma once

#include <rbres/io/scenario_data.hpp>

#include "options.hpp"

namespace train {

/// The horizons of a data set on disk, s.
inline const std::vector<double> horizons{0.02, 0.1, 0.5, 1, 2, 5};

template <BodySet Set>
ScenarioData data_of(const Options& o) {
  const ScenarioSampler<Set> sampler(o.world, 1);
  const TruthOptions truth{.threads = o.training.threads};
  const std::string set = std::string(name(o.world)) + "-" + std::string(name(Set));
  ScenarioProgress progress(o.scenarios);
  ScenarioData data;
  if (o.data.empty()) {
    std::printf("%s: simulating %d scenarios over %g s\n", set.c_str(), o.scenarios, o.horizon);
    data = generate(sampler, 0, o.scenarios, {o.horizon}, truth, progress);
    progress.end();
    return data;
  }
  if (!dataset_is_done(o.data)) {
    if (std::ranges::find(horizons, o.horizon) == horizons.end())
      detail::refuse("--horizon", "one of 0.02, 0.1, 0.5, 1, 2, 5 where --data makes a data set", o.horizon);
    std::printf("%s: simulating %d scenarios over %g s into %s\n", set.c_str(), o.scenarios, horizons.back(),
                o.data.c_str());
    write_dataset(o.data, sampler, o.scenarios, horizons, truth, progress);
    progress.end();
  }
  data = read_dataset(o.data, sampler, o.scenarios, {o.horizon}, truth);
  std::printf("%s: %d scenarios of %s\n", set.c_str(), o.scenarios, o.data.c_str());
  return data;
}

}  // namespace train
