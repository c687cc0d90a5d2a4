#include "groups.hpp"
#include "suite.hpp"

namespace validate {

std::vector<Group> capsule_groups() {
  using Shape = Capsule<double>;
  auto groups = double_groups<Shape>("capsule");
  for (const auto& more : {float_groups<Shape>("capsule"), lane_groups<Shape>("capsule")}) {
    groups.insert(groups.end(), more.begin(), more.end());
  }
  return groups;
}

}  // namespace validate
