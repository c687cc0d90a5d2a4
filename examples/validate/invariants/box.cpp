#include "groups.hpp"
#include "suite.hpp"

namespace validate {

std::vector<Group> box_groups() {
  using Shape = Box<double>;
  auto groups = double_groups<Shape>("box");
  for (const auto& more : {float_groups<Shape>("box"), lane_groups<Shape>("box")}) {
    groups.insert(groups.end(), more.begin(), more.end());
  }
  return groups;
}

}  // namespace validate
