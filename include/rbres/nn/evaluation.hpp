#pragma once

#include <rbres/core/denormals.hpp>
#include <rbres/core/parallel.hpp>
#include <rbres/nn/loss.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

namespace rbres {

/// The mean loss of networks without dropout, with buffers that are kept. No bit depends on the number of
/// threads.
template <class Net>
class Evaluation {
  using T = typename Net::Scalar;

 public:
  explicit Evaluation(int threads)
      : buffers_(static_cast<std::size_t>(threads > 0 ? threads : default_threads())) {}

  double mean_loss(const Net& network, const Samples<T>& samples, const Loss<T>& loss) {
    double total = 0;
    for (Eigen::Index start = 0; start < samples.count(); start += std::ssize(sums_) * chunk) {
      const Eigen::Index chunks =
          std::min<Eigen::Index>(std::ssize(sums_), (samples.count() - start + chunk - 1) / chunk);
      parallel_team(static_cast<int>(std::min(chunks, std::ssize(buffers_))), [&](const Team& team) {
        const detail::FlushDenormals flush;
        Buffers& own = buffers_[static_cast<std::size_t>(team.index())];
        team.share(chunks, [&](std::ptrdiff_t task) {
          const Eigen::Index first = start + task * chunk, count = std::min(chunk, samples.count() - first);
          network.forward(samples.inputs.middleCols(first, count), own.outputs.leftCols(count),
                          own.workspace);
          typename Net::Output gradient;
          double sum = 0;
          for (Eigen::Index c = 0; c < count; ++c)
            sum += loss.evaluate(samples, first + c, own.outputs.col(c).data(), gradient.data());
          sums_[static_cast<std::size_t>(task)] = sum;
        });
      });
      for (Eigen::Index i = 0; i < chunks; ++i) total += sums_[static_cast<std::size_t>(i)];
    }
    return total / static_cast<double>(samples.count());
  }

 private:
  static constexpr Eigen::Index chunk = 96;
  struct Buffers {
    typename Net::Workspace workspace;
    typename Net::Columns outputs = typename Net::Columns(Net::output_size, chunk);
  };
  std::vector<Buffers> buffers_;  // one for each thread
  std::array<double, 64> sums_;   // of chunks
};

/// Mean loss of a network without dropout. The bits do not depend on the number of threads.
template <class Net, class T = typename Net::Scalar>
double mean_loss(const Net& network, const Samples<T>& samples, const Loss<T>& loss = {}, int threads = 0) {
  return Evaluation<Net>(threads).mean_loss(network, samples, loss);
}

}  // namespace rbres
