// io_python_copy DTYPE IN.npy OUT.npy: reads an array and writes it again.
// io_python_copy safetensors IN.npy OUT.safetensors: writes its numbers as the tensor "array", with metadata.
// io_python_copy npy IN.safetensors OUT.npy: writes the matrix "array" of a safetensors file.
// io_python_copy network "" OUT.safetensors: saves the network of io_export_models.hpp.
// io_python_copy dataset "" FOLDER: makes a data set of 60 scenarios.
// io_python_copy network IN.safetensors OUT.safetensors: loads such a network and saves it.
#include <iostream>
#include <string>

#include <rbres/io.hpp>
#include <rbres/io/scenario_data.hpp>

#include "io_export_models.hpp"

namespace {

using rbres::NpyReader;
using rbres::NpyWriter;

template <class Scalar>
void copy(const std::string& in, const std::string& out) {
  const NpyReader<Scalar> reader(in);
  NpyWriter<Scalar> writer(out, {reader.shape().begin() + 1, reader.shape().end()});
  for (Eigen::Index i = 0; i < reader.samples(); ++i) writer.append(reader.read(i, 1));
  writer.commit();
}

void to_safetensors(const std::string& in, const std::string& out) {
  const NpyReader<float> reader(in);
  const auto columns = reader.read();
  rbres::SafetensorsWriter writer;
  writer.add("array", reader.shape(), columns.data());
  writer.metadata["made by"] = "rbres";
  writer.write(out);
}

void from_safetensors(const std::string& in, const std::string& out) {
  const rbres::SafetensorsReader reader(in);
  const auto shape = reader.tensors().at("array").shape;
  Eigen::MatrixXf columns(shape.at(1), shape.at(0));
  reader.read("array", shape, columns.data());
  rbres::write_npy(out, columns);
}

}  // namespace

int main(int argc, char** argv) try {
  const std::string how = argc == 4 ? argv[1] : "";
  if (how == "float32") copy<float>(argv[2], argv[3]);
  if (how == "float64") copy<double>(argv[2], argv[3]);
  if (how == "int32") copy<std::int32_t>(argv[2], argv[3]);
  if (how == "int64") copy<std::int64_t>(argv[2], argv[3]);
  if (how == "uint8") copy<std::uint8_t>(argv[2], argv[3]);
  if (how == "safetensors") to_safetensors(argv[2], argv[3]);
  if (how == "npy") from_safetensors(argv[2], argv[3]);
  if (how == "dataset") {
    const rbres::ScenarioSampler<rbres::BodySet::standard> sampler(rbres::World::room, 3);
    rbres::write_dataset(argv[3], sampler, 60, {0.02, 1}, {}, [](Eigen::Index) {});
  }
  if (how == "network") {
    const std::string in = argv[2];
    rbres::save(argv[3], in.empty() ? exported_float()
                                    : rbres::load<decltype(exported_float())>(in, rbres::Digest::optional));
  }
} catch (const std::exception& error) {
  std::cerr << error.what() << '\n';
  return 2;
}
