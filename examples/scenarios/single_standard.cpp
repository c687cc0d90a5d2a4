#include "compiled.hpp"

template struct rbres::Simulated<rbres::BodySet::standard>;
