// Rolls a trained predictor out beside the truth: predictions of predictions, from a sampled scenario.
#include <functional>

#include "common/command_line.hpp"
#include "common/files.hpp"
#include "paper/training.hpp"

namespace {

using namespace rbres;
using State = SystemState<double, ScenarioData::bodies>;
using Wrenches = std::array<Wrench<double>, ScenarioData::bodies>;

struct Options {
  std::string model;
  std::uint64_t scenario = 2, seed = 1;
  double seconds = 5;
  std::string out = "rollout";
  bool force = false;

  std::string prediction_file() const { return out + ".npy"; }
  std::string truth_file() const { return out + "_truth.npy"; }
  std::string scene_file() const { return out + ".glb"; }
};

/// Refuses to overwrite unasked, and files that cannot be written.
void check_files(const Options& options) {
  for (const auto& file : {options.prediction_file(), options.truth_file(), options.scene_file()}) {
    if (!options.force) refuse_taken("--out", file, force_overwrites);
    const AtomicFile writable(file);
  }
}

/// A predictor of any of the experiment's architectures, and what its file says of it.
struct AnyPredictor {
  World world;
  BodySet set;
  double horizon;
  std::function<void(const State&, const Wrenches&, std::vector<State>&, int)> rollout;
};

/// The file's metadata `key`, which must be one of the names of `choices`.
template <class Choice>
Choice choose(const SafetensorsReader& file, const std::string& key, std::initializer_list<Choice> choices) {
  const auto found = file.metadata().find(key);
  std::string names;
  for (const Choice& choice : choices) {
    if (found != file.metadata().end() && found->second == name(choice)) return choice;
    names += (names.empty() ? "'" : " or '") + std::string(name(choice)) + "'";
  }
  detail::refuse(file.path().string() + ": metadata '" + key + "'", names,
                 found == file.metadata().end() ? "none" : "'" + found->second + "'");
}

template <paper::Architecture A>
bool load_as(const SafetensorsReader& file, AnyPredictor& any) {
  using Predictor = paper::PredictorOf<A>;
  const auto found = file.metadata().find("architecture");
  if (found == file.metadata().end() ||
      found->second != network_metadata<typename Predictor::Network>().at("architecture")) {
    return false;
  }
  auto predictor = ModelFormat<Predictor>::read(file);
  any.horizon = predictor.horizon;
  any.rollout = [predictor = std::move(predictor)](const auto& state, const auto& wrench, auto& states,
                                                   int present) {
    predictor.rollout(state, wrench, states, present);
  };
  return true;
}

AnyPredictor load_any(const std::string& path) {
  using enum paper::Architecture;
  const SafetensorsReader file(path);
  file.require_digest("; train it again");
  require_metadata(file, {{"scenarios", std::string(scenario_version)}});
  AnyPredictor any{choose(file, "world", {World::free_space, World::room}),
                   choose(file, "set", {BodySet::standard, BodySet::box}), 0, nullptr};
  if (!(load_as<residual10>(file, any) || load_as<residual4>(file, any) || load_as<forward4>(file, any) ||
        load_as<shallow>(file, any))) {
    const auto found = file.metadata().find("architecture");
    detail::refuse(path, "a predictor of one of the experiment's architectures",
                   found == file.metadata().end() ? "none" : found->second);
  }
  return any;
}

/// One scenario as it went and as it was predicted. Index 0 is the start; every `stride`-th true state is
/// one that was predicted.
template <BodySet Set>
class Rollout {
 public:
  Rollout(const Options& options, const AnyPredictor& predictor)
      : options_(options),
        predictor_(predictor),
        steps_(whole_steps(options.seconds, predictor.horizon)),
        stride_(std::max(1L, std::lround(50 * predictor.horizon))) {
    for (long k = 1; k <= steps_ * stride_; ++k) times_.push_back(time(k));
    data_ = generate(ScenarioSampler<Set>(predictor.world, options.seed), options.scenario, 1, times_,
                     {.sample_rate = static_cast<double>(stride_) / predictor.horizon});
    times_.insert(times_.begin(), 0.0);
    present_ = data_.body_count[0];
    truth_.push_back(state_of(data_.initial, 0, present_));
    for (const auto& states : data_.states) truth_.push_back(state_of(states, 0, present_));
    std::vector<State> next(static_cast<std::size_t>(steps_));
    predictor.rollout(truth_[0], wrench_of(data_, 0), next, present_);
    predicted_.push_back(truth_[0]);
    predicted_.insert(predicted_.end(), next.begin(), next.end());
  }

