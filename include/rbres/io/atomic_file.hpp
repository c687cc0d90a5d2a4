#pragma once

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <system_error>
#include <utility>

#include <rbres/io/file.hpp>

namespace rbres {

/// A new file that takes its place only when it is complete. It is written beside `path` as "PATH.partial";
/// commit() flushes it to the disk and renames it, so whatever happens (a kill, a power cut, a full disk)
/// `path` holds either the whole old file or the whole new one. A partial file that a killed process left
/// behind is overwritten by the next one. Every error is an rbres::Error that names the path. POSIX.
class AtomicFile {
 public:
  /// Error when the path cannot be written, is a folder or a device, or is being written by someone else.
  explicit AtomicFile(std::filesystem::path path)
      : path_(std::move(path)), partial_(path_.string() + ".partial"), file_(open_alone(0)) {}

  /// Goes on with the first `size` bytes of the partial file that an earlier run left behind (for 0 bytes
  /// there need be none); what follows them is dropped. Without commit() the partial file stays for the next
  /// run.
  AtomicFile(std::filesystem::path path, std::uint64_t size)
      : path_(std::move(path)),
        partial_(path_.string() + ".partial"),
        file_(open_alone(size)),
        end_(size),
        stays_(true) {}
  AtomicFile(AtomicFile&&) noexcept = default;
  AtomicFile& operator=(AtomicFile&&) = delete;

  /// Without commit() nothing has happened.
  ~AtomicFile() {
    if (file_.valid() && !stays_) ::unlink(partial_.c_str());
  }

  const std::filesystem::path& path() const noexcept { return path_; }

  /// Appends `size` bytes.
  void write(const void* data, std::size_t size) {
    write_at(end_, data, size);
    end_ += size;
  }

  /// Writes over bytes that stand at `offset`.
  void write_at(std::uint64_t offset, const void* data, std::size_t size) {
    const auto* from = static_cast<const char*>(data);
    while (size > 0) {
      const ssize_t done = ::pwrite(file_.get(), from, size, static_cast<off_t>(offset));
      if (done < 0 && errno == EINTR) continue;
      if (done < 0) detail::refuse_file(path_, "write");
      from += done;
      offset += static_cast<std::uint64_t>(done);
      size -= static_cast<std::size_t>(done);
    }
  }

  /// Waits until all that was written is on the disk.
  void flush() {
    if (::fsync(file_.get()) != 0) detail::refuse_file(path_, "write");
  }

  /// Flushes the new file and puts it in its place. Call it last, and once.
  void commit() {
    flush();
    if (std::rename(partial_.c_str(), path_.c_str()) != 0) detail::refuse_file(path_, "write");
    file_ = detail::FileDescriptor(-1);
    // The rename itself reaches the disk with the folder. Some file systems cannot do that, and both files
    // are whole either way, so this is best effort.
    const auto folder = path_.has_parent_path() ? path_.parent_path() : std::filesystem::path(".");
    const detail::FileDescriptor parent(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
    if (parent.valid()) ::fsync(parent.get());
  }

 private:
  /// Opens the partial file under a lock, which the system drops with the process: two writers of one path
  /// would mix their bytes. A partial file that was renamed between open and lock is someone's finished file:
  /// not ours to clear. Cuts it to `size` bytes.
  detail::FileDescriptor open_alone(std::uint64_t size) const {
    std::error_code ignored;
    const auto status = std::filesystem::status(path_, ignored);
    if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status))
      throw Error(
          detail::text(path_.string(), ": expected a regular file to replace, found a folder or a device"));
    detail::FileDescriptor file(::open(partial_.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0666));
    if (!file.valid()) detail::refuse_file(path_, "write");
    struct stat ours {
    }, named{};
    const bool locked = ::flock(file.get(), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
    const bool known = ::fstat(file.get(), &ours) == 0 && ::stat(partial_.c_str(), &named) == 0;
    if (locked || !known || ours.st_ino != named.st_ino)
      throw Error(detail::text(path_.string(), ": cannot write: another writer holds ", partial_.string()));
    if (const auto found = static_cast<std::uint64_t>(ours.st_size); found < size)
      detail::refuse(partial_.string(), detail::text("at least ", size, " bytes"), found);
    if (::ftruncate(file.get(), static_cast<off_t>(size)) != 0) detail::refuse_file(path_, "write");
    return file;
  }

  std::filesystem::path path_;
  std::filesystem::path partial_;
  detail::FileDescriptor file_;
  std::uint64_t end_ = 0;
  bool stays_ = false;
};

}  // namespace rbres
