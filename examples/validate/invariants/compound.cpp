#include "groups.hpp"
#include "suite.hpp"

namespace validate {

/// What is asked of compounds, which have no lanes and are not their own mirror images.
std::vector<Group> compound_groups() {
  using Parts = Compound<double, 3>;
  std::vector<Group> groups{grid_group<Parts>("compound"), tunnelling_group<Parts>("compound")};
  for (const Group& group : float_groups<Parts>("compound")) groups.push_back(group);
  return groups;
}

}  // namespace validate
