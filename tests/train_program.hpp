// Runs of rbres_train.
#pragma once

#include "program_support.hpp"

#include <fcntl.h>
#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>

/// The options of a small run; what `changed` gives in their place ("--epochs 3 --horizon 0.2") or besides.
inline std::string with(const std::string& changed) {
  std::string all = changed;
  for (const auto& [option, value] : {std::pair{"--network", "shallow"},
                                      {"--world", "room"},
                                      {"--target", "state"},
                                      {"--horizon", "0.1"},
                                      {"--scenarios", "100"},
                                      {"--epochs", "2"},
                                      {"--threads", "1"}}) {
    if (!contains(changed, option)) all += std::string(" ") + option + " " + value;
  }
  return all;
}

inline Outcome train(const TemporaryFolder& folder, const std::string& arguments) {
  return run(folder, RBRES_TRAIN, with(arguments));
}

/// The program at work in the folder. What it prints goes through a pipe that holds less than all of it, so
/// that it cannot be done before it is heard.
class Training {
 public:
  /// Returns when the program says `until`.
  Training(const TemporaryFolder& folder, const std::string& arguments, const std::string& until) {
    int ends[2];
    REQUIRE(::pipe2(ends, O_CLOEXEC) == 0);
    REQUIRE(::fcntl(ends[1], F_SETPIPE_SZ, 4096) == 4096);
    const std::string at = (folder / "").string();
    const std::string command =
        "cd '" + at + "' && TMPDIR='" + at + "' exec '" RBRES_TRAIN "' " + arguments + " 2> .err";
    child_ = ::fork();
    REQUIRE(child_ >= 0);
    if (child_ == 0) {
      ::dup2(ends[1], STDOUT_FILENO);
      ::execl("/bin/sh", "sh", "-c", command.c_str(), nullptr);
      ::_exit(127);
    }
    ::close(ends[1]);
    output_ = ends[0];
    hear(until);
  }
  Training(const Training&) = delete;
  Training& operator=(const Training&) = delete;

  /// What it says up to there.
  std::string hear(const std::string& until) {
    std::string heard;
    for (char c; !contains(heard, until) && ::read(output_, &c, 1) == 1;) heard += c;
    REQUIRE(contains(heard, until));
    return heard;
  }
  /// From now on its files can grow to so many bytes only.
  void limit_files(rlim_t size) {
    rlimit limit{};
    REQUIRE(::prlimit(child_, RLIMIT_FSIZE, nullptr, &limit) == 0);
    limit.rlim_cur = size;
    REQUIRE(::prlimit(child_, RLIMIT_FSIZE, &limit, nullptr) == 0);
  }
  void kill() {
    ::kill(child_, SIGKILL);
    REQUIRE(WIFSIGNALED(ended()));
  }
  /// Hears it out; its exit status.
  int finish() {
    for (char rest[256]; ::read(output_, rest, sizeof rest) > 0;) {
    }
    const int status = ended();
    REQUIRE(WIFEXITED(status));
    return WEXITSTATUS(status);
  }

 private:
  int ended() {
    ::close(output_);
    int status = 0;
    REQUIRE(::waitpid(child_, &status, 0) == child_);
    return status;
  }

  pid_t child_;
  int output_;
};
