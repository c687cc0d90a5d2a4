#include "io_reseal.hpp"
#include "io_support.hpp"

#include <cstring>
#include <limits>
#include <map>

#include <rbres/core/philox.hpp>
#include <rbres/dynamics/integrators.hpp>
#include <rbres/io/transitions.hpp>

using namespace rbres;

namespace {

// A box that slides on a floor and a ball that flies into it: impacts and resting contacts.
System<double, 2> world_of(double mass = 1, double friction = 0.4, double height = 0) {
  const Material<double> wood{.restitution = 0.2, .friction = friction};
  return {{Body<double>{Box{0.1, 0.08, 0.05}, mass, wood}, Body<double>{Sphere{0.06}, 0.5, wood}},
          {{{0, 0, 1}, height, wood}}};
}
const auto world = world_of();
const std::ptrdiff_t count = 41;
const SimulationOptions options{.step = 5e-3, .duration = 0.05};
const auto forces = Forces{Gravity{}, Damping{0.1, 0.2}};

auto start_of(std::uint64_t seed) {
  return [seed](std::ptrdiff_t i) {
    Random draw(seed, static_cast<std::uint64_t>(i));
    Start<2> s;
    s.state[0].position = {0, 0, 0.05};
    s.state[0].velocity = {draw.uniform(-1, 1), draw.uniform(-1, 1), 0};
    s.state[1].position = {0.2, draw.uniform(-0.1, 0.1), draw.uniform(0.06, 0.2)};
    s.state[1].velocity = {draw.uniform(-2, 0), 0, 0};
    s.wrench[0] = {{draw.uniform(-5, 5), 0, 0}, {0, 0, draw.uniform(-0.1, 0.1)}};
    return s;
  };
}

struct Stop {};

/// Makes the data set; stops (throws) where at least `stop` transitions are done.
void make(const std::filesystem::path& path, std::ptrdiff_t stop = count + 1, std::ptrdiff_t piece = 12,
          int threads = 1) {
  write_transitions(path, world, forces, Rk4{}, count, start_of(7), options,
                    {.starts = "slides 1", .seed = 7, .piece = piece, .threads = threads},
                    [&](std::ptrdiff_t done) {
                      if (done >= stop) throw Stop();
                    });
}

std::map<std::string, std::string> files(const std::filesystem::path& folder) {
  std::map<std::string, std::string> result;
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    result[entry.path().filename().string()] = read_bytes(entry.path());
  return result;
}

std::string digest(const std::string& bytes) {
  Sha256 hash;
  hash.add(bytes.data(), bytes.size());
  return hash.text();
}

std::string read_error(const std::filesystem::path& path) {
  return error_of([&] { read_transitions(path, world, forces); });
}

/// The text with the first `from` replaced.
std::string replaced(std::string text, const std::string& from, const std::string& to) {
  REQUIRE(contains(text, from));
  return text.replace(text.find(from), from.size(), to);
}

template <class T>
bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

}  // namespace

TEST_CASE("what is read is what simulate_transitions gives, for any pieces and threads") {
  const TemporaryFolder folder;
  const auto all = simulate_transitions(world, forces, Rk4{}, count, start_of(7), options);
  CHECK(std::ranges::count(all.collided, 1) > 5);  // or it would prove little
  make(folder / "a/b");
  const auto first = files(folder / "a/b");
  CHECK(first.size() == 5);
  CHECK(first.at("start.npy").size() == 128 + 8 * 26 * static_cast<std::size_t>(count));
  const auto read = read_transitions(folder / "a/b", world, forces);
  CHECK(read.horizon == 0.05);
  CHECK(same_bits(read.starts, all.starts));
  CHECK(same_bits(read.ends, all.ends));
  CHECK(read.collided == all.collided);
  for (const auto& [piece, threads] : {std::pair{1, 1}, {5, 1}, {1000, 1}, {7, 2}, {1000, 4}}) {
    const auto path = folder / (std::to_string(piece) + "-" + std::to_string(threads)).c_str();
    make(path, count + 1, piece, threads);
    CHECK(files(path) == first);
  }
}

