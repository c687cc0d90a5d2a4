// What a run writes again and again while it goes on.
#pragma once

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <rbres/nn/schedule.hpp>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

namespace train {

using namespace rbres;

/// The losses of a run, epoch by epoch, as a table that plotting tools read. Each line is on its way to the
/// disk when the next epoch begins. Follows no link and takes the place of nothing but a log.
class LossLog {
 public:
  /// A new file, or, for a run that is resumed, the log that it wrote before; Error where there is anything
  /// else. Changes nothing yet.
  LossLog(const std::string& path, bool is_resumed)
      : path_(path),
        file_(::open(path.c_str(),
                     O_RDWR | O_CREAT | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC | (is_resumed ? 0 : O_EXCL),
                     0666)) {
    if (file_ < 0 && errno == ELOOP) refuse();
    if (file_ < 0) fail();
    if (is_log()) return;
    ::close(file_);
    refuse();
  }
  LossLog(const LossLog&) = delete;
  LossLog& operator=(const LossLog&) = delete;
  ~LossLog() { ::close(file_); }

  /// Writes the epochs that are not written yet. Where that fails (Error) the next call writes them.
  void write(const std::vector<EpochLosses>& history) {
    std::string lines = end_ == 0 ? text_of(header) : "";
    for (std::size_t i = epochs_; i < history.size(); ++i)
      lines += detail::text(i + 1, ",", history[i].train_loss, ",", history[i].validation_loss, ",",
                            history[i].learning_rate, "\n");
    if (end_ == 0 && ::ftruncate(file_, 0) != 0) fail();
    for (std::size_t done = 0; done < lines.size();) {
      const ssize_t now =
          ::pwrite(file_, lines.data() + done, lines.size() - done, end_ + static_cast<off_t>(done));
      if (now < 0 && errno != EINTR) fail();
      if (now > 0) done += static_cast<std::size_t>(now);
    }
    end_ += static_cast<off_t>(lines.size());
    epochs_ = history.size();
  }

 private:
  static constexpr std::string_view header = "epoch,train_loss,validation_loss,learning_rate";

  static std::string text_of(std::string_view line) { return std::string(line) + "\n"; }
  bool is_log() const {
    struct stat found {};
    char first[header.size() + 1];
    if (::fstat(file_, &found) != 0 || !S_ISREG(found.st_mode) || found.st_nlink > 1) return false;
    const ssize_t size = ::pread(file_, first, sizeof first, 0);
    return size == 0 || (size == sizeof first && std::string_view(first, sizeof first) == text_of(header));
  }
  [[noreturn]] void refuse() const {
    detail::refuse("--log: " + path_, "the log of the run that is resumed, or no file",
                   "another file or a link");
  }
  [[noreturn]] void fail() const {
    throw Error(path_ + ": cannot write: " + std::generic_category().message(errno));
  }

  std::string path_;
  int file_;
  off_t end_ = 0;
  std::size_t epochs_ = 0;
};

/// A file that is written after each epoch. What goes wrong there ends no run: it is said at once, and again
/// at the end where no later epoch mends it.
class Retried {
 public:
  template <class Write>
  void operator()(const Write& write) {
    try {
      write();
      problem_.clear();
    } catch (const Error& problem) {
      if (problem_.empty()) std::fprintf(stderr, "\nrbres_train: %s; the run goes on\n", problem.what());
      problem_ = problem.what();
    }
  }
  /// What the last time went wrong; empty where nothing did.
  const std::string& problem() const { return problem_; }

 private:
  std::string problem_;
};

}  // namespace train
