#pragma once

#include "figure.hpp"

namespace validate {

/// All groups of invariants, of every shape and scalar.
std::vector<Group> sphere_groups();
std::vector<Group> box_groups();
std::vector<Group> capsule_groups();
std::vector<Group> any_shape_groups();
std::vector<Group> hull_groups();
std::vector<Group> compound_groups();

inline std::vector<Group> all_groups() {
  std::vector<Group> all;
  for (const auto& make :
       {sphere_groups, box_groups, capsule_groups, any_shape_groups, hull_groups, compound_groups}) {
    for (auto& group : make()) all.push_back(std::move(group));
  }
  return all;
}

}  // namespace validate
