#include "../examples/scenarios/compiled.hpp"
#include "io_file_size_limit.hpp"
#include "io_reseal.hpp"
#include "io_support.hpp"

#include <cstring>
#include <limits>
#include <map>

#include <rbres/io/scenario_data.hpp>

using namespace rbres;

namespace {

// The room's scenarios are drawn at once, those of free space until they fly apart. Two pieces and a bit.
const ScenarioSampler<BodySet::standard> sampler(World::room, 7);
const Eigen::Index count = 2 * detail::scenario_piece + 10;
const std::vector<double> horizons{0.02, 0.06};

const Eigen::Index few = 12;

struct Stop {};

/// Makes the data set; stops (throws) where `stop` scenarios are done.
void make(const std::filesystem::path& folder, Eigen::Index stop = -1, int threads = 0) {
  write_dataset(folder, sampler, count, horizons, {.threads = threads}, [&](Eigen::Index done) {
    if (done == stop) throw Stop();
  });
}

std::map<std::string, std::string> files(const std::filesystem::path& folder) {
  std::map<std::string, std::string> result;
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    result[entry.path().filename().string()] = read_bytes(entry.path());
  return result;
}

void check_equal(const ScenarioData& a, const ScenarioData& b) {
  CHECK(a.horizons == b.horizons);
  CHECK(a.initial == b.initial);
  CHECK(a.wrench == b.wrench);
  CHECK(a.states == b.states);
  CHECK(a.body_count == b.body_count);
  CHECK(a.family == b.family);
  CHECK(a.first_contact == b.first_contact);
  CHECK(a.impacts == b.impacts);
}

}  // namespace

TEST_CASE("what is read is what generate gives") {
  const TemporaryFolder folder;
  std::vector<Eigen::Index> heard;
  write_dataset(folder / "a/b", sampler, count, horizons, {},
                [&](Eigen::Index done) { heard.push_back(done); });
  CHECK(heard == std::vector<Eigen::Index>{0, 2304, 4608, 4618});
  const ScenarioData data = generate(sampler, 0, count, horizons);
  check_equal(read_dataset(folder / "a/b", sampler, count, horizons), data);
  // Fewer scenarios and horizons than it holds, by whole pieces: the same lanes.
  ScenarioData part = generate(sampler, 0, detail::scenario_piece, horizons);
  part.horizons.erase(part.horizons.begin());
  part.states.erase(part.states.begin());
  part.impacts = part.impacts.bottomRows(1).eval();
  CHECK(part.impacts.sum() > 20);  // or it would prove little
  check_equal(read_dataset(folder / "a/b", sampler, detail::scenario_piece, {0.06}), part);
}

TEST_CASE("the bytes are the same for any number of threads") {
  const TemporaryFolder folder;
  make(folder / "1", -1, 1);
  const auto one = files(folder / "1");
  CHECK(one.size() == 9);
  CHECK(one.at("initial.npy").size() == 128 + 4 * 65 * static_cast<std::size_t>(count));
  CHECK(one.at("family.npy").substr(128, 4) == std::string("\3\4\3\4"));
  for (const int threads : {2, 4}) {
    const auto path = folder / std::to_string(threads).c_str();
    make(path, -1, threads);
    CHECK(files(path) == one);
  }
}

TEST_CASE("stopped and resumed is unbroken") {
  const TemporaryFolder folder;
  make(folder / "unbroken");
  const auto unbroken = files(folder / "unbroken");
  for (const Eigen::Index stop : {Eigen::Index{0}, Eigen::Index{2304}, Eigen::Index{4608}, count}) {
    CAPTURE(stop);
    const auto path = folder / ("stop" + std::to_string(stop)).c_str();
    CHECK_THROWS_AS(make(path, stop), Stop);
    CHECK(!std::filesystem::exists(path / "initial.npy"));
    CHECK(!dataset_is_done(path));
    CHECK(contains(error_of([&] { read_dataset(path, sampler, count, horizons); }),
                   "4618 scenarios done, found "));
    if (stop > 0) {  // a kill amid a piece leaves more than was done in some files
      std::ofstream(AtomicFile::partial(path / "wrench.npy"), std::ios::app) << "half a piece";
    }
    if (stop == count) {  // and one amid the last step some arrays in their places
      std::filesystem::rename(AtomicFile::partial(path / "family.npy"), path / "family.npy");
    }
    std::vector<Eigen::Index> heard;
    write_dataset(path, sampler, count, horizons, {}, [&](Eigen::Index done) { heard.push_back(done); });
    CHECK(heard.front() == std::min<Eigen::Index>(stop, 4608));
    CHECK(files(path) == unbroken);
    CHECK(dataset_is_done(path));
  }
  make(folder / "unbroken");  // nothing to do
  CHECK(files(folder / "unbroken") == unbroken);
}

TEST_CASE("a full disk stops it, and with room it goes on") {
  const TemporaryFolder folder;
  {
    const FileSizeLimit limit(1'000'000);
    CHECK(contains(error_of([&] { make(folder / "a"); }), "cannot write: "));
  }
  make(folder / "a");
  check_equal(read_dataset(folder / "a", sampler, count, horizons), generate(sampler, 0, count, horizons));
}

