// What programs ask of files before they write them.
#pragma once

#include <filesystem>
#include <rbres/core/error.hpp>
#include <string>

/// Whether there is anything of that name, also a link that leads nowhere.
inline bool is_taken(const std::string& path) {
  return std::filesystem::exists(std::filesystem::symlink_status(path));
}

/// Refuses to overwrite a file that an option names, unless by `force`.
inline void refuse_taken(const std::string& option, const std::string& file, bool force) {
  if (!force && is_taken(file))
    throw rbres::Error(option + ": " + file + " exists and would be overwritten; --force overwrites it");
}
