// The files that a run writes.
#pragma once

#include <unistd.h>

#include <filesystem>
#include <map>
#include <optional>
#include <rbres/io.hpp>

#include "../common/files.hpp"
#include "log.hpp"
#include "options.hpp"

namespace train {

/// Reserved from the run's start: nobody else writes them meanwhile.
struct Outputs {
  AtomicFile model;
  std::optional<AtomicFile> table;
  std::vector<AtomicFile> claims;  ///< of those that are written again and again; never put in their place
};

/// Refuses, before hours of work, to write what is there or cannot be written.
inline Outputs open_files(const Options& o) {
  if (o.resume && o.checkpoint.empty())
    throw Error("--resume: goes on from a --checkpoint FILE, none is given");
  std::map<std::filesystem::path, std::string> seen;
  const auto check = [&](const std::string& option, const std::string& file, bool is_there) {
    if (file.empty()) return;
    const auto path = std::filesystem::absolute(file).lexically_normal();
    if (const auto [other, is_new] = seen.emplace(path, option); !is_new)
      throw Error(option + ": " + file + " is the file of " + other->second + ", too");
    if (is_there) return;
    refuse_taken(option, file, option == "--checkpoint" ? "; --resume goes on from it" : "");
  };
  check("--data", o.data, true);
  check("--checkpoint", o.checkpoint, o.resume);
  if (o.out.empty()) throw Error("--out: expected the name of a file, found none");
  check("--out", o.out, false);
  check("--json", o.json, false);
  check("--log", o.log, o.resume);
  if (o.resume) SafetensorsReader(o.checkpoint).require_digest();
  if (o.resume && !o.log.empty() && is_taken(o.log)) LossLog(o.log, true);
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
    detail::naming([&] { return problem.what() + std::string("; "); },
                   [&] { save(rescued, model, made_for); });
    throw Error(problem.what() + ("; the model is " + rescued.string()));
  }
}

}  // namespace train
