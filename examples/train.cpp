// Trains a network, evaluates and saves it: on simulated scenarios, or on data of one's own.
#include "train/run.hpp"

int main(int argc, char** argv) {
  CLI::App app{
      "Trains a network and saves the model: on scenarios that it simulates, to predict where bodies will\n"
      "be, or on your own arrays (--inputs, --targets). Prints the errors on a tenth of the samples, which\n"
      "the network never saw, beside those of the contact-free flow or of the targets' mean. Overwrites no\n"
      "file."};
  train::Options o;
  train::add_options(app, o);
  return run_program("rbres_train", app, argc, argv, [&] { train::run(o); });
}
