#pragma once

#include <benchmark/benchmark.h>

#include <algorithm>
#include <cstdio>
#include <iterator>
#include <sstream>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace rbres::bench {

/// Prints the median of each row, and at the end how many times longer each peer took than rbres's row of the
/// same work: the median over the repetitions of one run, with the smallest and the largest. A row is named
/// WORK/ENGINE[/VARIANT]; WORK/rbres/KIND[/VARIANT] of any KIND (double, lanes) is compared with
/// WORK/PEER[/VARIANT]. What is compared is the row's counter us_per_...
class RatioReporter : public benchmark::ConsoleReporter {
 public:
  RatioReporter() : ConsoleReporter(OO_None) {}

  void ReportRuns(const std::vector<Run>& runs) override {
    std::vector<Run> shown;
    for (const Run& run : runs) {
      const bool measurement = run.run_type == Run::RT_Iteration;
      if (measurement && !run.error_occurred) collect(run);
      if (run.error_occurred || run.repetitions <= 1 || (!measurement && run.aggregate_name == "median"))
        shown.push_back(run);
    }
    for (Run& run : shown)
      for (auto& [name, counter] : run.counters)
        counter.flags = benchmark::Counter::kDefaults;  // no "s" behind us_per_
    if (!shown.empty()) ConsoleReporter::ReportRuns(shown);
  }

  void Finalize() override {
    std::sort(rows_.begin(), rows_.end(), [](const Row& a, const Row& b) { return a.name < b.name; });
    for (const Row& ours : rows_) {
      const auto engine = std::find(ours.name.begin(), ours.name.end(), "rbres");
      if (engine == ours.name.end()) continue;
      for (const Row& peer : rows_)
        if (same_work(ours.name, engine - ours.name.begin(), peer.name)) print_ratio(peer, ours);
    }
    ConsoleReporter::Finalize();
  }

 private:
  using Name = std::vector<std::string>;
  struct Row {
    Name name;
    std::vector<double> times;  // one for each repetition
  };

  void collect(const Run& run) {
    const auto time = std::find_if(run.counters.begin(), run.counters.end(),
                                   [](const auto& counter) { return counter.first.starts_with("us_per_"); });
    if (time == run.counters.end()) return;
    Name name;
    std::istringstream parts(run.run_name.function_name);
    for (std::string part; std::getline(parts, part, '/');) name.push_back(part);
    if (rows_.empty() || rows_.back().name != name) rows_.push_back({name, {}});
    rows_.back().times.push_back(time->second);
  }

  static bool same_work(const Name& ours, std::ptrdiff_t engine, const Name& peer) {
    const auto size = static_cast<std::ptrdiff_t>(peer.size());
    if (size <= engine || peer[static_cast<std::size_t>(engine)] == "rbres") return false;
    const auto variant = ours.begin() + engine + 1;
    const auto equals = [&](auto from) {
      return std::equal(from, ours.end(), peer.begin() + engine + 1, peer.end());
    };
    return std::equal(ours.begin(), ours.begin() + engine, peer.begin()) &&
           (equals(variant) || (variant != ours.end() && equals(std::next(variant))));
  }

  void print_ratio(const Row& peer, const Row& ours) {
    std::vector<double> ratios;
    for (std::size_t i = 0; i < std::min(peer.times.size(), ours.times.size()); ++i)
      ratios.push_back(peer.times[i] / ours.times[i]);
    std::sort(ratios.begin(), ratios.end());
    const std::size_t n = ratios.size();
    const double median = 0.5 * (ratios[(n - 1) / 2] + ratios[n / 2]);
    char line[160];
    std::snprintf(line, sizeof line, "%-30s / %-30s = %8.2f  [%.2f, %.2f]\n", join(peer.name).c_str(),
                  join(ours.name).c_str(), median, ratios.front(), ratios.back());
    if (!std::exchange(titled_, true))
      GetOutputStream()
          << "\nTime of a peer over time of rbres: median of the repetitions [smallest, largest]\n";
    GetOutputStream() << line;
  }

  static std::string join(const Name& name) {
    std::string joined;
    for (const std::string& part : name) joined += (joined.empty() ? "" : "/") + part;
    return joined;
  }

  std::vector<Row> rows_;
  bool titled_ = false;
};

/// Runs the registered rows as a program's main would. Repetitions of all rows are interleaved in random
/// order, so that a machine that slows down for a while slows every row; all flags of Google Benchmark still
/// hold.
inline int run_benchmarks(int argc, char** argv) {
  std::string defaults[]{"--benchmark_enable_random_interleaving=true", "--benchmark_repetitions=5",
                         "--benchmark_min_time=0.1"};
  std::vector<char*> arguments{argv[0]};
  for (std::string& flag : defaults) arguments.push_back(flag.data());
  arguments.insert(arguments.end(), argv + 1, argv + argc);
  int count = static_cast<int>(arguments.size());
  arguments.push_back(nullptr);
  benchmark::Initialize(&count, arguments.data());
  if (benchmark::ReportUnrecognizedArguments(count, arguments.data())) return 1;
  RatioReporter reporter;
  const bool console = std::none_of(argv + 1, argv + argc, [](const char* flag) {
    return std::string_view(flag) == "--benchmark_format=json" ||
           std::string_view(flag) == "--benchmark_format=csv";
  });
  benchmark::RunSpecifiedBenchmarks(console ? &reporter : nullptr);
  benchmark::Shutdown();
  return 0;
}

}  // namespace rbres::bench
