// A file that promises more than it holds must be refused before anything of that size is asked for.
#include "io_support.hpp"

#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <new>

#include <rbres/io/npy.hpp>
#include <rbres/io/safetensors.hpp>

namespace {
std::size_t largest_allocation = 0;
}

// Out of line: g++ 12 takes an inlined pair for a mismatch of malloc and delete.
[[gnu::noinline]] void* operator new(std::size_t size) {
  largest_allocation = std::max(largest_allocation, size);
  if (void* memory = std::malloc(size)) return memory;
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* memory) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

TEST_CASE("1 TB promised by a small file") {
  const TemporaryFolder folder;
  const auto path = folder / "promise";
  const auto check_refused = [&](const std::string& bytes, const auto& read) {
    write_bytes(path, bytes);
    largest_allocation = 0;
    CHECK(contains(error_of(read), path.string()));
    CHECK(largest_allocation > 0);
    CHECK(largest_allocation < 4096);
  };
  const std::string tensor =
      R"({"a":{"dtype":"F32","shape":[250000000000],"data_offsets":[0,1000000000000]}})";
  const auto read_tensors = [&] { rbres::SafetensorsReader{path}; };
  check_refused(std::string({static_cast<char>(tensor.size()), 0, 0, 0, 0, 0, 0, 0}) + tensor, read_tensors);
  check_refused(std::string("\0\0\0\0\x01\0\0\0{}", 10), read_tensors);

  const std::string dictionary = "{'descr': '<f4', 'fortran_order': False, 'shape': (2500000000, 100)}";
  const auto read_array = [&] { rbres::read_npy<float>(path); };
  check_refused("\x93NUMPY" + std::string({1, 0, static_cast<char>(dictionary.size()), 0}) + dictionary,
                read_array);
  check_refused("\x93NUMPY" + std::string({2, 0, 0, 0, 0, 64}) + dictionary, read_array);
}
