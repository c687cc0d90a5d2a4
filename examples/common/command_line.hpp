// What the programs with many options do alike.
#pragma once

#include <CLI/CLI.hpp>
#include <charconv>
#include <cstdio>
#include <rbres/core/error.hpp>

#include "help.hpp"

/// Adds an option, or a positional argument, that is a number within bounds; what is no number is out of
/// them.
template <class T>
CLI::Option* number(CLI::App& app, const std::string& option, T& value, T least, T most,
                    const std::string& help) {
  return app.add_option(option, value, help)
      ->check([least, most](const std::string& text) {
        T found{};
        const char* end = text.data() + text.size();
        const auto [stopped, problem] = std::from_chars(text.data(), end, found);
        if (problem == std::errc() && stopped == end && found >= least && found <= most) return std::string();
        return rbres::detail::text("expected a number from ", least, " to ", most, ", found ", text);
      })
      ->capture_default_str();
}

/// That an option takes no value: "--option=7" is refused.
inline std::string no_value(const std::string& text) {
  return text == "true" ? "" : "expected no value, found " + text;
}

/// Adds an option that is given or not.
inline void flag(CLI::App& app, const std::string& option, bool& given, const std::string& help) {
  app.add_flag(option, given, help)->check(no_value);
}

/// Adds an option for the seed of random numbers.
inline void seed_number(CLI::App& app, const std::string& option, std::uint64_t& value,
                        const std::string& help) {
  number(app, option, value, std::uint64_t{0}, std::uint64_t{1} << 63, help);
}

/// Reads the command line, then runs. The exit status: 0, or 2 after one line that says what is wrong.
template <class Run>
int run_program(const char* name, CLI::App& app, int argc, char** argv, const Run& run) {
  try {
    app.parse(argc, argv);
    run();
    return finish(name);
  } catch (const CLI::Success& asked) {  // --help
    app.exit(asked);
    return finish(name);
  } catch (const std::exception& problem) {
    std::fprintf(stderr, "%s: %s\n", name, problem.what());
    return 2;
  }
}
