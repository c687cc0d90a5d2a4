// write_model MODEL.hpp: writes a small predictor as a header. It is not trained: this example is about where
// it runs.
#include <rbres/io/export_predictor.hpp>

using namespace rbres;

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  using Net = Network<float, Sequential<Linear<38, 32>, Relu, Linear<32, 32>, Relu, Linear<32, 26>>>;
  const System<double, 2> bodies{{Body<double>(Sphere{0.1}, 1.0), Body<double>(Box{0.1, 0.15, 0.05}, 0.5)}};
  Predictor<Net, 2> predictor{Net(1), {}, {}, {bodies}, Target::residual, 0.1};
  predictor.output.deviation.setConstant(0.01f);
  export_header(predictor, argv[1], "model");
}