TEST_CASE("folders of another setting, foreign and broken ones are refused, and nothing is overwritten") {
  const TemporaryFolder folder;
  const auto path = folder / "a";
  const auto write = [](const auto& from, const std::filesystem::path& to, Eigen::Index n = few,
                        const std::vector<double>& at = horizons, double step = 5e-3) {
    return error_of([&] { write_dataset(to, from, n, at, {.step = step}, [](Eigen::Index) {}); });
  };
  const auto read = [&](const auto& from, Eigen::Index n = few, const std::vector<double>& at = horizons) {
    return error_of([&] { read_dataset(path, from, n, at); });
  };
  CHECK(!dataset_is_done(path));
  CHECK(contains(read(sampler), path.string() + "/dataset.json: cannot read"));
  REQUIRE(write(sampler, path) == "");
  const auto before = files(path);
  using Standard = ScenarioSampler<BodySet::standard>;
  const ScenarioSampler<BodySet::box> boxes(World::room, 7);
  const Standard other_seed(World::room, 8), other_world(World::free_space, 7);
  for (const auto& [error, expected] : std::vector<std::pair<std::string, std::string>>{
           {write(other_world, path), ": world: expected \"free\", found \"room\""},
           {read(other_world), ": world: expected \"free\", found \"room\""},
           {write(boxes, path), ": set: expected \"box\", found \"standard\""},
           {read(boxes), ": set: expected \"box\", found \"standard\""},
           {write(other_seed, path), ": seed: expected 8, found 7"},
           {read(other_seed), ": seed: expected 8, found 7"},
           {write(sampler, path, few + 1), ": scenarios: expected 13, found 12"},
           {read(sampler, few + 1), ": scenarios: expected 1 to 12 to be read, found 13"},
           {read(sampler, 0), ": scenarios: expected 1 to 12 to be read, found 0"},
           {write(sampler, path, few, {0.02}), ": horizons: expected [0.02], found [0.02,0.06]"},
           {read(sampler, few, {0.04}), ": horizons: expected one of [0.02,0.06], found 0.04"},
           {write(sampler, path, few, horizons, 4e-3), ": truth_step: expected 0.004, found 0.005"}}) {
    CHECK(error == path.string() + expected);
  }
  CHECK(files(path) == before);
  CHECK(contains(write(sampler, folder / "b", 0), "number of scenarios"));
  CHECK(contains(write(sampler, folder / "b", few, {0.03}), "horizon 0"));
  CHECK(!std::filesystem::exists(folder / "b"));

  std::filesystem::create_directory(folder / "b");
  write_bytes(folder / "b/initial.npy", "someone's");
  CHECK(contains(write(sampler, folder / "b"),
                 "a data set or an empty folder, found one that holds initial.npy"));
  CHECK(contains(write(sampler, folder / "b/initial.npy/c"), "initial.npy/c: cannot be made"));
  CHECK(files(folder / "b").size() == 1);

  const auto refused = [&](const char* name, const std::string& bytes) {
    CAPTURE(name);
    write_bytes(path / name, bytes);
    CHECK(contains(read(sampler), (path / name).string()));
    write_bytes(path / name, before.at(name));
  };
  for (const auto& [name, bytes] : before) {
    refused(name.c_str(), bytes.substr(0, bytes.size() / 2));
    refused(name.c_str(), "");
  }
  refused("initial.npy", before.at("wrench.npy"));
  refused("body_count.npy", before.at("body_count.npy").substr(0, 128) + std::string(12, '\6'));
  refused("family.npy", before.at("family.npy").substr(0, 128) + std::string(12, '\5'));
  refused("dataset.json", "[]");
  refused("dataset.json", R"({"done": -1})");
  REQUIRE(read(sampler) == "");
  std::string version = before.at("dataset.json");
  version.replace(version.find("standard-3"), 10, "standard-0");
  write_bytes(path / "dataset.json", version);
  CHECK(contains(read(sampler), "dataset.json: SHA-256 digest: expected"));
  write_bytes(path / "dataset.json", resealed(version));
  CHECK(contains(read(sampler), R"(scenario_version: expected "standard-3", found "standard-0")"));
  CHECK(contains(write(sampler, path), R"(scenario_version: expected "standard-3", found "standard-0")"));
}

