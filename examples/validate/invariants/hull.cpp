#include "groups.hpp"
#include "suite.hpp"

namespace validate {

/// What is asked of convex hulls, which have no lanes and are not their own mirror images.
std::vector<Group> hull_groups() {
  using Hull = ConvexHull<double>;
  std::vector<Group> groups{grid_group<Hull>("convex hull"), tunnelling_group<Hull>("convex hull")};
  for (const Group& group : float_groups<Hull>("convex hull")) groups.push_back(group);
  return groups;
}

}  // namespace validate
