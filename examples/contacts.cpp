// Identifies a world from trajectories, learns how its bodies collide, and says how far each is from scenes
// that it has not seen.
#include <rbres/io/contact_law.hpp>
#include <rbres/io/trajectories.hpp>
#include <rbres/learn/identify.hpp>
#include <rbres/learn/spring_damper.hpp>

#include "common/command_line.hpp"
#include "common/files.hpp"
#include "contacts/learn.hpp"
#include "contacts/score.hpp"

namespace {

using namespace rbres;
using contacts_program::Deadline;
using contacts_program::Hybrid;
using contacts_program::Law;
using contacts_program::learn_law;
using contacts_program::Row;

struct Options {
  std::string folder, model;
  int scenes = 0;
  std::uint64_t seed = 0;
  double minutes = 10;
  bool json = false, force = false;
};

void say(const char* what) { std::fprintf(stderr, "%s\n", what); }

/// The mean position error of a predictor for scenes, m.
template <class Make>
double error_of(const TrajectorySet& set, const Make& make) {
  int failed = 0;
  return contacts_program::mean_position(contacts_program::score("", set, make, failed));
}

/// What was identified.
struct Worlds {
  Identification best;
  Identification one_step;  ///< the best of those that take a frame in one step, as a hybrid does
};

/// How a scene is stepped: fitted with each, that which is closest to the scenes kept apart.
Worlds identify_worlds(const TrajectorySet& fit, const TrajectorySet& choose) {
  IdentifyOptions options{.window = 50, .most_states = 20'000};
  if (!(squared_norm(fit.gravity()) > 0)) std::erase(options.unknowns, Unknown::gravity);
  Worlds found;
  double least = std::numeric_limits<double>::infinity();
  using enum SceneStep::Velocity;
  for (const SceneStep& step : {SceneStep{1, mean}, SceneStep{1, instant}, SceneStep{5, instant}}) {
    options.step = step;
    const Identification world = identify(fit, options);
    const double error = error_of(
        choose, [&](const Trajectory& s) { return SceneSimulator(choose, s, world.numbers(), step); });
    std::fprintf(stderr, "simulator, %d step%s a frame, velocities %s: %.4f m from the scenes kept apart\n",
                 step.steps, step.steps == 1 ? "" : "s",
                 step.velocity == mean ? "of the frame before" : "instant", error);
    if (!(error < least)) continue;
    least = error;
    found.best = world;
    if (step.steps == 1) found.one_step = world;
  }
  print_numbers(found.best);
  return found;
}

/// The analytic law with a learned correction, as strong as the scenes kept apart like best, in the world
/// that was identified.
Hybrid learn_hybrid(const TrajectorySet& fit, const TrajectorySet& choose, const Identification& world,
                    std::uint64_t seed, const Deadline& deadline) {
  const SceneStep::Velocity velocity = world.step.velocity;
  const TrajectorySet own_fit = world.numbers().world_of(fit), own_choose = world.numbers().world_of(choose);
  auto hybrid = learn_law<Hybrid>(own_fit, own_choose, {.velocity = velocity, .seed = seed}, deadline);
  hybrid.weight = best_weight(hybrid, [&](const Hybrid& law) {
    return error_of(own_choose,
                    [&](const Trajectory& s) { return ContactLawSimulator(own_choose, s, law, velocity); });
  });
  return hybrid;
}

void print(const std::vector<Row>& rows, bool json) {
  if (json) {
    std::puts("[");
    for (const Row& row : rows) {
      std::printf(
          "  {\"predictor\": \"%s\", \"seconds_ahead\": %.9g, \"position_m\": %.6g, \"rotation_rad\": %.6g, "
          "\"us_per_frame\": %.4g}%s\n",
          row.predictor.c_str(), row.seconds_ahead, row.position, row.rotation, row.us_per_frame,
          &row == &rows.back() ? "" : ",");
    }
    std::puts("]");
    return;
  }
  std::printf("%-22s %8s %12s %12s %10s\n", "predictor", "ahead s", "position m", "rotation rad", "us/frame");
  for (const Row& row : rows)
    std::printf("%-22s %8.3f %12.5f %12.4f %10.2f\n", row.predictor.c_str(), row.seconds_ahead, row.position,
                row.rotation, row.us_per_frame);
}

/// The first `most` scenes of a folder, all where it is 0. Error where no horizon fits into them.
TrajectorySet read_scenes(const std::filesystem::path& folder, int most = 0) {
  TrajectorySet set = read_trajectories(folder);
  if (most > 0) set = set.subset(0, most);
  if (contacts_program::horizons(set).empty())
    detail::refuse(folder.string(), "scenes of at least 6 frames", "shorter ones");
  return set;
}

void run(const Options& options) {
  const Deadline deadline(options.minutes);
  const std::filesystem::path folder = options.folder;
  const TrajectorySet train = read_scenes(folder / "train", options.scenes);
  if (train.size() < 2) detail::refuse((folder / "train").string(), "at least 2 scenes", train.size());
  const Parts parts(train);
  const TrajectorySet &fit = parts.fit, &choose = parts.choose;
  detail::naming([&] { return (folder / "train").string() + ", "; }, [&] { return untrained_law<Law>(fit); });

  const TrajectorySet test = read_scenes(folder / "test");
  if (std::abs(test.frame_time() - train.frame_time()) > 1e-9 * train.frame_time())
    detail::refuse((folder / "test").string() + ", frame time",
                   detail::text(train.frame_time(), " s, as in train"), test.frame_time());
  std::optional<AtomicFile> model;
  if (!options.model.empty()) {
    if (!options.force) refuse_taken("--model", options.model, force_overwrites);
    model.emplace(options.model);
  }

  const Worlds worlds = identify_worlds(fit, choose);
  say("spring-damper");
  const SpringDamper spring = fit_spring_damper(train, 50, 10'000);
  std::fprintf(stderr, "  stiffness %.4g / s^2, damping %.4g / s, friction %.3f\n", spring.stiffness,
               spring.damping, spring.friction);
  say("learned law");
  const Law law = learn_law<Law>(fit, choose, {.seed = options.seed}, deadline.part(0.7));
  std::fprintf(stderr, "  %.4f m from the scenes kept apart\n",
               error_of(choose, [&](const Trajectory& s) { return ContactLawSimulator(choose, s, law); }));
  if (model) {
    save(*model, law);
    model->commit();
  }
  say("hybrid");
  const Hybrid hybrid = learn_hybrid(fit, choose, worlds.one_step, options.seed, deadline);

  std::vector<Row> rows;
  const auto add = [&](const char* name, const auto& make) {
    int failed = 0;
    const auto own = contacts_program::score(name, test, make, failed);
    rows.insert(rows.end(), own.begin(), own.end());
    if (failed > 0) {
      std::fprintf(stderr, "%s: %d of %d scenes refused or diverged, counted as the contact-free flow\n",
                   name, failed, test.size());
    }
  };
  add("contact-free flow",
      [&](const Trajectory& s) { return FreeFlight(test, s, SceneStep::Velocity::instant); });
  add("fitted simulator",
      [&](const Trajectory& s) { return SceneSimulator(test, s, worlds.best.numbers(), worlds.best.step); });
  add("fitted spring-damper", [&](const Trajectory& s) { return SpringDamperSimulator(test, s, spring); });
  add("learned law", [&](const Trajectory& s) { return ContactLawSimulator(test, s, law); });
  const TrajectorySet hybrid_test = worlds.one_step.numbers().world_of(test);
  add("hybrid", [&](const Trajectory& s) {
    return ContactLawSimulator(hybrid_test, s, hybrid, worlds.one_step.step.velocity);
  });
  print(rows, options.json);
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  CLI::App app{
      "Fits a simulator and a spring-damper law to FOLDER/train, learns a contact law from it, alone and as "
      "a "
      "correction of the simulator (hybrid), and prints how far each is from the scenes of FOLDER/test: mean "
      "distance and angle over scenes and bodies. "
      "<rbres/io/trajectories.hpp> says what the folders hold."};
  app.add_option("FOLDER", options.folder, "holds train/ and test/")->required();
  number(app, "--scenes", options.scenes, 0, 1'000'000, "train on the first so many scenes; 0: on all");
  seed_number(app, "--seed", options.seed, "of the learned law");
  number(app, "--minutes", options.minutes, 1e-3, 1e6,
         "for all; of what fits leave, the hybrid has three tenths");
  app.add_option("--model", options.model, "save the learned law to this file");
  flag(app, "--force", options.force, "overwrite it");
  flag(app, "--json", options.json, "print a JSON array instead of the table");
  return run_program("rbres_contacts", app, argc, argv, [&] { run(options); });
}
