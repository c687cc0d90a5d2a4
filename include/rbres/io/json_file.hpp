#pragma once

#include <filesystem>
#include <string>

#include <nlohmann/json.hpp>

#include <rbres/io/atomic_file.hpp>

/// @file
/// Small JSON files, read and written whole.
namespace rbres::RBRES_ABI::detail {

using Json = nlohmann::ordered_json;

/// Bytes of the largest file that is read.
inline constexpr std::size_t most_text = 1'000'000;

/// The bytes of a file of at most a megabyte.
inline std::string read_text(const std::filesystem::path& path) {
  const InputFile file(path);
  if (file.size() > most_text) refuse(path.string(), "at most a megabyte", file.size());
  std::string bytes(file.size(), '\0');
  file.read(0, bytes.data(), bytes.size());
  return bytes;
}

inline void write_text(const std::filesystem::path& path, const std::string& bytes) {
  AtomicFile file(path);
  file.write(bytes.data(), bytes.size());
  file.commit();
}

/// The object that the file holds; Error where it holds anything else.
inline Json read_json(const std::filesystem::path& path) {
  Json found = Json::parse(read_text(path), nullptr, false);
  if (!found.is_object()) refuse(path.string(), "a JSON object", "something else");
  return found;
}

/// The finite number under a key of a file's object; `what` says which object.
inline double number_at(const Json& object, const char* key, const std::string& what) {
  const auto found = object.find(key);
  const bool there = found != object.end();
  if (!there || !found->is_number())
    refuse(text(what, ", ", key), "a number", there ? found->type_name() : "none");
  return found->get<double>();
}

/// The array under a key.
inline const Json& array_at(const Json& object, const char* key, const std::string& what) {
  const auto found = object.find(key);
  const bool there = found != object.end();
  if (!there || !found->is_array())
    refuse(text(what, ", ", key), "an array", there ? found->type_name() : "none");
  return *found;
}

}  // namespace rbres::RBRES_ABI::detail
