// What programs ask of files before they write them.
#pragma once

#include <filesystem>
#include <rbres/core/error.hpp>
#include <string>

/// Whether there is anything of that name, also a link that leads nowhere.
inline bool is_taken(const std::string& path) {
  return std::filesystem::exists(std::filesystem::symlink_status(path));
}

/// Refuses to overwrite a file that an option names; `hint` says how it is done.
inline void refuse_taken(const std::string& option, const std::string& file, const std::string& hint) {
  if (is_taken(file)) throw rbres::Error(option + ": " + file + " exists and would be overwritten" + hint);
}
/// What a program says that has --force.
inline const std::string force_overwrites = "; --force overwrites it";
