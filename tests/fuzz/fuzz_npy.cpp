#include "input_file.hpp"

#include <rbres/io/npy.hpp>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return fuzz_reader(data, size, [](const auto& path) {
    // One type per run: the others differ in the name of the dtype only.
    rbres::read_npy<float>(path);
  });
}
