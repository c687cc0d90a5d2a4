// What is allocated: no more than a file holds whatever it promises, and no more than six copies of the
// parameters in training.
#include "io_support.hpp"

#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <new>

#include <rbres/io/checkpoint.hpp>
#include <rbres/io/npy.hpp>
#include <rbres/io/safetensors.hpp>
#include <rbres/nn/residual_network.hpp>

namespace {

struct Allocations {
  std::size_t count = 0, largest = 0, bytes = 0, peak = 0;
};
Allocations allocations;

// Before each block stands its size.
constexpr std::size_t header = 64;

void* allocate(std::size_t size) {
  auto* memory = static_cast<char*>(std::aligned_alloc(header, (size + 2 * header - 1) / header * header));
  if (memory == nullptr) std::abort();
  std::memcpy(memory, &size, sizeof size);
  ++allocations.count;
  allocations.largest = std::max(allocations.largest, size);
  allocations.peak = std::max(allocations.peak, allocations.bytes += size);
  return memory + header;
}
void release(void* at) noexcept {
  if (at == nullptr) return;
  auto* memory = static_cast<char*>(at) - header;
  std::size_t size;
  std::memcpy(&size, memory, sizeof size);
  allocations.bytes -= size;
  std::free(memory);
}

}  // namespace

// Out of line: g++ 12 takes an inlined pair for a mismatch of malloc and delete.
[[gnu::noinline]] void* operator new(std::size_t size) { return allocate(size); }
[[gnu::noinline]] void* operator new(std::size_t size, std::align_val_t) { return allocate(size); }
[[gnu::noinline]] void* operator new(std::size_t size, const std::nothrow_t&) noexcept {
  return allocate(size);
}
[[gnu::noinline]] void operator delete(void* at) noexcept { release(at); }
[[gnu::noinline]] void operator delete(void* at, std::size_t) noexcept { release(at); }
[[gnu::noinline]] void operator delete(void* at, std::align_val_t) noexcept { release(at); }
[[gnu::noinline]] void operator delete(void* at, std::size_t, std::align_val_t) noexcept { release(at); }

TEST_CASE("1 TB promised by a small file") {
  const TemporaryFolder folder;
  const auto path = folder / "promise";
  const auto check_refused = [&](const std::string& bytes, const auto& read) {
    write_bytes(path, bytes);
    allocations.largest = 0;
    CHECK(contains(error_of(read), path.string()));
    CHECK(allocations.largest > 0);
    CHECK(allocations.largest < 4096);
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

TEST_CASE(
    "training takes at most six copies of the parameters, checkpoints among it, and none with the data") {
  using Net = rbres::ResidualNetwork<float, 6, 256, 2, 2>;
  const TemporaryFolder folder;
  const auto path = folder / "checkpoint";
  const auto peak_of_run = [&](Eigen::Index samples) {
    const Eigen::MatrixXf x = Eigen::MatrixXf::Random(6, samples), y = Eigen::MatrixXf::Random(2, samples);
    const rbres::Samples<float> data{rbres::columns(x), rbres::columns(y)};
    const std::size_t before = allocations.peak = allocations.bytes;
    rbres::Trainer trainer(Net(1), data, data, {.epochs = 2, .batch_size = 8, .threads = 1});
    trainer.run_epoch();
    save_checkpoint(path, trainer);
    load_checkpoint(path, trainer);
    const std::size_t count = allocations.count;
    trainer.run_epoch();
    CHECK(allocations.count == count);  // an epoch allocates nothing
    return allocations.peak - before;
  };
  const std::size_t few = peak_of_run(8), many = peak_of_run(800);
  CHECK(few > 4 * Net::block_size * sizeof(float));
  CHECK(few < 6 * Net::block_size * sizeof(float));
  CHECK(many - few <= 792 * sizeof(std::uint32_t));  // the order of the samples
}
