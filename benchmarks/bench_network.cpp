/// The network of the paper, in rbres and, where their packages are found, in libtorch and oneDNN.
#include "ratio_reporter.hpp"

int main(int argc, char** argv) { return rbres::bench::run_benchmarks(argc, argv); }
