#include "io_reseal.hpp"
#include "io_support.hpp"

#include <cstring>

#include <rbres/io/predictor.hpp>

using namespace rbres;

namespace {

using Net = Network<float, Sequential<Linear<38, 4>, Relu, Linear<4, 26>>>;
using Two = Predictor<Net, 2>;

Two made() {
  const System<double, 2> system{
      {Body{Sphere{0.3}, 1.5, Vec3<double>{0.02, 0.03, 0.04}}, Body{Box{0.1, 0.2, 0.3}, 2.5}}};
  Two p{Net(3), {}, {}, {system, {{0, 0.1, -9}}, {1.3, 0.5, 0.02}, {0.1, 0.2}}, Target::state, 0.7};
  Random random(4);
  for (auto* numbers : {p.input.mean.data(), p.input.deviation.data()})
    for (int i = 0; i < 38; ++i) numbers[i] = static_cast<float>(random.uniform(0.1, 2));
  for (auto* numbers : {p.output.mean.data(), p.output.deviation.data()})
    for (int i = 0; i < 26; ++i) numbers[i] = static_cast<float>(random.uniform(0.1, 2));
  return p;
}

/// Saves the predictor with one entry of its metadata replaced, or taken out, and says what loading says.
std::string error_with(const std::filesystem::path& path, const std::string& key, const char* value) {
  SafetensorsWriter file;
  const Two p = made();  // must stay until the file is written
  ModelFormat<Two>::write(file, p);
  REQUIRE(file.metadata.contains(key));
  file.metadata.erase(key);
  if (value != nullptr) file.metadata[key] = value;
  file.write_with_digest(path);
  return error_of([&] { load<Two>(path); });
}

}  // namespace

TEST_CASE("a predictor comes back with the same bits, for either target") {
  const TemporaryFolder folder;
  for (const Target target : {Target::state, Target::residual}) {
    Two p = made();
    p.target = target;
    save(folder / "p.safetensors", p, {{"world", "mine"}});
    const Two back = load<Two>(folder / "p.safetensors");
    CHECK(std::memcmp(p.network.parameters().data(), back.network.parameters().data(),
                      p.network.parameters().size_bytes()) == 0);
    CHECK(back.target == target);
    CHECK(back.horizon == 0.7);
    CHECK(back.input.mean == p.input.mean);
    CHECK(back.output.deviation == p.output.deviation);
    Two::State y;
    y[1].velocity = {1, 2, 3};
    y[1].position = {4, 5, 6};
    Two::Wrenches w{};
    w[0].torque = {0.1, 0.2, 0.3};
    CHECK(back.predict(y, w) == p.predict(y, w));
    CHECK(back.flow(y, w, 0.7) == p.flow(y, w, 0.7));  // shapes, moments and forces
    CHECK(SafetensorsReader(folder / "p.safetensors").metadata().at("world") == "mine");
  }
}

TEST_CASE("predictors of other sizes are refused by name") {
  const TemporaryFolder folder;
  const auto path = folder / "p.safetensors";
  save(path, made());
  using Wider = Predictor<Network<float, Sequential<Linear<38, 5>, Relu, Linear<5, 26>>>, 2>;
  using Three = Predictor<Network<float, Sequential<Linear<57, 4>, Relu, Linear<4, 39>>>, 3>;
  CHECK(contains(error_of([&] { load<Wider>(path); }), path.string()));
  CHECK(contains(error_of([&] { load<Three>(path); }), path.string()));
  save(path, Net(3));  // a network is no predictor
  CHECK(contains(error_of([&] { load<Two>(path); }), "flow_bodies"));
}

