#include "closed_capsule.hpp"
#include "groups.hpp"
#include "suite.hpp"

namespace validate {

std::vector<Group> capsule_groups() {
  auto groups = shape_groups<Capsule<double>>("capsule");
  groups.push_back(
      {"closed forms", "capsule", 1, 1, 1, [](const Cases&) {
         const auto forms = capsule_forms();
         return std::vector<Finding>{
             {"top_precession", "rad", 1e-6, "regular precession of a heavy top about its pivot, 2 s",
              forms.top},
             {"top_on_floor", "rad", 1e-3, "and of one whose end slides on a smooth floor, 1 s in 0.1 ms",
              forms.floor_top},
             {"capsule_rolls", "relative", 1e-6, "on an incline, with g sin a / (1 + I / (m r^2))",
              forms.rolls},
             {"capsule_tips", "relative", 1e-3,
              "rate of turn of a capsule that falls over, with and without friction", forms.tips},
             {"capsule_lies", "radii", 1e-9, "height and lean of what has fallen over", forms.lies}};
       }});
  return groups;
}

}  // namespace validate
