#pragma once

#include <rbres/core/denormals.hpp>
#include <rbres/core/parallel.hpp>
#include <rbres/nn/columns.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <numeric>
#include <vector>

namespace rbres::RBRES_ABI {

/// The mean of an objective over all its items, for networks without dropout, with scratch that is kept. No
/// bit depends on the number of threads. A move is a copy.
template <class Net, Objective<Net> O>
class Evaluation {
 public:
  /// Throws Error where the objective has no items, or threads are not 0 to 4096.
  Evaluation(const O& objective, int threads) {
    detail::check_threads(threads);
    if (objective.count() < 1) detail::refuse("Evaluation: items", "at least one", objective.count());
    const auto asked = std::ptrdiff_t{threads > 0 ? threads : default_threads()};
    const std::ptrdiff_t most = std::min(most_chunks, detail::chunks(objective, objective.count()));
    for (std::ptrdiff_t i = 0; i < std::min(asked, most); ++i)
      threads_.push_back(
          {objective.scratch(), std::vector<std::uint32_t>(static_cast<std::size_t>(objective.chunk()))});
  }

  /// A copy has scratch of its own.
  /// @{
  Evaluation(const Evaluation&) = default;
  Evaluation& operator=(const Evaluation&) = default;
  /// @}

  /// Of the objective that it was built for, or one of chunks that are as large; else throws Error.
  double mean(const Net& network, const O& objective) {
    if (objective.count() < 1) detail::refuse("Evaluation::mean: items", "at least one", objective.count());
    if (const auto room = std::ssize(threads_.front().items); objective.chunk() > room)
      detail::refuse("Evaluation::mean: items of a chunk", detail::text("at most ", room), objective.chunk());
    const std::ptrdiff_t chunk = objective.chunk(), total = detail::chunks(objective, objective.count());
    std::array<double, static_cast<std::size_t>(most_chunks)> sums;
    double sum = 0;
    for (std::ptrdiff_t start = 0; start < total; start += most_chunks) {
      const std::ptrdiff_t now = std::min(most_chunks, total - start);
      parallel_team(static_cast<int>(std::min(now, std::ssize(threads_))), [&](const Team& team) {
        const detail::FlushDenormals flush;
        Thread& own = threads_[static_cast<std::size_t>(team.index())];
        team.share(now, [&](std::ptrdiff_t task) {
          const std::ptrdiff_t first = (start + task) * chunk,
                               count = std::min(chunk, objective.count() - first);
          const auto items = std::span(own.items).first(static_cast<std::size_t>(count));
          std::iota(items.begin(), items.end(), static_cast<std::uint32_t>(first));
          sums[static_cast<std::size_t>(task)] = objective.value(network, items, own.scratch);
        });
      });
      for (std::ptrdiff_t i = 0; i < now; ++i) sum += sums[static_cast<std::size_t>(i)];
    }
    return sum / static_cast<double>(objective.count());
  }

 private:
  static constexpr std::ptrdiff_t most_chunks = 64;  ///< that are summed at once

  struct Thread {
    typename O::Scratch scratch;
    std::vector<std::uint32_t> items;  ///< of a chunk
  };
  std::vector<Thread> threads_;
};

/// Mean loss of a network without dropout. The bits do not depend on the number of threads. Throws Error
/// where there are no samples, or a size or number does not fit.
template <class Net, class T = typename Net::Scalar>
double mean_loss(const Net& network, const Samples<T>& samples, const Loss<T>& loss = {}, int threads = 0) {
  if (samples.count() == 0) detail::refuse("mean_loss: samples", "at least one", 0);
  const ColumnsObjective<Net> objective(samples, loss, "mean_loss: samples");
  return Evaluation<Net, ColumnsObjective<Net>>(objective, threads).mean(network, objective);
}

}  // namespace rbres::RBRES_ABI
