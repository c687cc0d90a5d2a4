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

namespace rbres::RBRES_ABI {

/// A new file that takes its place only when it is complete. It is written beside `path` as partial(path);
/// commit() flushes it to the disk and renames it, so whatever happens (a kill, a power cut, a full disk)
/// `path` holds either the whole old file or the whole new one. It keeps the permissions of the file that it
/// replaces. While it lives no other process can write the same path; what a killed process left behind is
/// replaced by the next one. Every error is an rbres::Error that names the path. POSIX.
class AtomicFile {
 public:
  /// Error when the path cannot be written, is a folder or a device, or is being written by someone else.
  explicit AtomicFile(std::filesystem::path path)
      : path_(std::move(path)), partial_(partial(path_)), file_(open(0)) {}

  /// Goes on with the first `size` bytes of the partial file that an earlier run left behind (for 0 bytes
  /// there need be none); what follows them is dropped. Without commit() the partial file stays for the next
  /// run.
  AtomicFile(std::filesystem::path path, std::uint64_t size)
      : path_(std::move(path)), partial_(partial(path_)), file_(open(size)), end_(size), stays_(true) {}
  /// The other then owns no file.
  AtomicFile(AtomicFile&&) noexcept = default;
  AtomicFile& operator=(AtomicFile&&) = delete;

  /// Without commit() nothing has happened.
  ~AtomicFile() {
    if (file_.valid() && !stays_) ::unlink(partial_.c_str());
  }

  /// Where the file for `path` stands until it is complete.
  static std::filesystem::path partial(const std::filesystem::path& path) {
    return path.string() + ".rbres-partial";
  }

  /// Where the file will be.
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

  /// Takes room for `size` bytes from the disk now, so that a full disk is an Error before the work whose
  /// result is to be written. (Disks that write nothing in place, such as Btrfs, may be full all the same.)
  void reserve(std::uint64_t size) {
    errno = ::posix_fallocate(file_.get(), 0, static_cast<off_t>(size));
    if (errno != 0) detail::refuse_file(path_, "write");
    reserved_ = true;
  }

  /// Waits until all that was written is on the disk.
  void flush() {
    if (::fsync(file_.get()) != 0) detail::refuse_file(path_, "write");
  }

  /// Flushes the new file and puts it in its place. Call it last, and once.
  void commit() {
    finish();
    if (std::rename(partial_.c_str(), path_.c_str()) != 0) detail::refuse_file(path_, "write");
    settle();
  }

  /// The same where no file may be replaced: Error when there is one by now.
  void commit_new() {
    finish();
    // A link, unlike a rename, is refused where there is a file. Some file systems have no links.
    const bool linked = ::link(partial_.c_str(), path_.c_str()) == 0;
    const bool has_links = linked || (errno != EPERM && errno != EOPNOTSUPP && errno != ENOSYS);
    std::error_code ignored;
    if (!linked && (errno == EEXIST || (!has_links && std::filesystem::exists(path_, ignored))))
      detail::fail(detail::text(path_.string(), ": exists by now and would be overwritten"));
    const int moved = has_links ? ::unlink(partial_.c_str()) : std::rename(partial_.c_str(), path_.c_str());
    if ((has_links && !linked) || moved != 0) detail::refuse_file(path_, "write");
    settle();
  }

 private:
  /// Opens the partial file under a lock, which the system drops with the process: two writers of one path
  /// would mix their bytes. It is made anew, so nothing is written through what stands there, but for one of
  /// which the first `size` bytes count.
  detail::FileDescriptor open(std::uint64_t size) const {
    struct stat target {};
    const bool replaces = ::stat(path_.c_str(), &target) == 0;
    if (replaces && !S_ISREG(target.st_mode))
      detail::fail(
          detail::text(path_.string(), ": expected a regular file to replace, found a folder or a device"));
    // Another process may take or clear the same leftover between two calls; then it is looked at again.
    for (int attempt = 0; attempt < 100; ++attempt) {
      if (detail::FileDescriptor left = open_left(); left.valid()) {
        if (!lock(left)) continue;
        if (size > 0) return cut(std::move(left), size);
        ::unlink(partial_.c_str());
      } else if (size > 0) {
        detail::refuse(partial_.string(), detail::text("at least ", size, " bytes"), 0);
      }
      const mode_t mode = replaces ? target.st_mode & 0777 : 0666;
      constexpr int anew = O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC;
      detail::FileDescriptor file(::open(partial_.c_str(), anew, mode));
      if (!file.valid() && errno == EEXIST) continue;
      if (!file.valid()) detail::refuse_file(path_, "write");
      if (!lock(file)) continue;
      if (replaces && ::fchmod(file.get(), mode) != 0) detail::refuse_file(path_, "write");
      return file;
    }
    refuse_writer();
  }

  /// The partial file that stands there; none where there is none.
  detail::FileDescriptor open_left() const {
    struct stat found {};
    detail::FileDescriptor left(::open(partial_.c_str(), O_RDWR | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC));
    if (!left.valid() && errno == ENOENT) return left;
    if (!left.valid() && errno != ELOOP && errno != EISDIR && errno != ENXIO)
      detail::refuse_file(path_, "write");
    // A symbolic link is not followed.
    if (!left.valid() || ::fstat(left.get(), &found) != 0 || !S_ISREG(found.st_mode)) refuse_left();
    return left;
  }

  /// Locks the partial file. False where it is no longer the one of that name; Error where another writer
  /// holds it.
  bool lock(const detail::FileDescriptor& file) const {
    if (::flock(file.get(), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) refuse_writer();
    struct stat ours {
    }, named{};
    return ::fstat(file.get(), &ours) == 0 && ::lstat(partial_.c_str(), &named) == 0 &&
           ours.st_dev == named.st_dev && ours.st_ino == named.st_ino;
  }

  [[noreturn]] void refuse_left() const {
    detail::fail(detail::text(path_.string(), ": cannot write: ", partial_.string(),
                              " is not what a killed run leaves there; remove it"));
  }
  [[noreturn]] void refuse_writer() const {
    detail::fail(detail::text(path_.string(), ": cannot write: another writer holds ", partial_.string()));
  }

  detail::FileDescriptor cut(detail::FileDescriptor left, std::uint64_t size) const {
    struct stat found {};
    if (::fstat(left.get(), &found) != 0) detail::refuse_file(path_, "write");
    if (found.st_nlink > 1) refuse_left();  // its other name may be anyone's
    if (static_cast<std::uint64_t>(found.st_size) < size)
      detail::refuse(partial_.string(), detail::text("at least ", size, " bytes"), found.st_size);
    if (::ftruncate(left.get(), static_cast<off_t>(size)) != 0) detail::refuse_file(path_, "write");
    return left;
  }

  void finish() {
    if (reserved_ && ::ftruncate(file_.get(), static_cast<off_t>(end_)) != 0)
      detail::refuse_file(path_, "write");
    flush();
  }

  /// After the rename, which reaches the disk with the folder. Some file systems cannot do that, and both
  /// files are whole either way, so this is best effort.
  void settle() {
    file_ = detail::FileDescriptor(-1);
    const auto folder = path_.has_parent_path() ? path_.parent_path() : std::filesystem::path(".");
    const detail::FileDescriptor parent(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
    if (parent.valid()) ::fsync(parent.get());
  }

  std::filesystem::path path_;
  std::filesystem::path partial_;
  detail::FileDescriptor file_;
  std::uint64_t end_ = 0;
  bool stays_ = false, reserved_ = false;
};

}  // namespace rbres::RBRES_ABI
