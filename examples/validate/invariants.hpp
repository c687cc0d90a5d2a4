#pragma once

#include "invariants/groups.hpp"
#include "report.hpp"

namespace validate {

/// A row for every property that is found, the worst of all shapes.
inline void invariants(Rows& rows) {
  struct Worst {
    Finding finding;
    std::string type;
  };
  std::vector<Worst> found;
  for (const Group& group : all_groups()) {
    for (const Finding& finding : group.run({.count = group.rows})) {
      const auto same = [&](const Worst& w) { return w.finding.name == finding.name; };
      const auto known = std::find_if(found.begin(), found.end(), same);
      if (known == found.end()) {
        found.push_back({finding, group.type});
      } else if (!(finding.figure.value() <= known->finding.figure.value())) {
        *known = {finding, group.type};
      }
    }
  }
  for (const auto& [finding, type] : found) {
    std::string reference = finding.what + "; worst of all shapes: " + type;
    if (!finding.figure.where().empty()) reference += ", " + finding.figure.where();
    rows.push_back({finding.name, finding.figure.value(), finding.bound, finding.unit, reference});
  }
}

}  // namespace validate
