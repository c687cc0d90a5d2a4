#pragma once

#include <fcntl.h>
#include <sys/types.h>
#include <unistd.h>

#include <bit>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

#include <rbres/core/error.hpp>

namespace rbres::RBRES_ABI::detail {

static_assert(std::endian::native == std::endian::little,
              "rbres files are little-endian, and so must the machine be");

/// Throws "PATH: cannot VERB: REASON" with the reason that errno gives.
[[noreturn]] inline void refuse_file(const std::filesystem::path& path, std::string_view verb) {
  const int reason = errno;
  fail(text(path.string(), ": cannot ", verb, ": ", std::generic_category().message(reason)));
}

/// The same where the standard library has met a problem.
inline void refuse_problem(const std::filesystem::path& path, std::string_view verb,
                           const std::error_code& problem) {
  if (problem) fail(text(path.string(), ": cannot ", verb, ": ", problem.message()));
}

/// Whether there is something of that name; Error where that cannot be known.
inline bool file_exists(const std::filesystem::path& path) {
  std::error_code problem;
  const bool there = std::filesystem::exists(path, problem);
  refuse_problem(path, "be looked at", problem);
  return there;
}
/// Makes a folder where there is none.
inline void make_folder(const std::filesystem::path& path) {
  std::error_code problem;
  std::filesystem::create_directories(path, problem);
  refuse_problem(path, "be made", problem);
}

/// a · b, a size in a file that must stay below 2^63; Error that names the path when it does not.
inline std::uint64_t checked_product(const std::filesystem::path& path, std::uint64_t a, std::uint64_t b) {
  constexpr auto limit = static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max());
  if (b != 0 && a > limit / b) refuse(path.string(), "sizes below 2^63", "a shape that needs more");
  return a * b;
}

/// Owns a POSIX file descriptor.
class FileDescriptor {
 public:
  explicit FileDescriptor(int descriptor) noexcept : descriptor_(descriptor) {}
  FileDescriptor(FileDescriptor&& other) noexcept : descriptor_(std::exchange(other.descriptor_, -1)) {}
  FileDescriptor& operator=(FileDescriptor&& other) noexcept {
    std::swap(descriptor_, other.descriptor_);
    return *this;
  }
  ~FileDescriptor() {
    if (descriptor_ >= 0) ::close(descriptor_);
  }
  int get() const noexcept { return descriptor_; }
  bool valid() const noexcept { return descriptor_ >= 0; }

 private:
  int descriptor_;
};

/// A regular file open for reading at any offset. Errors name the path.
class InputFile {
 public:
  explicit InputFile(std::filesystem::path path) : path_(std::move(path)), file_(open(path_)) {
    const off_t end = ::lseek(file_.get(), 0, SEEK_END);
    if (end < 0) refuse_file(path_, "read");
    size_ = static_cast<std::uint64_t>(end);
  }

  const std::filesystem::path& path() const noexcept { return path_; }
  std::uint64_t size() const noexcept { return size_; }

  /// Reads the first `size` bytes of what must be `expected`, which has as many.
  void read_first(void* to, std::size_t size, std::string_view expected) const {
    if (size > size_) refuse(path_.string(), expected, text("a file of ", size_, " bytes"));
    read(0, to, size);
  }
  /// Reads exactly `size` bytes at `offset`; Error when the file has fewer.
  void read(std::uint64_t offset, void* to, std::size_t size) const {
    if (offset > size_ || size > size_ - offset)
      refuse(path_.string(), text(size, " bytes at offset ", offset), text("a file of ", size_, " bytes"));
    auto* out = static_cast<char*>(to);
    while (size > 0) {
      const ssize_t got = ::pread(file_.get(), out, size, static_cast<off_t>(offset));
      if (got < 0 && errno == EINTR) continue;
      if (got < 0) refuse_file(path_, "read");
      if (got == 0) fail(text(path_.string(), ": the file shrank while it was read"));
      out += got;
      offset += static_cast<std::uint64_t>(got);
      size -= static_cast<std::size_t>(got);
    }
  }

 private:
  static FileDescriptor open(const std::filesystem::path& path) {
    std::error_code ignored;
    const auto status = std::filesystem::status(path, ignored);
    // Opening a pipe would wait for its writer, and the size of a device means nothing.
    if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status))
      fail(text(path.string(), ": expected a regular file, found a folder or a device"));
    FileDescriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
    if (!file.valid()) refuse_file(path, "read");
    return file;
  }

  std::filesystem::path path_;
  FileDescriptor file_;
  std::uint64_t size_ = 0;
};

}  // namespace rbres::RBRES_ABI::detail
