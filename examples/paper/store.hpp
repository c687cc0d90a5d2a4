// What the experiment has found so far: one JSON file for each finished part, so that a stopped run goes on
// where it was.
#pragma once

#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <rbres/io.hpp>

namespace paper {

using Json = nlohmann::ordered_json;

/// Numbers that are not finite are null in JSON: here they are NaN.
inline double number(const Json& x) {
  return x.is_number() ? x.get<double>() : std::numeric_limits<double>::quiet_NaN();
}
inline std::vector<double> numbers(const Json& array) {
  std::vector<double> all;
  for (const Json& x : array) all.push_back(number(x));
  return all;
}

/// Writes a text file atomically.
inline void write_text(const std::filesystem::path& path, const std::string& text) {
  rbres::AtomicFile file(path);
  file.write(text.data(), text.size());
  file.commit();
}

class Store {
 public:
  /// Throws Error where the folder cannot be made, holds something else than this program's results, or
  /// another process works in it.
  explicit Store(std::filesystem::path folder)
      : folder_(std::move(folder)), lock_(made(folder_), "works in this folder") {}

  const std::filesystem::path& folder() const { return folder_; }
  std::filesystem::path model(const std::string& part) const {
    return folder_ / "models" / (part + ".safetensors");
  }

  /// A JSON file that this program wrote. Throws Error where it is not one.
  static Json read(const std::filesystem::path& path) {
    std::ifstream file(path);
    try {
      return Json::parse(file);
    } catch (const nlohmann::json::exception&) {
      throw rbres::Error(path.string() + ": not the JSON that this program wrote; remove it to make it anew");
    }
  }

  /// What a checkpoint or other file beside a part is called.
  std::filesystem::path beside(const std::string& part, const std::string& ending) const {
    return folder_ / "parts" / (part + ending);
  }

  /// The finished part, or what `make` finds, which is then saved.
  Json part(const std::string& part, const Json& made_from, const std::function<Json()>& make) const {
    if (std::optional<Json> found = find(part, made_from)) return *std::move(found);
    Json found = make();
    keep(part, made_from, found);
    return found;
  }
  void keep(const std::string& part, const Json& made_from, const Json& found) const {
    write_text(beside(part, ".json"), Json{{"made_from", made_from}, {"found", found}}.dump(1) + "\n");
  }
  /// The part if it is finished. `made_from` is all that decides it: a part that was made from something else
  /// is refused, not mixed in.
  std::optional<Json> find(const std::string& part, const Json& made_from) const {
    const auto path = beside(part, ".json");
    if (!std::filesystem::exists(path)) return {};
    const Json all = read(path);
    if (all.contains("found") && all.contains("made_from") && all["made_from"] == made_from)
      return all["found"];
    throw rbres::Error(path.string() + ": not made from this run's setting, " + made_from.dump() +
                       "; remove it, or take another --out");
  }

 private:
  static const std::filesystem::path& made(const std::filesystem::path& folder) {
    std::error_code problem;
    if (!std::filesystem::is_directory(folder / "parts", problem) &&
        std::filesystem::is_directory(folder, problem) && !std::filesystem::is_empty(folder, problem))
      rbres::detail::refuse(folder.string(), "an empty folder or one of this program's results", "another");
    std::filesystem::create_directories(folder / "parts", problem);
    if (!problem) std::filesystem::create_directories(folder / "models", problem);
    if (problem) throw rbres::Error(folder.string() + ": cannot be made: " + problem.message());
    return folder;
  }

  std::filesystem::path folder_;
  rbres::FolderLock lock_;
};

}  // namespace paper
