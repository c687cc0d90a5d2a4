// Simulates, trains, evaluates and saves one predictor.
#include "train/run.hpp"

int main(int argc, char** argv) {
  CLI::App app{
      "Simulates scenarios, trains a network to predict them, and saves the model. Prints the errors on a\n"
      "tenth of the scenarios, which the network never saw, beside those of the contact-free flow.\n"
      "Overwrites no file."};
  train::Options o;
  train::add_options(app, o);
  return run_program("rbres_train", app, argc, argv, [&] {
    train::Outputs files = train::open_files(o);
    o.set == rbres::BodySet::standard ? train::run<rbres::BodySet::standard>(o, files)
                                      : train::run<rbres::BodySet::box>(o, files);
  });
}