  void print_errors() const {
    std::printf("%s: %s, %s set, %g s ahead at a time\n", options_.model.c_str(),
                std::string(name(predictor_.world)).c_str(), std::string(name(Set)).c_str(),
                predictor_.horizon);
    std::printf(
        "scenario %llu of seed %llu: %s, %d bodies, ", static_cast<unsigned long long>(options_.scenario),
        static_cast<unsigned long long>(options_.seed), std::string(name(data_.family[0])).c_str(), present_);
    const auto contact = static_cast<double>(data_.first_contact[0]);
    if (std::isfinite(contact)) std::printf("first contact at %.2f s\n\n", contact);
    if (!std::isfinite(contact)) std::printf("no contact\n\n");
    std::printf("errors, root mean square over the bodies (rotation: mean)\n");
    std::printf(
        "  time [s]  position [m]  without contacts [m]  rotation [deg]  velocity [m/s]  spin [rad/s]\n");
    const FreeFlow<ScenarioData::bodies> flow = free_flow<Set>();
    const auto root = [](double mean_square_per_component) {
      return std::sqrt(3 * mean_square_per_component);
    };
    const long rows = std::min(10L, steps_);
    for (long row = 1; row <= rows; ++row) {
      const long step = row * steps_ / rows;
      const Metrics m = error(step, predicted_[index(step)]);
      const Metrics free = error(step, flow(truth_[0], wrench_of(data_, 0), time(step * stride_)));
      std::printf("  %8.2f  %12.4g  %20.4g  %14.4g  %14.4g  %12.4g\n", time(step * stride_), root(m.position),
                  root(free.position), m.angle, root(m.velocity), root(m.angular_velocity));
    }
  }

  /// NAME.npy, NAME_truth.npy and NAME.glb: all are written before one takes its place.
  void write() const {
    check_files(options_);  // another program may have written some meanwhile
    const std::string prediction = options_.prediction_file(), truth = options_.truth_file(),
                      animation = options_.scene_file();
    const Eigen::Index size = RigidState<double>::size;
    NpyWriter<double> prediction_file(prediction, {present_, size});
    NpyWriter<double> truth_file(truth, {present_, size});
    for (long step = 0; step <= steps_; ++step) {
      prediction_file.append(predicted_[index(step)].vector().head(size * present_));
      truth_file.append(truth_[index(step * stride_)].vector().head(size * present_));
    }
    GltfScene scene = motions();
    std::string view;
    if (predictor_.world == World::free_space)
      view = detail::text("; falls with the true bodies' centre, above a grid of squares ", scene.add_grid(),
                          " m wide");
    scene.write(animation);
    prediction_file.commit();
    truth_file.commit();
    std::printf("\n%s, %s: %ld times x %d bodies x 13, every %g s\n", prediction.c_str(), truth.c_str(),
                steps_ + 1, present_, predictor_.horizon);
    std::printf("%s: truth blue, prediction orange%s\n", animation.c_str(), view.c_str());
  }

 private:
  static std::size_t index(long i) { return static_cast<std::size_t>(i); }

