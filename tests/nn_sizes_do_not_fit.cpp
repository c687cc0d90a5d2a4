// Must not compile, and must say why.
#include <rbres/nn/network.hpp>

rbres::Network<float, rbres::Sequential<rbres::Linear<3, 4>, rbres::Linear<5, 2>>> network;
