#include "compiled.hpp"

template struct rbres::SimulatedScenario<rbres::BodySet::standard>;
