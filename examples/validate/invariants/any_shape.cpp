#include "groups.hpp"
#include "suite.hpp"

namespace validate {

std::vector<Group> any_shape_groups() { return shape_groups<AnyShape<double>>("any shape"); }

}  // namespace validate
