// What the experiment has found so far: one JSON file for each finished part, so that a stopped run goes on
// where it was.
#pragma once

#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <rbres/io.hpp>

namespace paper {

using Json = nlohmann::ordered_json;

/// Writes a text file atomically.
inline void write_text(const std::filesystem::path& path, const std::string& text) {
  rbres::AtomicFile file(path);
  file.write(text.data(), text.size());
  file.commit();
}

class Store {
 public:
  explicit Store(std::filesystem::path folder) : folder_(std::move(folder)) {
    std::error_code problem;
    std::filesystem::create_directories(folder_ / "parts", problem);
    if (!problem) std::filesystem::create_directories(folder_ / "models", problem);
    if (problem) throw rbres::Error(folder_.string() + ": cannot be made: " + problem.message());
  }

  const std::filesystem::path& folder() const { return folder_; }
  std::filesystem::path model(const std::string& part) const {
    return folder_ / "models" / (part + ".safetensors");
  }

  /// Whether the part was finished by this or an earlier run with the same setting.
  bool has(const std::string& part) const { return std::filesystem::exists(path(part)); }

  /// The finished part, or what `make` finds, which is then saved.
  Json part(const std::string& part, const std::function<Json()>& make) const {
    if (has(part)) {
      std::ifstream file(path(part));
      try {
        return Json::parse(file);
      } catch (const nlohmann::json::exception&) {
        throw rbres::Error(path(part).string() +
                           ": not the JSON that this program wrote; remove it to make it anew");
      }
    }
    Json found = make();
    write_text(path(part), found.dump(1) + "\n");
    return found;
  }

 private:
  std::filesystem::path path(const std::string& part) const { return folder_ / "parts" / (part + ".json"); }

  std::filesystem::path folder_;
};

}  // namespace paper
