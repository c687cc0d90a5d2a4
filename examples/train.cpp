// Simulates, trains, evaluates and saves one predictor, by the protocol of arXiv 2407.18798 unless told
// otherwise.
#include <unistd.h>

#include <charconv>
#include <fstream>
#include <limits>
#include <map>
#include <optional>

#include "common/command_line.hpp"
#include "paper/training.hpp"

namespace {

using namespace rbres;
using paper::Architecture, paper::Json, paper::PredictorOf;

/// The horizons of a data set on disk, s.
const std::vector<double> horizons{0.02, 0.1, 0.5, 1, 2, 5};

enum class Method { adam, adamw, sgd };

/// The optimiser that the command line asks for. One type, so that the trainer is compiled once; Adam is
/// AdamW without decay.
struct ChosenOptimizer {
  Method method = Method::adam;
  AdamW adam{};
  Sgd sgd{};
  static constexpr int moment_count = 2;

  void check() const { adam.check(), sgd.check(); }
  std::string text() const { return method == Method::sgd ? sgd.text() : adam.text(); }

  template <class T>
  struct Rule {
    bool is_sgd;
    Adam::Rule<T> adam;
    Sgd::Rule<T> sgd;
    template <class V>
    [[gnu::always_inline]] V operator()(const V& w, const V& g, V* moments, bool is_weight) const noexcept {
      return is_sgd ? sgd(w, g, moments, is_weight) : adam(w, g, moments, is_weight);
    }
  };
  template <class T>
  Rule<T> rule(double rate, std::uint64_t step) const noexcept {
    return {method == Method::sgd, adam.rule<T>(rate, step), sgd.rule<T>(rate, step)};
  }
};

struct Options {
  World world = World::free_space;
  BodySet set = BodySet::standard;
  double horizon = 5;
  Target target = Target::state;
  Architecture architecture = Architecture::residual10;
  int scenarios = 100'000;
  TrainingOptions training{.seed = 1};
  Method method = Method::adam;
  double weight_decay = 0.01, momentum = 0.9, clip = 0;
  int warm_up = 0;
  std::string data, start, checkpoint, out = "model.safetensors", json, log;
  bool resume = false;
};

/// What the model was made from; its file says it.
Metadata metadata(const Options& o) {
  return {{"world", std::string(name(o.world))},
          {"set", std::string(name(o.set))},
          {"scenarios", std::string(scenario_version)}};
}

/// The losses of a run, epoch by epoch, as a table that plotting tools read. Each line is on its way to the
/// disk when the next epoch begins.
class LossLog {
 public:
  static constexpr const char* header = "epoch,train_loss,validation_loss,learning_rate";

  explicit LossLog(const std::string& path) : path_(path) {
    if (path.empty()) return;
    file_.open(path, std::ios::trunc);
    line(header);
  }
  void add(const EpochLosses& losses) {
    if (path_.empty()) return;
    line(detail::text(++epoch_, ",", losses.train_loss, ",", losses.validation_loss, ",",
                      losses.learning_rate));
  }

 private:
  void line(const std::string& text) {
    if (!(file_ << text << std::endl)) throw Error(path_ + ": cannot write");
  }

