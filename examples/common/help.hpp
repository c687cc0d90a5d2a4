// The command line of programs that take no options.
#pragma once

#include <cstdio>
#include <cstring>
#include <filesystem>

/// Whether --help is asked for.
inline bool asks_for_help(int argc, char** argv) {
  for (int i = 1; i < argc; ++i)
    if (std::strcmp(argv[i], "--help") == 0 || std::strcmp(argv[i], "-h") == 0) return true;
  return false;
}

inline int print_help(const char* usage) {
  std::fputs(usage, stdout);
  return 0;
}

/// Says on one line that the argument is none of the program's; the exit status.
inline int refuse_argument(char** argv, const char* argument) {
  const auto program = std::filesystem::path(argv[0]).filename();
  std::fprintf(stderr, "%s: unexpected argument %s; see --help\n", program.c_str(), argument);
  return 2;
}

/// For a program without arguments that was given some: prints what it does where --help is among them, else
/// refuses the first; the exit status.
inline int answer(int argc, char** argv, const char* what_it_does) {
  if (!asks_for_help(argc, argv)) return refuse_argument(argv, argv[1]);
  const auto program = std::filesystem::path(argv[0]).filename();
  std::printf("usage: %s [--help]\n%s\n", program.c_str(), what_it_does);
  return 0;
}
