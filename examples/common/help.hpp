// The command line of programs that take no options, and the end of all.
#pragma once

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>

/// Whether --help is asked for.
inline bool asks_for_help(int argc, char** argv) {
  for (int i = 1; i < argc; ++i)
    if (std::strcmp(argv[i], "--help") == 0 || std::strcmp(argv[i], "-h") == 0) return true;
  return false;
}

/// The exit status of a program that has done its work: 2, with one line of why, where stdout did not take
/// what it printed.
inline int finish(const char* program) {
  const bool failed = std::fflush(stdout) != 0;
  if (!failed && std::ferror(stdout) == 0) return 0;
  std::fprintf(stderr, "%s: cannot write to stdout: %s\n", program,
               failed ? std::strerror(errno) : "an error before its end");
  return 2;
}
inline int finish(char** argv) { return finish(std::filesystem::path(argv[0]).filename().c_str()); }

inline int print_help(char** argv, const char* usage) {
  std::fputs(usage, stdout);
  return finish(argv);
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
  return finish(argv);
}
