#pragma once

#include <signal.h>
#include <sys/resource.h>

/// While it lives, files can grow to `size` bytes only: what a full disk looks like to one process.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t size) : old_action_(::signal(SIGXFSZ, SIG_IGN)) {
    ::getrlimit(RLIMIT_FSIZE, &old_limit_);
    const rlimit limit{size, old_limit_.rlim_max};
    ::setrlimit(RLIMIT_FSIZE, &limit);
  }
  FileSizeLimit(const FileSizeLimit&) = delete;
  FileSizeLimit& operator=(const FileSizeLimit&) = delete;
  ~FileSizeLimit() {
    ::setrlimit(RLIMIT_FSIZE, &old_limit_);
    ::signal(SIGXFSZ, old_action_);
  }

 private:
  sighandler_t old_action_;
  rlimit old_limit_{};
};