  static long whole_steps(double seconds, double horizon) {
    const double steps = std::round(seconds / horizon);
    if (!(steps >= 1 && steps <= 100'000 && std::abs(steps * horizon - seconds) < 1e-9 * seconds))
      detail::refuse("--seconds", detail::text("1 to 100000 times the model's ", horizon, " s"), seconds);
    return std::lround(steps);
  }

  double time(long sample) const {
    return predictor_.horizon * static_cast<double>(sample) / static_cast<double>(stride_);
  }

  Metrics error(long step, const State& state) const {
    return measure(ScenarioTransitions(data_, index(step * stride_ - 1)), 0, state.vector(),
                   scenario_system<Set, 5>(predictor_.world));
  }

  GltfScene motions() const {
    // Free space has no walls to see the fall by, and bodies fall a hundred metres: so the eye falls along.
    std::vector<State> truth = truth_, predicted = predicted_;
    if (predictor_.world == World::free_space) {
      for (long k = 0; k <= steps_ * stride_; ++k) {
        Vec3<double> centre;
        for (int b = 0; b < present_; ++b) centre += (1.0 / present_) * truth_[index(k)][b].position;
        for (auto& body : truth[index(k)].body) body.position -= centre;
        if (k % stride_ != 0) continue;
        for (auto& body : predicted[index(k / stride_)].body) body.position -= centre;
      }
    }
    std::vector<double> steps;  // as far as a viewer's numbers reach, should the prediction run away
    for (long step = 0; step <= steps_; ++step) {
      if (!predicted[index(step)].vector().cast<float>().allFinite()) break;
      steps.push_back(time(step * stride_));
    }
    const auto system = scenario_system<Set, ScenarioData::bodies>(predictor_.world);
    GltfScene scene;
    scene.add_planes(system.planes());
    scene.add_motion("truth", system, times_, truth, {.bodies = present_});
    scene.add_motion("prediction", system, steps, std::span(predicted).first(steps.size()),
                     {.colour = gltf_clear_orange, .bodies = present_});
    return scene;
  }

  const Options& options_;
  const AnyPredictor& predictor_;
  long steps_, stride_;
  std::vector<double> times_;  ///< of the true states, s
  ScenarioData data_;          ///< one scenario; its horizons are the times after the start
  int present_ = 0;
  std::vector<State> truth_, predicted_;
};

template <BodySet Set>
void roll_out(const Options& options, const AnyPredictor& predictor) {
  const Rollout<Set> rollout(options, predictor);
  rollout.print_errors();
  rollout.write();
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Rolls a trained predictor out beside the truth, from one of the experiment's scenarios. Prints the "
      "errors over\n"
      "time; writes both trajectories as NAME.npy and NAME_truth.npy, and as a glTF 2.0 animation, "
      "NAME.glb."};
  Options options;
  const paper::Plan quick = paper::quick_plan();
  const std::string demonstration =
      "out/demo/models/" + paper::name(quick.units.front(), quick) + ".safetensors";  // by README's command
  options.model = demonstration;
  app.add_option("--model", options.model, "a model that rbres_paper or rbres_train trained")
      ->capture_default_str();
  seed_number(app, "--scenario", options.scenario,
              "number of the scenario; of seed 1, the first tenth of those that the\n"
              "model was made with were never trained on");
  seed_number(app, "--seed", options.seed, "of the scenarios");
  number(app, "--seconds", options.seconds, 0.0, 600.0, "how far, s");
  app.add_option("--out", options.out, "NAME of the files written")->capture_default_str();
  flag(app, "--force", options.force, "overwrite files of that name");
  return run_program("rbres_rollout", app, argc, argv, [&] {
    if (options.model == demonstration && !std::filesystem::exists(demonstration))
      throw Error("--model: there is no " + demonstration +
                  "; rbres_paper --quick --out out/demo makes it, or name another");
    check_files(options);
    const AnyPredictor predictor = load_any(options.model);
    predictor.set == BodySet::standard ? roll_out<BodySet::standard>(options, predictor)
                                       : roll_out<BodySet::box>(options, predictor);
  });
}
