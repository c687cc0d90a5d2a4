#pragma once

#include <fcntl.h>
#include <sys/file.h>

#include <cerrno>
#include <filesystem>
#include <string_view>

#include <rbres/core/error.hpp>
#include <rbres/io/file.hpp>

namespace rbres::RBRES_ABI {

/// Keeps other processes out of a folder while it lives, if they ask too. The system drops the lock with the
/// process, however that ends. POSIX.
class FolderLock {
 public:
  /// Error "FOLDER: another process DOES" where another one holds it.
  FolderLock(const std::filesystem::path& folder, std::string_view does)
      : folder_(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)) {
    if (!folder_.valid()) detail::refuse_file(folder, "read");
    if (::flock(folder_.get(), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK)
      detail::fail(detail::text(folder.string(), ": another process ", does));
  }

 private:
  detail::FileDescriptor folder_;
};

}  // namespace rbres::RBRES_ABI