  std::string path_;
  std::ofstream file_;
  int epoch_ = 0;
};

/// A run that is resumed writes its log again: only over one.
void expect_log(const std::string& path) {
  std::string first;
  if (!std::filesystem::is_regular_file(path) || !std::getline(std::ifstream(path), first) ||
      first != LossLog::header)
    detail::refuse("--log: " + path, "the log of the run that is resumed, or no file", "another file");
}

/// The files that a run writes, reserved from its start: nobody else writes them meanwhile.
struct Outputs {
  AtomicFile model;
  std::optional<AtomicFile> table;
  std::vector<AtomicFile> claims;  ///< of those that are written again and again; never put in their place
};

/// Refuses, before hours of work, to write what is there or cannot be written.
Outputs open_files(const Options& o) {
  if (o.resume && o.checkpoint.empty())
    throw Error("--resume: goes on from a --checkpoint FILE, none is given");
  std::map<std::filesystem::path, std::string> seen;
  const auto check = [&](const std::string& option, const std::string& file, bool is_there) {
    if (file.empty()) return;
    const auto path = std::filesystem::absolute(file).lexically_normal();
    if (const auto [other, is_new] = seen.emplace(path, option); !is_new)
      throw Error(option + ": " + file + " is the file of " + other->second + ", too");
    if (is_there) return;
    if (std::filesystem::exists(path))
      throw Error(option + ": " + file + " exists and would be overwritten" +
                  (option == "--checkpoint" ? "; --resume goes on from it" : ""));
  };
  check("--checkpoint", o.checkpoint, o.resume);
  if (o.out.empty()) throw Error("--out: expected the name of a file, found none");
  check("--out", o.out, false);
  check("--json", o.json, false);
  check("--log", o.log, o.resume);
  if (o.resume) SafetensorsReader(o.checkpoint).require_digest();
  if (o.resume && !o.log.empty() && std::filesystem::exists(o.log)) expect_log(o.log);
  Outputs files{AtomicFile(o.out), {}, {}};
  // The names that AtomicFile writes a checkpoint under stay free for each of them.
  if (!o.checkpoint.empty()) files.claims.emplace_back(o.checkpoint + ".run");
  if (!o.log.empty()) files.claims.emplace_back(o.log);
  if (!o.json.empty()) files.table.emplace(o.json).reserve(1 << 16);
  return files;
}

/// Puts the model in its place. Where that fails it goes to the folder for temporary files, as what was
/// learned in hours must not be lost.
template <class Model>
void save_model(AtomicFile& file, const Model& model, const Metadata& made_for) {
  try {
    save(file, model, made_for);
    file.commit_new();
  } catch (const Error& problem) {
    const std::string name = "rbres_train-" + std::to_string(::getpid()) + ".safetensors";
    const auto rescued = std::filesystem::temp_directory_path() / name;
    save(rescued, model, made_for);
    throw Error(problem.what() + ("; the model is " + rescued.string()));
  }
}

template <BodySet Set>
ScenarioData data_of(const Options& o) {
  const ScenarioSampler<Set> sampler(o.world, 1);
  const TruthOptions truth{.threads = o.training.threads};
  const std::string set = std::string(name(o.world)) + "-" + std::string(name(Set));
  ScenarioData data;
  if (o.data.empty()) {
    std::printf("%s: simulating %d scenarios over %g s\n", set.c_str(), o.scenarios, o.horizon);
    data = generate(sampler, 0, o.scenarios, {o.horizon}, truth, ScenarioProgress(o.scenarios));
    std::printf("\n");
    return data;
  }
  if (!dataset_is_done(o.data)) {
    if (std::ranges::find(horizons, o.horizon) == horizons.end())
      detail::refuse("--horizon", "one of 0.02, 0.1, 0.5, 1, 2, 5 where --data makes a data set", o.horizon);
    std::printf("%s: simulating %d scenarios over %g s into %s\n", set.c_str(), o.scenarios, horizons.back(),
                o.data.c_str());
    write_dataset(o.data, sampler, o.scenarios, horizons, truth, ScenarioProgress(o.scenarios));
    std::printf("\n");
  }
  data = read_dataset(o.data, sampler, o.scenarios, {o.horizon}, truth);
  std::printf("%s: %d scenarios of %s\n", set.c_str(), o.scenarios, o.data.c_str());
  return data;
}

void print_row(const char* method, const Metrics& m) {
  std::printf("  %-18s %12.4g %12.4g %12.4g %12.4g %10.3f %8.3f\n", method, m.position, m.orientation,
              m.velocity, m.angular_velocity, m.angle, 100 * m.energy);
}

template <Architecture A, BodySet Set>
PredictorOf<A> first_predictor(const Options& o) {
  using Network = typename paper::NetworkOf<A>::type;
  if (o.start.empty()) return {Network(o.training.seed), {}, {}, free_flow<Set>(), o.target};
  auto predictor = load<PredictorOf<A>>(o.start);
  if (predictor.target != o.target)
    detail::refuse("--start: " + o.start, "a model of the --target that is asked for", "the other");
  return predictor;
}

template <Architecture A, BodySet Set>
void train(const Options& o, PredictorOf<A> predictor, const ScenarioData& data, Outputs& files) {
  // Scenarios 0 ... tenth - 1 are the test set, those up to 2 tenth validate.
  const Eigen::Index n = data.count(), tenth = n / 10;
  const TrainingSet<PredictorOf<A>> set(predictor, data, 0, 2 * tenth, n, o.training.threads,
                                        o.start.empty() ? Normalization::fit : Normalization::keep);
  Clipped<ChosenOptimizer> optimizer;
  optimizer.method = o.method;
  optimizer.adam.weight_decay = o.method == Method::adamw ? o.weight_decay : 0;
  optimizer.sgd.momentum = o.momentum;
  optimizer.largest_norm = o.clip > 0 ? o.clip : std::numeric_limits<double>::infinity();
  Trainer trainer(predictor.network, set.samples(2 * tenth, n - 2 * tenth), set.samples(tenth, tenth),
                  o.training, optimizer);
  if (o.warm_up > 0) trainer.set_schedule(WarmUp{o.training.schedule, static_cast<std::uint64_t>(o.warm_up)});
  Metadata made_from = metadata(o);
  made_from["data"] = Json{{"scenarios", n},
                           {"horizon", o.horizon},
                           {"target", o.target == Target::state ? "state" : "residual"},
                           {"truth_step", TruthOptions{}.step}}
                          .dump();
  if (o.resume) load_checkpoint(o.checkpoint, trainer, made_from);

  std::printf("%s, %s, %g s ahead: %ld scenarios to train on, %ld to validate, %ld to test\n",
              paper::name(A).c_str(), paper::name(o.target).c_str(), o.horizon,
              static_cast<long>(n - 2 * tenth), static_cast<long>(tenth), static_cast<long>(tenth));
  if (o.resume) std::printf("  resumed after epoch %d\n", static_cast<int>(trainer.state().progress.epoch));
  LossLog log(o.log);
  for (const EpochLosses& epoch : trainer.state().history) log.add(epoch);
  const TrainingStatus status = trainer.train([&](const EpochReport& r) {
    print_progress(r);
    if (trainer.state().history.size() == r.epoch && r.status != TrainingStatus::diverged)
      log.add(trainer.state().history.back());
    if (!o.checkpoint.empty()) save_checkpoint(o.checkpoint, trainer, made_from);
    return true;
  });
  const TrainingProgress& done = trainer.state().progress;
  if (status == TrainingStatus::diverged)
    throw Error(
        detail::text("after epoch ", done.epoch,
                     " the loss was no number; a smaller --learning-rate may help; no model is saved"));
  predictor.network = trainer.best();
  save_model(files.model, predictor, metadata(o));
  std::printf("\n  %s after epoch %d; the best was epoch %d\n\n",
              status == TrainingStatus::early_stopped ? "stopped early" : "done",
              static_cast<int>(done.epoch), static_cast<int>(done.best_epoch));

  const auto body = scenario_body<Set>();
  const auto error = [&](const auto& predict) {
    return measure(data, 0, 0, predict_all(data, 0, tenth, predict, o.training.threads), body.inertia(),
                   body.mass());
  };
  const Metrics model = error([&](const auto& state, const auto& wrench, int present) {
    return predictor.predict(state, wrench, present);
  });
  const Metrics flow = error(ContactFree{free_flow<Set>(), o.horizon});
  for (const double x :
       {model.position, model.orientation, model.velocity, model.angular_velocity, model.angle, model.energy})
    if (!std::isfinite(x))
      throw Error("the model " + o.out + " predicts numbers that are not finite for the test scenarios");
  std::printf("%g s ahead, %ld test scenarios, mean square errors per component\n", o.horizon,
              static_cast<long>(tenth));
  std::printf("  %-18s %12s %12s %12s %12s %10s %8s\n", "", "position", "orientation", "velocity",
              "ang. vel.", "angle deg", "ECE %");
  print_row("model", model);
  print_row("contact-free flow", flow);
  if (files.table) {
    const Json found{{"model", paper::to_json(model)}, {"contact-free flow", paper::to_json(flow)},
                     {"test_scenarios", tenth},        {"epochs", done.epoch},
                     {"best_epoch", done.best_epoch},  {"best_validation_loss", done.best_loss}};
    const std::string text = found.dump(1) + "\n";
    files.table->write(text.data(), text.size());
    files.table->commit_new();
  }
  std::printf("\nThe model: %s\n", o.out.c_str());
}

template <BodySet Set>
void run(const Options& o, Outputs& files) {
  paper::with_architecture(o.architecture, [&](auto a) {
    constexpr std::size_t metadata_bytes = 1 << 20;
    files.model.reserve(paper::NetworkOf<a()>::type::parameter_count * sizeof(float) + metadata_bytes);
    auto predictor = first_predictor<a(), Set>(o);
    train<a(), Set>(o, std::move(predictor), data_of<Set>(o), files);
  });
}

/// An option that takes one of some names.
template <class T>
void choice(CLI::App& app, const std::string& option, T& value, const std::map<std::string, T>& names,
            const std::string& help) {
  std::string text, list;
  for (const auto& [name, meaning] : names) {
    if (meaning == value) text = name;
    list += (list.empty() ? "" : ", ") + name;
  }
  app.add_option_function<std::string>(
         option,
         [&value, names, list, option](const std::string& found) {
           const auto chosen = names.find(found);
           if (chosen == names.end()) detail::refuse(option, "one of " + list, found);
           value = chosen->second;
         },
         help + ": " + list)
      ->default_str(text);
}

/// A number within bounds; what is no number is out of them.
template <class T>
void number(CLI::App& app, const std::string& option, T& value, T least, T most, const std::string& help) {
  app.add_option(option, value, help)
      ->check([least, most](const std::string& text) {
        T found{};
        const char* end = text.data() + text.size();
        const auto [stopped, problem] = std::from_chars(text.data(), end, found);
        if (problem == std::errc() && stopped == end && found >= least && found <= most) return std::string();
        return detail::text("expected a number from ", least, " to ", most, ", found ", text);
      })
      ->capture_default_str();
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Simulates scenarios, trains a network to predict them, and saves the model. Defaults are those of "
      "arXiv\n"
      "2407.18798. Prints the errors on a tenth of the scenarios that the network never saw, beside those of "
      "the\n"
      "contact-free flow. Overwrites no file."};
  Options o;
  TrainingOptions& t = o.training;
  choice<World>(app, "--world", o.world, {{"free", World::free_space}, {"room", World::room}}, "where");
  choice<BodySet>(app, "--set", o.set, {{"standard", BodySet::standard}, {"box", BodySet::box}},
                  "the bodies");
  choice<Target>(app, "--target", o.target, {{"state", Target::state}, {"residual", Target::residual}},
                 "what the network says, the state or what it differs by from the contact-free flow");
  choice<Architecture>(app, "--network", o.architecture,
                       {{"residual10", Architecture::residual10},
                        {"residual4", Architecture::residual4},
                        {"forward4", Architecture::forward4},
                        {"shallow", Architecture::shallow}},
                       "10 or 4 residual blocks, the same as 4 without skips, or two hidden layers");
  number(app, "--horizon", o.horizon, 0.02, 60.0, "how far ahead, s; a whole number of 20 ms");
  number(app, "--scenarios", o.scenarios, 10, 10'000'000, "80 % train, 10 % validate, 10 % test");
  number(app, "--epochs", t.epochs, 1, 1'000'000, "at most");
  number(app, "--batch-size", t.batch_size, 1, 1'000'000, "scenarios per step");
  number(app, "--learning-rate", t.schedule.initial, 1e-30, 1e30, "of epoch 0");
  choice<Schedule::Kind>(app, "--schedule", t.schedule.kind,
                         {{"power", Schedule::Kind::power},
                          {"cosine", Schedule::Kind::cosine},
                          {"constant", Schedule::Kind::constant}},
                         "how the learning rate falls");
  number(app, "--warm-up", o.warm_up, 0, 1'000'000'000, "steps over which the learning rate rises to it");
  number(app, "--gamma", t.schedule.gamma, 0.0, 1e3, "the learning rate falls as (1 + gamma epoch)^-power");
  number(app, "--power", t.schedule.power, 0.0, 1e3, "see --gamma");
  choice<Method>(app, "--optimizer", o.method,
                 {{"adam", Method::adam}, {"adamw", Method::adamw}, {"sgd", Method::sgd}}, "which one");
  number(app, "--weight-decay", o.weight_decay, 0.0, 1e3, "of adamw, which one uses with --l2 0");
  number(app, "--momentum", o.momentum, 0.0, 0.9999, "of sgd");
  number(app, "--clip", o.clip, 0.0, 1e30, "largest norm of a step's gradient; 0: any");
  number(app, "--l2", t.l2, 0.0, 1e3, "factor of the squared weights in the loss");
  number(app, "--dropout", t.dropout, 0.0, 0.999, "rate");
  number(app, "--patience", t.patience, 0, 1'000'000,
         "epochs without a better validation loss before it stops; 0: never");
  number(app, "--min-delta", t.min_delta, 0.0, 1e30, "for --patience a loss is better only if lower by more");
  number(app, "--seed", t.seed, std::uint64_t{0}, std::uint64_t{1} << 63,
         "of the first weights, the shuffling and the dropout");
  number(app, "--threads", t.threads, 0, 4096, "changes no bit; 0: all");
  app.add_option(
      "--data", o.data,
      "folder with the scenarios as .npy; made where there is none, which may be stopped and goes on");
  app.add_option("--start", o.start,
                 "model to go on from, whose weights and normalisation the run starts with");
  app.add_option("--checkpoint", o.checkpoint, "file to save the run to after each epoch");
  app.add_flag("--resume", o.resume,
               "go on from the checkpoint, to the same bits; more --epochs than it had extend its run");
  app.add_option("--out", o.out, "file of the model; rbres_rollout takes it")->capture_default_str();
  app.add_option("--json", o.json, "file for the table's figures");
  app.add_option("--log", o.log, "file for the losses of each epoch, as CSV");
  return run_program("rbres_train", app, argc, argv, [&] {
    Outputs files = open_files(o);
    o.set == BodySet::standard ? run<BodySet::standard>(o, files) : run<BodySet::box>(o, files);
  });
}
