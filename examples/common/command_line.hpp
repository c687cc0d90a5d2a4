// What the programs with many options do alike.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdio>

/// Reads the command line, then runs. The exit status: 0, or 2 after one line that says what is wrong.
template <class Run>
int run_program(const char* name, CLI::App& app, int argc, char** argv, const Run& run) {
  try {
    app.parse(argc, argv);
    run();
    return 0;
  } catch (const CLI::Success& asked) {  // --help
    return app.exit(asked);
  } catch (const std::exception& problem) {
    std::fprintf(stderr, "%s: %s\n", name, problem.what());
    return 2;
  }
}