TEST_CASE("metadata that are missing or make no sense are refused by name") {
  const TemporaryFolder folder;
  const auto path = folder / "p.safetensors";
  for (const char* key : {"input_mean", "input_deviation", "output_mean", "output_deviation", "target",
                          "horizon", "flow_bodies", "flow_forces"}) {
    CAPTURE(key);
    for (const char* value : {static_cast<const char*>(nullptr), "", "nonsense", "1 2"}) {
      const std::string error = error_with(path, key, value);
      CHECK(contains(error, path.string()));
      CHECK(contains(error, key));
    }
  }
  CHECK(contains(error_with(path, "horizon", "-1 "), "horizon"));
  CHECK(contains(error_with(path, "horizon", "nan "), "horizon"));
  CHECK(contains(error_with(path, "horizon", "5e9 "), "numbers from 1e-06 to 3600, found 5000000000"));
  CHECK(contains(error_with(path, "flow_forces", "0 0 -9e31 1 1 1 1 1 "), "flow_forces"));
  CHECK(contains(error_with(path, "flow_forces", "0 0 -9 1 1 1 1 -1 "), "flow_forces"));
  Two far = made();
  far.horizon = 5e9;
  CHECK(contains(error_of([&] { save(path, far); }), "horizon of a saved predictor"));
  std::string zeros;
  for (int i = 0; i < 38; ++i) zeros += "0 ";
  CHECK(contains(error_with(path, "input_deviation", zeros.c_str()), "numbers from 1e-30 to 1e+30, found 0"));
  CHECK(contains(error_with(path, "flow_bodies", "9 1 1 1 1 1 1 1 0 1 1 1 1 1 1 1 "), "flow_bodies"));
  CHECK(error_with(path, "target", "residual").empty());
}

TEST_CASE("files of other lengths and with other weights are refused") {
  const TemporaryFolder folder;
  const auto path = folder / "p.safetensors";
  save(path, made());
  const std::string bytes = read_bytes(path);
  for (std::size_t size = 0; size < bytes.size(); size += 101) {
    write_bytes(path, bytes.substr(0, size));
    CAPTURE(size);
    CHECK(contains(error_of([&] { load<Two>(path); }), path.string()));
  }
  std::string changed = bytes;
  changed[changed.size() - 2] = static_cast<char>(changed[changed.size() - 2] ^ 0x40);  // a weight's exponent
  for (const std::string& file : {changed, resealed(changed)}) {
    write_bytes(path, file);
    CHECK(contains(error_of([&] { load<Two>(path); }), path.string()));
  }
}

TEST_CASE("a shape that is turned against the principal axes is not saved") {
  const TemporaryFolder folder;
  const Body<double> turned(Box<double>{0.1, 0.2, 0.3}, 2.0,
                            Eigen::Matrix3d{{0.03, 0.01, 0}, {0.01, 0.05, 0}, {0, 0, 0.06}});
  Two p = made();
  p.flow.system = System<double, 2>({turned, turned});
  CHECK(contains(error_of([&] { save(folder / "p.safetensors", p); }), "principal axes"));
  CHECK_FALSE(std::filesystem::exists(folder / "p.safetensors"));
}

TEST_CASE("weights of half the size: from a float predictor's file, and from their own") {
  using Half = Predictor<Network<float, Net::Architecture, bfloat16>, 2>;
  const TemporaryFolder folder;
  const Two whole = made();
  save(folder / "whole", whole);
  const auto half = load<Half>(folder / "whole");
  CHECK(half.input.mean == whole.input.mean);
  CHECK(half.horizon == whole.horizon);
  save(folder / "half", half);
  const auto back = load<Half>(folder / "half");
  Two::State y;
  y[1].position = {4, 5, 6};
  const Two::Wrenches w{};
  CHECK(back.predict(y, w) == half.predict(y, w));
  CHECK(!(half.predict(y, w) == whole.predict(y, w)));
  CHECK((half.predict(y, w).vector() - whole.predict(y, w).vector()).norm() < 0.1);
  CHECK(contains(error_of([&] { load<Two>(folder / "half"); }), "expected dtype F32, found BF16"));
}