TEST_CASE("stopped and resumed is unbroken, with other pieces too") {
  const TemporaryFolder folder;
  make(folder / "unbroken");
  const auto unbroken = files(folder / "unbroken");
  for (const std::ptrdiff_t stop : {0, 1, 20, 41}) {
    CAPTURE(stop);
    const auto path = folder / std::to_string(stop).c_str();
    CHECK_THROWS_AS(make(path, stop, 8), Stop);
    CHECK(contains(read_error(path), "all of its 41 transitions done, found "));
    if (stop > 0)  // a kill amid a piece leaves more than was done in some files
      std::ofstream(AtomicFile::partial(path / "end.npy"), std::ios::app) << "half a piece";
    if (stop == count)  // and one amid the last step some arrays in their places
      std::filesystem::rename(AtomicFile::partial(path / "wrench.npy"), path / "wrench.npy");
    make(path, count + 1, 16);
    CHECK(files(path) == unbroken);
  }
  make(folder / "unbroken");  // nothing to do
  CHECK(files(folder / "unbroken") == unbroken);
}

TEST_CASE("a piece that was cut or changed is not gone on with") {
  const TemporaryFolder folder;
  const auto path = folder / "half";
  CHECK_THROWS_AS(make(path, 24), Stop);
  for (const auto& entry : files(path)) {
    const std::string &name = entry.first, &bytes = entry.second;
    if (name == "dataset.json") continue;
    CAPTURE(name);
    const auto refused = [&, file = path / name.c_str()](const std::string& changed, const char* why) {
      write_bytes(file, changed);
      CHECK(contains(error_of([&] { make(path); }), file.string() + why));
    };
    refused(bytes.substr(0, bytes.size() - 1), ": expected at least ");
    std::string changed = bytes;
    changed[bytes.size() - 1] = static_cast<char>(changed[bytes.size() - 1] ^ 1);
    refused(changed, ": SHA-256 digest: expected ");
    write_bytes(path / name.c_str(), bytes);
  }
  make(path);
  CHECK(read_error(path) == "");
}

TEST_CASE("another world, other forces, starts or options are refused, and nothing is overwritten") {
  const TemporaryFolder folder;
  const auto path = folder / "a";
  make(path);
  const auto before = files(path);
  const auto write = [&](const auto& system, const auto& model, const auto& start, std::ptrdiff_t n = count,
                         const SimulationOptions& run = options, TransitionSetOptions set = {"slides 1", 7}) {
    return error_of([&] { write_transitions(path, system, model, Rk4{}, n, start, run, set); });
  };
  const auto read = [&](const auto& system, const auto& model) {
    return error_of([&] { read_transitions(path, system, model); });
  };
  const Body<double> ball{Sphere{0.1}, 1.0};
  const System<double, 1> one{{ball}, {floor_plane<double>()}};
  const auto one_start = [](std::ptrdiff_t) {
    Start<1> s;
    s.state[0].position.z = 1;
    return s;
  };
  const auto moon = Forces{Gravity{Vec3{0.0, 0.0, -1.6}}, Damping{0.1, 0.2}};
  const auto start = start_of(7);
  auto tight = options, longer = options, discrete = options;
  tight.step = 1e-3, longer.duration = 0.2, discrete.contacts = ContactMode::discrete;
  CHECK(write(world, forces, start) == "");
  for (const auto& [error, expected] : std::vector<std::pair<std::string, std::string>>{
           {write(one, Gravity{}, one_start), ": body_count: expected 1, found 2"},
           {read(one, Gravity{}), ": body_count: expected 1, found 2"},
           {write(world_of(2), forces, start), ": bodies[0], mass: expected 2.0, found 1.0"},
           {read(world_of(2), forces), ": bodies[0], mass: expected 2.0, found 1.0"},
           {read(world_of(1, 0.3), forces),
            ": bodies[0], restitution_friction: expected [0.2,0.3], found [0.2,0.4]"},
           {read(world_of(1, 0.4, -1), forces), ": planes[0], offset: expected -1.0, found 0.0"},
           {read(world, moon), ": forces[0], g: expected [0.0,0.0,-1.6], found [0.0,0.0,-9.81]"},
           {read(System<double, 2>({world[1], world[0]}, world.planes()), forces),
            R"(: bodies[0], shape: expected {"sphere":0.06}, found {"box":[0.1,0.08,0.05]})"},
           {read(System<double, 2>({world[0], world[1]}, world.planes(), {{0, 1}}), forces),
            ": without_contact: expected [[0,1]], found []"},
           {write(world, forces, start, 42), ": transitions: expected 42, found 41"},
           {write(world, forces, start, count, tight), ": step: expected 0.001, found 0.005"},
           {write(world, forces, start, count, longer), ": horizon: expected 0.2, found 0.05"},
           {write(world, forces, start, count, discrete),
            R"(: contacts: expected "discrete", found "continuous")"},
           {write(world, forces, start, count, options, {"slides 2", 7}),
            R"(: starts: expected "slides 2", found "slides 1")"},
           {write(world, forces, start, count, options, {"slides 1", 8}), ": seed: expected 8, found 7"}}) {
    CHECK(contains(error, path.string() + expected));
  }
  // Whatever the words say, the same functions give the same first transitions.
  CHECK(contains(write(world, forces, start_of(8)), ": first_transitions: expected "));
  CHECK(files(path) == before);
  CHECK(contains(write(world, forces, start, 0), "number of transitions: expected 1 or more, found 0"));
  CHECK(contains(write(world, forces, start, count, options, {.starts = "\xff"}), "expected UTF-8"));
  SimulationOptions bad = options;
  bad.duration = 0;
  CHECK(contains(write(world, forces, start, count, bad, {}),
                 "duration of transitions: expected more than 0 s"));
  bad.duration = std::numeric_limits<double>::quiet_NaN();
  CHECK(contains(write(world, forces, start, count, bad, {}), "duration: expected"));
  const auto endless = Forces{Gravity{Vec3{0.0, 0.0, -HUGE_VAL}}, Damping{0.1, 0.2}};
  CHECK(contains(write(world, endless, start),
                 "setting of a data set: /forces/0/g/2: expected a finite number"));
  CHECK(contains(error_of([&] {
                   write_transitions(folder / "d", world, forces, Rk4{}, 2, start, options,
                                     {.starts = std::string(2'000'000, 'x')});
                 }),
                 "dataset.json: expected at most a megabyte, found 2"));
  CHECK(!std::filesystem::exists(folder / "d/dataset.json"));
  CHECK(contains(write(world, forces, start, count, options, {.piece = 0}), "transitions of a piece"));

  write_bytes(folder / "b", "");
  std::filesystem::create_directory(folder / "c");
  write_bytes(folder / "c/start.npy", "someone's");
  CHECK(contains(error_of([&] { make(folder / "c"); }), "found one that holds start.npy"));
  CHECK(contains(error_of([&] { make(folder / "b/c"); }), "cannot be made"));
}

