#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstring>
#include <limits>
#include <utility>

#include "io_checkpoint_run.hpp"
#include "io_file_size_limit.hpp"
#include "io_reseal.hpp"
#include "io_support.hpp"

using namespace rbres;

namespace {

/// io_checkpoint_child, its standard output on a pipe.
class Child {
 public:
  Child(const std::filesystem::path& checkpoint, const std::filesystem::path& result, int last_call = 0) {
    REQUIRE(::pipe(pipe_) == 0);
    const std::string call = std::to_string(last_call);
    process_ = ::fork();
    if (process_ == 0) {
      ::dup2(pipe_[1], STDOUT_FILENO);
      ::close(pipe_[0]);
      ::execl(RBRES_CHECKPOINT_CHILD, RBRES_CHECKPOINT_CHILD, checkpoint.c_str(), result.c_str(),
              call.c_str(), nullptr);
      ::_exit(127);
    }
    ::close(pipe_[1]);
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  /// Reads the dots of `epochs` epochs; false when the child ended before.
  bool wait_for(int epochs) {
    char dot;
    while (epochs > 0 && ::read(pipe_[0], &dot, 1) == 1) --epochs;
    return epochs == 0;
  }
  void kill() { ::kill(process_, SIGKILL); }

  /// True when it ended well, false when it was killed; fails when it ended otherwise.
  bool ended_well() {
    int status = 0;
    REQUIRE(::waitpid(process_, &status, 0) == process_);
    ::close(pipe_[0]);
    const bool killed = WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL;
    REQUIRE((killed || (WIFEXITED(status) && WEXITSTATUS(status) == 0)));
    return !killed;
  }

 private:
  int pipe_[2];
  pid_t process_;
};

std::string uninterrupted(const TemporaryFolder& folder) {
  REQUIRE(Child(folder / "whole", folder / "whole-result").ended_well());
  return read_bytes(folder / "whole-result");
}

template <class Net>
bool same_bits(const Net& a, const Net& b) {
  return std::memcmp(a.parameters().data(), b.parameters().data(), a.parameters().size_bytes()) == 0;
}

}  // namespace

TEST_CASE("killed in the middle of any call that writes, a run resumes and ends with the same bits") {
  const TemporaryFolder folder;
  const std::string expected = uninterrupted(folder);
  REQUIRE(expected.size() > 1000);
  int calls = 0;
  for (bool killed = true; killed; ++calls) {
    const auto checkpoint = folder / "checkpoint", result = folder / "result";
    std::filesystem::remove(checkpoint);
    std::filesystem::remove(result);
    killed = !Child(checkpoint, result, calls + 1).ended_well();
    CHECK(std::filesystem::exists(result) != killed);
    if (killed) REQUIRE(Child(checkpoint, result).ended_well());
    CAPTURE(calls);
    CHECK(read_bytes(result) == expected);
  }
  CHECK(calls > 6 * 19);  // 16 tensors, their header, a flush and a rename in each of 6 epochs
}

TEST_CASE("killed again and again from outside, a run ends with the same bits") {
  const TemporaryFolder folder;
  const std::string expected = uninterrupted(folder);
  for (int epochs = 0; epochs < 3; ++epochs) {
    const auto checkpoint = folder / "checkpoint", result = folder / "result";
    std::filesystem::remove(checkpoint);
    int kills = 0;
    while (true) {
      Child child(checkpoint, result);
      // One epoch more each time, so that it comes to an end wherever the signal hits.
      if (child.wait_for(epochs + kills)) child.kill();
      if (child.ended_well()) break;
      ++kills;
    }
    CHECK(kills > 0);
    CHECK(read_bytes(result) == expected);
  }
}

TEST_CASE("a resumed run has the same state, and a stopped one goes on") {
  const TemporaryFolder folder;
  const auto path = folder / "checkpoint";
  const SmallRun run;
  auto whole = run.trainer();
  CHECK(whole.train() == TrainingStatus::finished);

  auto first = run.trainer();
  save_checkpoint(path, first);  // before the first epoch
  load_checkpoint(path, first);
  int epochs = 0;
  CHECK(first.train([&](const EpochReport&) { return ++epochs < 3; }) == TrainingStatus::stopped);
  save_checkpoint(path, first, {{"data", "squares"}});
  auto second = run.trainer();
  load_checkpoint(path, second, {{"data", "squares"}});
  CHECK(same_bits(second.network(), first.network()));
  CHECK(same_bits(second.best(), first.best()));
  CHECK(second.train() == TrainingStatus::finished);
  CHECK(same_bits(second.network(), whole.network()));
  CHECK(same_bits(second.best(), whole.best()));
  CHECK(second.state().progress.best_loss == whole.state().progress.best_loss);
  CHECK(second.state().progress.step == whole.state().progress.step);

  save_checkpoint(path, second);
  load_checkpoint(path, first);
  CHECK(first.state().progress.status == TrainingStatus::finished);
}

TEST_CASE("a checkpoint of another run is refused with both") {
  const TemporaryFolder folder;
  const auto path = folder / "checkpoint";
  SmallRun run;
  auto trainer = run.trainer();
  save_checkpoint(path, trainer, {{"data", "squares"}});
  CHECK(contains(error_of([&] {
                   load_checkpoint(path, trainer, {{"data", "cubes"}});
                 }),
                 path.string() + ": metadata 'data': expected 'cubes', found 'squares'"));
  CHECK(contains(error_of([&] {
                   load_checkpoint(path, trainer, {{"more", ""}});
                 }),
                 "metadata 'more': expected '', found none"));
  for (const char* key : {"architecture", "scalar", "options", "sha256"}) {
    CAPTURE(key);
    const std::string expected = detail::text("keys that leave its own alone, found '", key, "'");
    CHECK(contains(error_of([&] { save_checkpoint(path, trainer, {{key, "mine"}}); }), expected));
    CHECK(contains(error_of([&] { load_checkpoint(path, trainer, {{key, "mine"}}); }), expected));
  }
  run.options.seed = 4;
  auto other_options = run.trainer();
  const std::string error = error_of([&] { load_checkpoint(path, other_options); });
  CHECK(contains(error, "metadata 'options'"));
  CHECK(contains(error, "seed 4', found"));
  CHECK(contains(error, "seed 3'"));
  using Other = Network<float, Sequential<Linear<4, 9>, Tanh, Dropout, Linear<9, 4>>>;
  Trainer other(Other(5), {{run.inputs.data(), 4, 40}, {run.targets.data(), 4, 40}},
                {{nullptr, 4, 0}, {nullptr, 4, 0}});
  CHECK(contains(error_of([&] { load_checkpoint(path, other); }), "metadata 'architecture'"));
}

TEST_CASE("a checkpoint of another optimiser, of other settings or of other samples is refused") {
  const TemporaryFolder folder;
  const auto path = folder / "checkpoint";
  SmallRun run;
  auto trainer = run.trainer();
  trainer.run_epoch();
  save_checkpoint(path, trainer);
  const auto check_refused = [&](auto other) {
    const auto before = other.network();
    CHECK(contains(error_of([&] { load_checkpoint(path, other); }), path.string() + ": metadata 'options'"));
    CHECK(same_bits(other.network(), before));
  };
  check_refused(run.trainer(AdamW{}));  // of as many moments
  check_refused(run.trainer(Sgd{}));
  check_refused(run.trainer(Adam{.beta1 = 0.8}));
  run.options.l2 += 1e-18;
  check_refused(run.trainer());
  run.options = SmallRun{}.options;
  for (float* number : {&run.inputs(0, 0), &run.targets(3, 31), &run.inputs(1, 32), &run.targets(2, 39)}) {
    const float right = std::exchange(*number, 0.25f);
    check_refused(run.trainer());
    *number = right;
  }
  auto same = run.trainer();
  CHECK(error_of([&] { load_checkpoint(path, same); }) == "");
  CHECK(same_bits(same.network(), trainer.network()));
}

TEST_CASE("a run with more epochs goes on, but not down a cosine of another length") {
  const TemporaryFolder folder;
  const auto path = folder / "checkpoint";
  SmallRun run;
  for (const auto kind : {Schedule::Kind::constant, Schedule::Kind::cosine}) {
    run.options.schedule.kind = kind;
    run.options.epochs = 6;
    auto first = run.trainer();
    first.train();
    save_checkpoint(path, first);
    run.options.epochs = 9;
    auto second = run.trainer();
    const std::string error = error_of([&] { load_checkpoint(path, second); });
    if (kind == Schedule::Kind::constant) {
      CHECK(error == "");
      continue;
    }
    CHECK(contains(error, path.string() + ": metadata 'options'"));
    CHECK(contains(error, "over 9 epochs"));
    CHECK(contains(error, "over 6 epochs"));
  }
}

TEST_CASE("losses that are NaN, as where nothing validates, come back with the others") {
  const TemporaryFolder folder;
  const auto path = folder / "checkpoint";
  const SmallRun run;
  const Samples<float> all{columns(run.inputs), columns(run.targets)}, none;
  const auto fresh = [&] { return Trainer(SmallRun::Net(5), all, none, run.options); };
  auto trainer = fresh(), other = fresh();
  trainer.run_epoch();
  trainer.run_epoch();
  save_checkpoint(path, trainer);
  load_checkpoint(path, other);
  REQUIRE(other.state().history.size() == 2);
  CHECK(std::isnan(other.state().history[1].validation_loss));
  CHECK(std::memcmp(other.state().history.data(), trainer.state().history.data(), 2 * sizeof(EpochLosses)) ==
        0);
}

TEST_CASE("a diverged run leaves the checkpoint of its last good epoch") {
  const TemporaryFolder folder;
  const auto path = folder / "checkpoint";
  SmallRun run;
  run.options.schedule = {.kind = Schedule::Kind::constant, .initial = 1e30};
  auto trainer = run.trainer();
  save_checkpoint(path, trainer);
  const std::string before = read_bytes(path);
  while (trainer.state().progress.status == TrainingStatus::running) trainer.run_epoch();
  REQUIRE(trainer.state().progress.status == TrainingStatus::diverged);
  save_checkpoint(path, trainer);
  CHECK(read_bytes(path) == before);
}

TEST_CASE("on a full disk the previous checkpoint survives") {
  const TemporaryFolder folder;
  const auto path = folder / "checkpoint";
  const SmallRun run;
  auto trainer = run.trainer();
  trainer.run_epoch();
  save_checkpoint(path, trainer);
  const std::string before = read_bytes(path);
  trainer.run_epoch();
  std::string error;
  {
    const FileSizeLimit limit(before.size() - 100);
    error = error_of([&] { save_checkpoint(path, trainer); });
  }
  CHECK(contains(error, path.string() + ": cannot write: "));
  CHECK(read_bytes(path) == before);
}

TEST_CASE("malformed checkpoints are refused and change nothing") {
  const TemporaryFolder folder;
  const auto path = folder / "checkpoint";
  const SmallRun run;
  auto trainer = run.trainer();
  save_checkpoint(path, trainer);
  const std::string valid = read_bytes(path);
  auto target = run.trainer();
  target.run_epoch();
  const auto before = target.network();
  const auto read = [&](const auto& p) { load_checkpoint(p, target); };
  check_other_lengths_refused(path, valid, read);
  // The eight-byte numbers of the progress stand first in the data.
  std::uint64_t header = 0;
  std::memcpy(&header, valid.data(), 8);
  const auto changed = [&](std::size_t number, std::uint64_t value) {
    std::string bytes = valid;
    std::memcpy(bytes.data() + 8 + header + 8 * number, &value, 8);
    if (bytes != valid) {
      write_bytes(path, bytes);
      CHECK(contains(error_of([&] { read(path); }), path.string() + ": SHA-256 digest"));
    }
    write_bytes(path, resealed(bytes));
    return error_of([&] { read(path); });
  };
  CHECK(contains(changed(0, 7), "expected the progress of a run"));  // epochs of 6
  CHECK(contains(changed(2, 1), "expected the progress of a run"));  // best epoch after the newest
  CHECK(contains(changed(3, ~0ull), "expected the progress of a run"));
  CHECK(contains(changed(4, 4), "expected the progress of a run"));  // diverged
  CHECK(contains(changed(4, 1ull << 32), "expected the progress of a run"));
  // Best weights, moments and newest weights follow: the last moment is read last.
  std::string bytes = valid;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::memcpy(bytes.data() + 8 + header + 5 * 8 + (3 * SmallRun::Net::parameter_count - 1) * 4, &nan, 4);
  write_bytes(path, resealed(bytes));
  CHECK(contains(error_of([&] { read(path); }), "tensor 'moments.1."));
  CHECK(same_bits(target.network(), before));
  CHECK(changed(0, 0) == "");
  CHECK(!same_bits(target.network(), before));
}
