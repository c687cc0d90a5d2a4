// Files that were changed anyhow, in one bit or in many, are refused: whatever is accepted means the
// original. RBRES_MUTATIONS says how many of each kind of file are tried (of half-made data sets, which take
// longer, half as many).
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <map>

#include "../examples/scenarios/compiled.hpp"
#include "io_checkpoint_run.hpp"
#include "io_support.hpp"

#include <rbres/io/predictor.hpp>
#include <rbres/io/scenario_data.hpp>

using namespace rbres;

namespace {

int mutations() {
  const char* asked = std::getenv("RBRES_MUTATIONS");
  return asked != nullptr ? std::atoi(asked) : 200;
}

std::uint32_t below(Random& random, std::size_t bound) {
  return random.below(static_cast<std::uint32_t>(bound));
}

/// Mostly one bit turned over; else a digit, a byte, a length, or a stretch that is zeroed or stands
/// elsewhere.
std::string mutated(std::string bytes, Random& random) {
  const std::size_t at = below(random, bytes.size());
  const std::size_t size = std::min<std::size_t>(1 + below(random, 64), bytes.size() - at);
  std::size_t digit = bytes.find_first_of("0123456789", at);
  if (digit == bytes.npos) digit = at;
  switch (below(random, 12)) {
    case 0:
      return bytes.substr(0, at);
    case 1:
      return bytes.insert(at, 1, static_cast<char>(below(random, 256)));
    case 2:
      return bytes.erase(at, size);
    case 3:
      return bytes.replace(at, size, size, '\0');
    case 4:
      return bytes.replace(at, size, bytes.substr(below(random, bytes.size() - size + 1), size));
    case 5:
      bytes[at] = static_cast<char>(below(random, 256));
      return bytes;
    case 6:
      bytes[digit] = static_cast<char>('0' + below(random, 10));
      return bytes;
    default:
      bytes[at] = static_cast<char>(bytes[at] ^ 1 << below(random, 8));
      return bytes;
  }
}

/// Mutates the file and reads it: refused by name, unless nothing was changed.
template <class Read>
void check_mutants_refused(const std::filesystem::path& path, std::uint64_t seed, const Read& read) {
  const std::string valid = read_bytes(path);
  REQUIRE(error_of([&] { read(path); }) == "");
  int refused = 0, changed = 0;
  for (int i = 0; i < mutations(); ++i) {
    Random random(seed, static_cast<std::uint64_t>(i));
    const std::string bytes = mutated(valid, random);
    write_bytes(path, bytes);
    const std::string error = error_of([&] { read(path); });
    changed += bytes != valid;
    refused += contains(error, path.parent_path().string());
    CAPTURE(i);
    CHECK(error.empty() == (bytes == valid));
  }
  CHECK(refused == changed);
  CHECK(changed > mutations() / 2);
  write_bytes(path, valid);
}

using Net = Network<float, Sequential<Linear<38, 6>, Relu, Linear<6, 26>>>;
using Two = Predictor<Net, 2>;

const ScenarioSampler<BodySet::standard> sampler(World::room, 7);
const std::vector<double> horizons{0.02, 0.06};

}  // namespace

TEST_CASE("models") {
  const TemporaryFolder folder;
  const auto path = folder / "model.safetensors";
  save(path, Net(42), {{"author", "me"}});
  check_mutants_refused(path, 1, [](const auto& p) { load<Net>(p); });
}

TEST_CASE("predictors") {
  const TemporaryFolder folder;
  const auto path = folder / "predictor.safetensors";
  const System<double, 2> system{{Body{Sphere{0.3}, 1.5}, Body{Box{0.1, 0.2, 0.3}, 2.5}}};
  save(path, Two{Net(3), {}, {}, {system, {}, {1.3, 0.5, 0.02}, {0.1, 0.2}}, Target::residual, 0.7});
  check_mutants_refused(path, 2, [](const auto& p) { load<Two>(p); });
}

TEST_CASE("checkpoints") {
  const TemporaryFolder folder;
  const auto path = folder / "checkpoint";
  const SmallRun run;
  auto trainer = run.trainer();
  trainer.run_epoch();
  save_checkpoint(path, trainer);
  auto other = run.trainer();
  check_mutants_refused(path, 3, [&](const auto& p) { load_checkpoint(p, other); });
}

TEST_CASE("data sets") {
  const TemporaryFolder folder;
  const auto path = folder / "set";
  write_dataset(path, sampler, 12, horizons, {}, [](Eigen::Index) {});
  std::uint64_t seed = 10;
  for (const auto& entry : std::filesystem::directory_iterator(path)) {
    CAPTURE(entry.path());
    check_mutants_refused(entry.path(), ++seed,
                          [&](const auto&) { read_dataset(path, sampler, 12, horizons); });
  }
  CHECK(seed == 19);
}

TEST_CASE("data sets that are half made, when they go on") {
  struct Stop {};
  const TemporaryFolder folder;
  const auto path = folder / "set";
  const Eigen::Index piece = detail::scenario_piece;
  const auto go_on = [&](Eigen::Index stop) {
    write_dataset(path, sampler, piece + 12, horizons, {}, [&](Eigen::Index done) {
      if (done == stop) throw Stop();
    });
  };
  CHECK_THROWS_AS(go_on(piece), Stop);
  std::vector<std::filesystem::path> arrays;
  for (const auto& entry : std::filesystem::directory_iterator(path))
    if (entry.path().filename() != "dataset.json") arrays.push_back(entry.path());
  REQUIRE(arrays.size() == 8);
  // One bit at a time, in place, of the numbers: the header is written anew in the end.
  int refused = 0;
  for (int i = 0; i < mutations() / 2; ++i) {
    Random random(4, static_cast<std::uint64_t>(i));
    const auto& array = arrays[below(random, arrays.size())];
    const std::size_t at = 128 + below(random, std::filesystem::file_size(array) - 128);
    const char bit = static_cast<char>(1 << below(random, 8));
    const auto turn = [&] {
      std::fstream file(array, std::ios::binary | std::ios::in | std::ios::out);
      file.seekg(static_cast<std::streamoff>(at));
      const char byte = static_cast<char>(file.get() ^ bit);
      file.seekp(static_cast<std::streamoff>(at));
      file.put(byte);
    };
    turn();
    refused += contains(error_of([&] { go_on(piece + 12); }), array.string() + ": SHA-256 digest");
    turn();
  }
  CHECK(refused == mutations() / 2);
  check_mutants_refused(path / "dataset.json", 5, [&](const auto&) {
    try {
      go_on(piece);
    } catch (const Stop&) {
    }
  });
}