TEST_CASE("own force models are known by what they do") {
  const TemporaryFolder folder;
  const auto pull = [](double newton) {
    return [newton](const auto& body, const auto& state) {
      using S = typename std::decay_t<decltype(body)>::Scalar;
      return Wrench<S>{-as<S>(newton) * state.position, {}};
    };
  };
  const auto write = [&](double newton) {
    return error_of(
        [&] { write_transitions(folder / "a", world, pull(newton), Rk4{}, 5, start_of(1), options); });
  };
  CHECK(write(1) == "");
  CHECK(write(1) == "");
  CHECK(contains(write(2), ": first_transitions: expected "));
  CHECK(error_of([&] { read_transitions(folder / "a", world, pull(1)); }) == "");
  CHECK(contains(error_of([&] { read_transitions(folder / "a", world, Gravity{}); }),
                 R"(: forces[0], force: expected "gravity", found "own")"));
}

TEST_CASE("other formats, kinds and builds, and broken files are refused with why") {
  const TemporaryFolder folder;
  const auto path = folder / "a";
  CHECK(contains(read_error(path), path.string() + "/dataset.json: cannot read"));
  make(path);
  const auto before = files(path);
  const std::string& valid = before.at("dataset.json");
  const auto error_with = [&](const std::string& description) {
    write_bytes(path / "dataset.json", resealed(description));
    return read_error(path);
  };
  CHECK(contains(
      error_with(replaced(replaced(valid, "\"format\": 1", "\"format\": 2"), "rbres 0.", "rbres 9.")),
      "dataset.json: format: expected 1, found 2: \"rbres 9.1.0\" wrote it"));
  CHECK(contains(error_with(replaced(valid, "\"kind\": \"transitions\"", "\"kind\": \"scenarios\"")),
                 "expected a data set of transitions, found \"scenarios\""));
  CHECK(contains(error_of([&] { make(path); }), "expected a data set of transitions, found "));
  CHECK(contains(error_with(replaced(valid, "\"done\": 41", "\"done\": 42")), "found 42"));
  CHECK(contains(error_with(replaced(valid, digest(before.at("end.npy")), "")), "end.npy: SHA-256 digest"));
  CHECK(contains(error_with(replaced(valid, "\"" + digest(before.at("end.npy")) + "\"", "5")),
                 "arrays: expected a digest of each, found 5"));
  CHECK(contains(error_with(replaced(valid, "\"horizon\": 0.05", "\"horizon\": -0.05")),
                 ": horizon: expected a positive number, found -0.05"));
  CHECK(contains(error_with(replaced(valid, "\"horizon\": 0.05", "\"horizon\": \"0.05\"")),
                 "horizon: expected a number, found string"));
  CHECK(error_with(valid) == "");
  write_bytes(path / "dataset.json", replaced(valid, "slides", "slimes"));
  CHECK(contains(read_error(path), "dataset.json: SHA-256 digest: expected"));
  write_bytes(path / "dataset.json", valid);

  const std::string lanes = "\"lanes\": " + std::to_string(detail::double_lanes);
  write_bytes(path / "dataset.json", resealed(replaced(valid, lanes, "\"lanes\": 64")));
  CHECK(read_error(path) == "");  // done: nothing is mixed
  CHECK_THROWS_AS(make(folder / "half", 12), Stop);
  const std::string half = read_bytes(folder / "half/dataset.json");
  write_bytes(folder / "half/dataset.json", resealed(replaced(half, lanes, "\"lanes\": 64")));
  CHECK(contains(error_of([&] { make(folder / "half"); }), "half: build: expected {\"lanes\":"));
  constexpr int piece = (12 + detail::double_lanes - 1) / detail::double_lanes * detail::double_lanes;
  write_bytes(folder / "half/dataset.json",
              resealed(replaced(half, "\"done\": " + std::to_string(piece), "\"done\": 13")));
  CHECK(
      contains(error_of([&] { make(folder / "half"); }), "half: done: expected samples done piece by piece"));

  write_bytes(path / "dataset.json", valid);
  for (const auto& entry : before) {
    const std::string &name = entry.first, &bytes = entry.second;
    for (const std::string& broken :
         {bytes.substr(0, bytes.size() / 2), bytes.substr(0, 100), std::string()}) {
      CAPTURE(name);
      write_bytes(path / name.c_str(), broken);
      CHECK(contains(read_error(path), (path / name.c_str()).string()));
      write_bytes(path / name.c_str(), bytes);
    }
  }
}

