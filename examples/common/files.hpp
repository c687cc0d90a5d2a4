// What programs ask of files before they write them.
#pragma once

#include <filesystem>
#include <string>

/// Whether there is anything of that name, also a link that leads nowhere.
inline bool is_taken(const std::string& path) {
  return std::filesystem::exists(std::filesystem::symlink_status(path));
}
