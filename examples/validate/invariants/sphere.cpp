#include "groups.hpp"
#include "suite.hpp"

namespace validate {

std::vector<Group> sphere_groups() {
  using Shape = Sphere<double>;
  auto groups = double_groups<Shape>("sphere");
  for (const auto& more : {float_groups<Shape>("sphere"), lane_groups<Shape>("sphere")}) {
    groups.insert(groups.end(), more.begin(), more.end());
  }
  return groups;
}

}  // namespace validate
