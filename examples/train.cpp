// Simulates, trains, evaluates and saves one predictor, by the protocol of arXiv 2407.18798 unless told
// otherwise.
#include "train/run.hpp"

int main(int argc, char** argv) {
  CLI::App app{
      "Simulates scenarios, trains a network to predict them, and saves the model. Defaults are those of "
      "arXiv\n"
      "2407.18798. Prints the errors on a tenth of the scenarios that the network never saw, beside those of "
      "the\n"
      "contact-free flow. Overwrites no file."};
  train::Options o;
  train::add_options(app, o);
  return run_program("rbres_train", app, argc, argv, [&] {
    train::Outputs files = train::open_files(o);
    o.set == rbres::BodySet::standard ? train::run<rbres::BodySet::standard>(o, files)
                                      : train::run<rbres::BodySet::box>(o, files);
  });
}
