// seeds FOLDER: writes small valid files of every kind, from which the fuzzers start, to FOLDER/npy and so
// on.
#include <filesystem>
#include <iostream>

#include <Eigen/Core>

#include <rbres/io.hpp>

#include "fuzz_networks.hpp"

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: seeds FOLDER\n";
    return 2;
  }
  const std::filesystem::path folder = argv[1];
  for (const char* kind : {"npy", "safetensors", "model", "checkpoint"})
    std::filesystem::create_directories(folder / kind);

  const Eigen::MatrixXf columns = Eigen::MatrixXf::Constant(2, 3, 0.5f);
  rbres::write_npy(folder / "npy/matrix.npy", columns);
  rbres::NpyWriter<float> writer(folder / "npy/cube.npy", {2, 1});
  writer.append(columns);
  writer.commit();

  const double number = 0.25;
  rbres::SafetensorsWriter tensors;
  tensors.add("0.weight", {3, 2}, columns.data());
  tensors.add("0.bias", {3}, columns.data());
  tensors.add("number", {}, &number);
  tensors.metadata["format"] = "pt";
  tensors.write(folder / "safetensors/network.safetensors");

  rbres::save(folder / "model/network.safetensors", FuzzNetwork(1), {{"author", "me"}});
  FuzzRun run;
  run.trainer.run_epoch();
  rbres::save_checkpoint(folder / "checkpoint/run.safetensors", run.trainer);
}
