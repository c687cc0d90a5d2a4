#pragma once

#include <sys/mman.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <string>

#include <rbres/core/error.hpp>

#include "../io_reseal.hpp"

/// Hands the fuzzer's bytes to `read` as a file in memory, with the right digest, which no fuzzer guesses.
/// An rbres::Error is an answer; anything else is a finding.
template <class Read>
int fuzz_reader(const std::uint8_t* data, std::size_t size, const Read& read) {
  static const int file = ::memfd_create("input", MFD_CLOEXEC);
  static const std::filesystem::path path = "/proc/self/fd/" + std::to_string(file);
  const std::string bytes = resealed({reinterpret_cast<const char*>(data), size});
  if (::ftruncate(file, 0) != 0 || ::pwrite(file, bytes.data(), size, 0) != static_cast<ssize_t>(size))
    std::abort();
  try {
    read(path);
  } catch (const rbres::Error&) {
  }
  return 0;
}
