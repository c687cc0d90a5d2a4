#include "groups.hpp"
#include "suite.hpp"

namespace validate {

std::vector<Group> any_shape_groups() {
  using Shape = AnyShape<double>;
  auto groups = double_groups<Shape>("any shape");
  for (const auto& more : {float_groups<Shape>("any shape"), lane_groups<Shape>("any shape")}) {
    groups.insert(groups.end(), more.begin(), more.end());
  }
  return groups;
}

}  // namespace validate
