// What the command line of rbres_train says.
#pragma once

#include <cmath>
#include <map>

#include "../common/command_line.hpp"
#include "../paper/training.hpp"
#include "optimizer.hpp"

namespace train {

using paper::Architecture, paper::Json, paper::PredictorOf;

/// By default what pays: far enough ahead for contacts to count, not so far that nothing can be known, and
/// the network that is best there.
struct Options {
  World world = World::room;
  BodySet set = BodySet::standard;
  double horizon = 0.5;
  Target target = Target::residual;
  Architecture architecture = Architecture::shallow;
  int scenarios = 20'000;
  TrainingOptions training{.epochs = 40, .seed = 1};
  Method method = Method::adam;
  double weight_decay = 0.01, momentum = 0.9, clip = 0;
  int warm_up = 0;
  std::string inputs, targets;  ///< files of one's own data
  std::string data, start, checkpoint, out = "model.safetensors", json, log;
  bool resume = false;
};

/// What arXiv 2407.18798 trains.
inline void choose_paper(Options& o) {
  o.world = World::free_space;
  o.horizon = 5;
  o.target = Target::state;
  o.architecture = Architecture::residual10;
  o.scenarios = 100'000;
  o.training.epochs = 200;
}

/// What the model was made from; its file says it.
inline Metadata metadata(const Options& o) {
  return {{"world", std::string(name(o.world))},
          {"set", std::string(name(o.set))},
          {"scenarios", std::string(scenario_version)}};
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

inline void add_options(CLI::App& app, Options& o) {
  TrainingOptions& t = o.training;
  // Taken before the other options, whose values then stand.
  app.add_flag_callback(
         "--paper", [&o] { choose_paper(o); },
         "the experiment of arXiv 2407.18798, but for what other options say:\n"
         "--world free --horizon 5 --target state --network residual10 --scenarios 100000 --epochs 200")
      ->trigger_on_parse()
      ->check(no_value);
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
  number(app, "--horizon", o.horizon, 0.02, 60.0, "how far ahead, s; a whole number of 20 ms")
      ->check([](const std::string& text) {
        const double frames = std::stod(text) * TruthOptions{}.sample_rate;
        return std::abs(frames - std::round(frames)) < 1e-6
                   ? std::string()
                   : "expected a whole number of frames of 20 ms (0.02, 0.04, ...), found " + text;
      });
  number(app, "--scenarios", o.scenarios, 10, 10'000'000, "80 % train, 10 % validate, 10 % test");
  number(app, "--epochs", t.epochs, 1, 1'000'000, "at most");
  number(app, "--batch-size", t.batch_size, 1, 1'000'000, "samples per step");
  number(app, "--learning-rate", t.schedule.initial, 1e-30, 1e30, "of epoch 0");
  choice<Schedule::Kind>(
      app, "--schedule", t.schedule.kind,
      {{"power", Schedule::Kind::power},
       {"cosine", Schedule::Kind::cosine},
       {"constant", Schedule::Kind::constant}},
      "how the learning rate falls; cosine over --epochs, which a run that goes on cannot change");
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
  seed_number(app, "--seed", t.seed, "of the first weights, the shuffling and the dropout");
  number(app, "--threads", t.threads, 0, 4096, "changes no bit; 0: all");
  CLI::Option* inputs = app.add_option("--inputs", o.inputs,
                                       "learn your own data instead of scenarios: .npy of float32 or "
                                       "float64, shape (samples, inputs)");
  CLI::Option* targets =
      app.add_option("--targets", o.targets, "what is to be predicted from them: shape (samples, outputs)");
  inputs->needs(targets);
  targets->needs(inputs);
  app.add_option(
      "--data", o.data,
      "folder with the scenarios as .npy; made where there is none, which may be stopped and goes on");
  app.add_option("--start", o.start,
                 "model to go on from, whose weights and normalisation the run starts with");
  app.add_option("--checkpoint", o.checkpoint, "file to save the run to after each epoch");
  flag(app, "--resume", o.resume,
       "go on from the checkpoint, to the same bits; more --epochs than it had extend its run");
  app.add_option("--out", o.out, "file of the model; rbres_rollout takes that of scenarios")
      ->capture_default_str();
  app.add_option("--json", o.json, "file for the table's figures");
  app.add_option("--log", o.log, "file for the losses of each epoch, as CSV");
  for (const char* of_scenarios :
       {"--paper", "--world", "--set", "--target", "--horizon", "--scenarios", "--data", "--start"})
    app.get_option(of_scenarios)->excludes(inputs);
}

}  // namespace train
