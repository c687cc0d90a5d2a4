#include "closed_box.hpp"
#include "groups.hpp"
#include "suite.hpp"

namespace validate {

std::vector<Group> box_groups() {
  auto groups = shape_groups<Box<double>>("box");
  groups.push_back(
      {"closed forms", "box", 1, 1, 1, [](const Cases&) {
         const auto block = block_on_incline();
         return std::vector<Finding>{
             {"incline_block_slides", "relative", 1e-5, "way in 2 s: g (sin a - mu cos a)", block.slides},
             {"incline_block_sticks", "relative", 1e-8,
              "way in 2 s over that without friction, at the friction angle and below", block.sticks}};
       }});
  return groups;
}

}  // namespace validate