TEST_CASE("hostile arrays are refused, whoever sealed them") {
  const TemporaryFolder folder;
  const auto path = folder / "a";
  make(path);
  const auto before = files(path);
  const auto error_with = [&](const char* name, const std::string& bytes) {
    write_bytes(path / name, bytes);
    write_bytes(path / "dataset.json",
                resealed(replaced(before.at("dataset.json"), digest(before.at(name)), digest(bytes))));
    const std::string error = read_error(path);
    write_bytes(path / name, before.at(name));
    return error;
  };
  const std::string& start = before.at("start.npy");
  CHECK(contains(error_with("start.npy", replaced(start, "(41, 2, 13)", "(82, 1, 13)")),
                 "start.npy: expected the shape [41,2,13], found [82,1,13]"));
  CHECK(contains(error_with("start.npy", replaced(start, "(41, 2, 13)", "(41, 9, 13)")),
                 "start.npy: expected 38376 bytes"));
  CHECK(contains(error_with("start.npy", replaced(start, "<f8", "<i8")), "start.npy: expected dtype <f8"));
  const auto with = [&](const char* name, auto number) {
    std::string bytes = before.at(name);
    std::memcpy(bytes.data() + 128, &number, sizeof number);
    return error_with(name, bytes);
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(contains(with("start.npy", nan), "a: transition 0: position x: expected a finite number"));
  CHECK(contains(with("end.npy", nan), "a: transition 0: position x: expected a finite number"));
  CHECK(contains(with("wrench.npy", nan), "a: transition 0: wrench: expected finite numbers"));
  CHECK(
      contains(with("collided.npy", std::uint8_t{2}), "a: transition 0: collided: expected 0 or 1, found 2"));
  CHECK(with("end.npy", 0.25) == "");
}
