#pragma once

#include <stdlib.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <string>

#include <doctest/doctest.h>

#include <rbres/core/error.hpp>

#include "error_of.hpp"

/// An empty folder that goes away with the object.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "rbres-test-XXXXXX").string();
    REQUIRE(::mkdtemp(name.data()) != nullptr);
    path_ = name;
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  ~TemporaryFolder() { std::filesystem::remove_all(path_); }
  std::filesystem::path operator/(const char* name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

inline void write_bytes(const std::filesystem::path& path, const std::string& bytes) {
  std::filesystem::remove(path);  // some file systems flush a file that was cut to nothing and written again
  std::ofstream(path, std::ios::binary) << bytes;
}

inline std::string read_bytes(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

inline bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// Every proper prefix of a valid file, and the file with a byte more, must be refused with an Error that
/// names it.
template <class Read>
void check_other_lengths_refused(const std::filesystem::path& path, const std::string& bytes,
                                 const Read& read) {
  for (std::size_t size = 0; size <= bytes.size() + 1; ++size) {
    if (size == bytes.size()) continue;
    write_bytes(path, (bytes + ' ').substr(0, size));
    CAPTURE(size);
    CHECK(contains(error_of([&] { read(path); }), path.string()));
  }
}

/// Any single changed byte, and then what `after` makes of the file: read or refused with an Error, nothing
/// else. Returns how many files were refused.
template <class Read, class After = std::identity>
int check_changed_bytes(const std::filesystem::path& path, const std::string& bytes, const Read& read,
                        const After& after = {}) {
  int refused = 0;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    for (const int change : {0x01, 0x02, 0x04, 0x08, 0x10, 0x20, 0x40, 0x80, 0xff}) {
      std::string changed = bytes;
      changed[i] = static_cast<char>(changed[i] ^ change);
      write_bytes(path, after(changed));
      CAPTURE(i);
      CAPTURE(change);
      CHECK_NOTHROW(refused += !error_of([&] { read(path); }).empty());
    }
  }
  return refused;
}
