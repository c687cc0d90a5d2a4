// io_checkpoint_child CHECKPOINT RESULT [CALL]: trains with a checkpoint per epoch, goes on from one that is
// there, and writes the final state to RESULT. Prints a dot per epoch. With CALL it kills itself in the
// middle of that call, counted from 1, of the system's functions that write.
#include <fcntl.h>
#include <signal.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <iostream>

#include "io_checkpoint_run.hpp"

namespace {

int calls = 0, last_call = 0;

bool is_last() { return ++calls == last_call; }

}  // namespace

// These stand before the C library's.
extern "C" ssize_t pwrite(int file, const void* data, size_t size, off_t offset) {
  const bool last = is_last();
  const ssize_t done = ::syscall(SYS_pwrite64, file, data, last ? size / 2 : size, offset);
  if (last) ::raise(SIGKILL);
  return done;
}
extern "C" int fsync(int) {
  if (is_last()) ::raise(SIGKILL);
  return 0;  // what is written outlives the process without the disk, whose thousands of flushes would take a
             // while
}
extern "C" int rename(const char* from, const char* to) noexcept {
  if (is_last()) ::raise(SIGKILL);
  const int result = static_cast<int>(::syscall(SYS_renameat, AT_FDCWD, from, AT_FDCWD, to));
  if (is_last()) ::raise(SIGKILL);
  return result;
}

int main(int argc, char** argv) try {
  if (argc < 3) return 2;
  const std::string checkpoint = argv[1];
  if (argc > 3) last_call = std::atoi(argv[3]);
  const SmallRun run;
  auto trainer = run.trainer();
  if (std::filesystem::exists(checkpoint)) load_checkpoint(checkpoint, trainer);
  trainer.train([&](const rbres::EpochReport&) {
    save_checkpoint(checkpoint, trainer);
    std::cout << '.' << std::flush;
    return true;
  });
  last_call = 0;  // RESULT is no part of what is tested
  const auto& state = trainer.state();
  const auto& progress = state.progress;
  rbres::AtomicFile result(argv[2]);
  result.write(state.network.parameters().data(), state.network.parameters().size_bytes());
  result.write(state.best.parameters().data(), state.best.parameters().size_bytes());
  result.write(state.moments.data(), state.moments.size() * sizeof(float));
  result.write(&progress.step, sizeof progress.step);
  result.write(&progress.best_loss, sizeof progress.best_loss);
  result.commit();
} catch (const std::exception& error) {
  std::cerr << error.what() << '\n';
  return 1;
}
