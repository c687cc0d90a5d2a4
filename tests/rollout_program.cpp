// rbres_rollout from outside: what it writes, and that it writes nothing when something is wrong.
#include "../examples/scenarios/compiled.hpp"
#include "program_support.hpp"

#include <algorithm>

#include <rbres/io.hpp>

using namespace rbres;

namespace {

using Shallow = Network<float, Sequential<Linear<95, 256>, Relu, Linear<256, 256>, Relu, Linear<256, 65>>>;
const Metadata standard_world{
    {"world", "free"}, {"set", "standard"}, {"scenarios", std::string(scenario_version)}};

/// A predictor whose network says nothing, so that it predicts the contact-free flow.
void save_silent_predictor(const std::filesystem::path& path, const Metadata& metadata) {
  Predictor<Shallow, 5> predictor{Shallow(1), {}, {}, free_flow<BodySet::standard>(), Target::residual, 0.1};
  std::ranges::fill(predictor.network.parameters(), 0.0f);
  save(path, predictor, metadata);
}

Outcome run(const TemporaryFolder& folder, const std::string& arguments) {
  return run(folder, RBRES_ROLLOUT, arguments);
}

}  // namespace

TEST_CASE("a flight predicted by the contact-free flow") {
  const TemporaryFolder folder;
  save_silent_predictor(folder / "silent.safetensors", standard_world);
  const Outcome outcome = run(folder, "--model silent.safetensors --scenario 9 --seconds 0.5 --out a");
  CHECK(outcome.err == "");
  REQUIRE(outcome.status == 0);
  CHECK(contains(outcome.out, "scenario 9 of seed 1: flight, 3 bodies, no contact"));
  const Scenario scenario = ScenarioSampler<BodySet::standard>(World::free_space, 1)(9);
  const NpyReader<double> predicted(folder / "a.npy"), truth(folder / "a_truth.npy");
  for (const auto* file : {&predicted, &truth}) {
    CHECK(file->shape() == std::vector<Eigen::Index>{6, 3, 13});
    CHECK((file->read(0, 1) - scenario.state.vector().head(39)).norm() < 1e-5);
  }
  const Eigen::MatrixXd error = predicted.read() - truth.read(), moved = truth.read(5, 1) - truth.read(0, 1);
  CHECK(error.cwiseAbs().maxCoeff() < 1e-4);
  CHECK(moved.norm() > 1);
  CHECK(read_bytes(folder / "a.glb").starts_with("glTF"));
  // Free space has no floor, so a grid says which way is down; a room has one.
  CHECK(contains(outcome.out, "falls with the true bodies' centre, above a grid of squares "));
  CHECK(contains(read_bytes(folder / "a.glb"), "\"grid\""));
  Metadata room = standard_world;
  room["world"] = "room";
  save_silent_predictor(folder / "room.safetensors", room);
  CHECK(!contains(run(folder, "--model room.safetensors --seconds 0.5 --out b").out, "grid"));
  CHECK(!contains(read_bytes(folder / "b.glb"), "\"grid\""));
}

TEST_CASE("what is wrong costs one line and no file") {
  const TemporaryFolder folder;
  save_silent_predictor(folder / "silent.safetensors", standard_world);
  REQUIRE(run(folder, "--model silent.safetensors --seconds 0.5").status == 0);

  save_silent_predictor(folder / "nowhere.safetensors", {{"scenarios", std::string(scenario_version)}});
  save_silent_predictor(folder / "old.safetensors",
                        {{"world", "free"}, {"set", "box"}, {"scenarios", "first"}});
  const Network<float, Sequential<Linear<95, 65>>> other(1);
  save(folder / "other.safetensors", other, standard_world);
  write_bytes(folder / "broken.safetensors", read_bytes(folder / "silent.safetensors").substr(0, 5000));
  std::filesystem::create_directories(folder / "taken.glb");
  const auto error = [&](const std::string& arguments) { return refusal(folder, RBRES_ROLLOUT, arguments); };
  const std::string here = "--model silent.safetensors --seconds 0.3 ";
  const std::string good = here + "--out new ";
  CHECK(contains(error(good + "--bogus"), "--bogus"));
  CHECK(contains(error(good + "--scenario -1"), "found -1"));
  CHECK(contains(error(good + "--seed x"), "--seed"));
  CHECK(contains(error("--out new --model silent.safetensors --seconds 0.25"),
                 "times the model's 0.1 s, found 0.25"));
  CHECK(contains(error("--out new --model silent.safetensors --seconds 0"), "found 0"));
  CHECK(contains(error("--model silent.safetensors --seconds nan"), "found nan"));
  CHECK(contains(error("--model silent.safetensors --seconds 1000"), "1000"));
  CHECK(contains(error("--out new --seconds 0.3 --model missing.safetensors"),
                 "missing.safetensors: cannot read"));
  CHECK(contains(error("--out new --seconds 0.3 --model broken.safetensors"), "broken.safetensors"));
  CHECK(contains(error("--out new --seconds 0.3 --model nowhere.safetensors"),
                 "metadata 'world': expected 'free' or 'room', found none"));
  CHECK(contains(error("--out new --seconds 0.3 --model old.safetensors"), "metadata 'scenarios'"));
  CHECK(contains(error("--out new --seconds 0.3 --model other.safetensors"),
                 "found rbres::Sequential<rbres::Linear<95, 65>>"));
  CHECK(contains(error(here + "--out nowhere/a"), "nowhere/a.npy: cannot write"));
  CHECK(contains(error(here + "--out taken"),
                 "--out: taken.glb exists and would be overwritten; --force overwrites it"));
  CHECK(contains(error(here + "--out taken --force"), "taken.glb: expected a regular file"));
  CHECK(contains(error(here), "--out: rollout.npy exists and would be overwritten"));
  const std::string before = read_bytes(folder / "rollout.npy");
  CHECK(run(folder, here + "--force").status == 0);
  CHECK(read_bytes(folder / "rollout.npy") != before);
  CHECK(contains(error("--out new"), "; rbres_paper --quick --out out/demo makes it"));
  CHECK(run(folder, "--help").status == 0);
}
