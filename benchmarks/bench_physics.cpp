/// Five bodies on a floor, in rbres and, where their packages are found, in ODE, Bullet and MuJoCo.
#include "ratio_reporter.hpp"

int main(int argc, char** argv) { return rbres::bench::run_benchmarks(argc, argv); }
