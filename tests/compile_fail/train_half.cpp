// Weights of half the size are not trained. The test looks for the words in the error.
#include <rbres/nn/nn.hpp>

#ifndef RBRES_WEIGHTS
#define RBRES_WEIGHTS float
#endif
using Net = rbres::ResidualNetwork<float, 2, 8, 1, 2, RBRES_WEIGHTS>;

int main() {
  const Eigen::MatrixXf x = Eigen::MatrixXf::Random(2, 8);
  rbres::Trainer trainer(Net(1), {rbres::columns(x), rbres::columns(x)}, {});
}