TEST_CASE("a data set of the format before, or that is half made by another build, is refused with why") {
  const TemporaryFolder folder;
  const auto path = folder / "a";
  write_dataset(path, sampler, few, horizons, {}, [](Eigen::Index) {});
  const std::string valid = read_bytes(path / "dataset.json");
  const auto replaced = [&](std::string bytes, const std::string& from, const std::string& to) {
    REQUIRE(contains(bytes, from));
    write_bytes(path / "dataset.json", resealed(bytes.replace(bytes.find(from), from.size(), to)));
  };
  const auto check_refused = [&](const std::string& why) {
    CHECK(contains(error_of([&] { read_dataset(path, sampler, few, horizons); }), why));
    CHECK(contains(error_of([&] { write_dataset(path, sampler, few, horizons, {}, [](Eigen::Index) {}); }),
                   why));
  };
  replaced(valid, "\"format\": 2", "\"format\": 1");
  check_refused(
      "dataset.json: format: expected 2, found 1: rbres 0.1.0 before digests made it, and truth of "
      "boxes that hit planes was wrong then");
  replaced(valid, "\"format\": 2", "\"format\": 3");
  check_refused("dataset.json: format: expected 2, found 3");
  replaced(valid, "continuous", "discrete");
  check_refused("contacts: expected \"continuous\", found \"discrete\"");
  const std::string lanes = "\"lanes\": " + std::to_string(detail::double_lanes);
  replaced(valid, lanes, "\"lanes\": 64");
  CHECK(error_of([&] { read_dataset(path, sampler, few, horizons); }) == "");  // done: nothing is mixed

  CHECK_THROWS_AS(make(folder / "half", 2304), Stop);
  const std::string half = read_bytes(folder / "half/dataset.json");
  write_bytes(folder / "half/dataset.json",
              resealed(std::string(half).replace(half.find(lanes), lanes.size(), "\"lanes\": 64")));
  CHECK(contains(error_of([&] { make(folder / "half"); }), "half: build: expected {\"lanes\":"));
  write_bytes(folder / "half/dataset.json", half);
  CHECK(error_of([&] { make(folder / "half"); }) == "");
}

TEST_CASE("scenarios that were changed are refused, read or resumed") {
  const TemporaryFolder folder;
  const auto path = folder / "half";
  CHECK_THROWS_AS(make(path, 2304), Stop);
  const auto before = files(path);
  for (const auto& entry : before) {
    const std::string &name = entry.first, &bytes = entry.second;
    if (name == "dataset.json") continue;
    for (const std::size_t at : {std::size_t{128}, bytes.size() / 2, bytes.size() - 1}) {
      CAPTURE(name);
      CAPTURE(at);
      std::string changed = bytes;
      changed[at] = static_cast<char>(changed[at] ^ 4);
      write_bytes(path / name.c_str(), changed);
      CHECK(contains(error_of([&] { make(path); }), (path / name).string() + ": SHA-256 digest: expected "));
    }
    write_bytes(path / name.c_str(), bytes.substr(0, bytes.size() - 1));
    CHECK(contains(error_of([&] { make(path); }), (path / name).string() + ": expected at least "));
    write_bytes(path / name.c_str(), bytes);
  }
  make(path);
  const auto whole = files(path);
  for (const auto& entry : whole) {
    const std::string &name = entry.first, &bytes = entry.second;
    CAPTURE(name);
    std::string changed = bytes;
    changed[bytes.size() / 2] = static_cast<char>(changed[bytes.size() / 2] ^ 4);
    write_bytes(path / name.c_str(), changed);
    CHECK(contains(error_of([&] { read_dataset(path, sampler, 1, horizons); }), (path / name).string()));
    write_bytes(path / name.c_str(), bytes);
  }
}

TEST_CASE("numbers that no scenario has are refused, whoever wrote them") {
  const TemporaryFolder folder;
  const auto path = folder / "a";
  write_dataset(path, sampler, few, horizons, {}, [](Eigen::Index) {});
  const auto before = files(path);
  const auto error_with = [&](const char* name, auto number) {
    std::string array = before.at(name), description = before.at("dataset.json");
    std::memcpy(array.data() + 128, &number, sizeof number);
    const auto digest = [](const std::string& bytes) {
      Sha256 hash;
      hash.add(bytes.data(), bytes.size());
      return hash.text();
    };
    description.replace(description.find(digest(before.at(name))), 64, digest(array));
    write_bytes(path / name, array);
    write_bytes(path / "dataset.json", resealed(description));
    const std::string error = error_of([&] { read_dataset(path, sampler, few, horizons); });
    write_bytes(path / name, before.at(name));
    return error;
  };
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const char* name : {"initial.npy", "wrench.npy", "state_0.02s.npy"}) {
    for (const float x : {nan, std::numeric_limits<float>::infinity(), -1e30f})
      CHECK(
          contains(error_with(name, x), (path / name).string() + ": scenario 0: expected numbers up to 1e6"));
  }
  CHECK(contains(error_with("first_contact.npy", nan), "expected times of 0 s or more, found nan"));
  CHECK(contains(error_with("first_contact.npy", -1.0f), "expected times of 0 s or more, found -1"));
  CHECK(contains(error_with("impacts.npy", std::int32_t{-1}), "expected numbers of 0 or more, found -1"));
  CHECK(contains(error_with("body_count.npy", std::uint8_t{6}), "3 to 5 bodies, found 6"));
  CHECK(contains(error_with("family.npy", std::uint8_t{5}), "families 0 to 4, found 5"));
  CHECK(error_with("first_contact.npy", 0.25f) == "");
}

TEST_CASE("two processes do not make one data set") {
  const TemporaryFolder folder;
  write_dataset(folder / "a", sampler, 5, horizons, {}, [&](Eigen::Index) {
    CHECK(contains(error_of([&] { make(folder / "a"); }), "another process makes this data set"));
  });
}
