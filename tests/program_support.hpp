// Programs from outside: what they print, and which files they leave.
#pragma once

#include "io_support.hpp"

#include <sys/wait.h>

#include <cstdlib>
#include <map>

struct Outcome {
  int status;
  std::string out, err;
};

/// Runs the program in the folder.
inline Outcome run(const TemporaryFolder& folder, const std::string& program, const std::string& arguments) {
  const std::string command =
      "cd '" + (folder / "").string() + "' && '" + program + "' " + arguments + " > .out 2> .err";
  const int status = std::system(command.c_str());
  return {WEXITSTATUS(status), read_bytes(folder / ".out"), read_bytes(folder / ".err")};
}

/// The bytes of the folder's files and of those in its folders, but for what the program printed.
inline std::map<std::string, std::string> files(const TemporaryFolder& folder) {
  std::map<std::string, std::string> result;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder / ""))
    if (entry.is_regular_file() && !entry.path().filename().string().starts_with('.'))
      result[std::filesystem::relative(entry.path(), folder / "").string()] = read_bytes(entry.path());
  return result;
}

/// What the program prints when it refuses these arguments: one line that begins with its name; all files
/// stay as they are.
inline std::string refusal(const TemporaryFolder& folder, const std::string& program,
                           const std::string& arguments) {
  CAPTURE(arguments);
  const auto before = files(folder);
  const Outcome outcome = run(folder, program, arguments);
  CHECK(outcome.status == 2);
  CHECK(outcome.err.starts_with(std::filesystem::path(program).filename().string() + ": "));
  CHECK(outcome.err.find('\n') == outcome.err.size() - 1);
  CHECK(files(folder) == before);
  return outcome.err;
}
