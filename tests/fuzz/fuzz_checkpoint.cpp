#include "fuzz_networks.hpp"
#include "input_file.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return fuzz_reader(data, size, [](const auto& path) {
    static FuzzRun run;
    load_checkpoint(path, run.trainer);
  });
}
