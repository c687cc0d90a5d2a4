#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <numeric>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rbres/io/atomic_file.hpp>
#include <rbres/io/file.hpp>
#include <rbres/io/npy_header.hpp>

namespace rbres::RBRES_ABI {

/// Writes a NumPy .npy file (format 1.0, C order) of shape (samples, ...) sample by sample, so that a data
/// set larger than the memory can be made. One sample is one column here and one entry of the first axis
/// there. The file appears with commit(), whole; see AtomicFile for the errors.
template <class Scalar>
class NpyWriter {
  static_assert(!detail::npy_descr<Scalar>().empty(), "rbres: no .npy files of this type");

 public:
  /// Samples as columns.
  using Columns = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic>;

  /// sample_shape is the shape of one sample in C order: {} makes a file of shape (samples), {65} one of
  /// (samples, 65), {251, 65} one of (samples, 251, 65).
  NpyWriter(std::filesystem::path path, std::vector<Eigen::Index> sample_shape)
      : sample_shape_(checked(path, std::move(sample_shape))), file_(std::move(path)) {
    file_.write(header(sample_shape_, 0).data(), header_size_);
  }

  /// Goes on after the first `samples` samples that an earlier run wrote to the partial file (0: begins
  /// anew). Without commit() the partial file stays for the next run.
  NpyWriter(std::filesystem::path path, std::vector<Eigen::Index> sample_shape, Eigen::Index samples)
      : sample_shape_(checked(path, std::move(sample_shape))),
        samples_(samples),
        file_(std::move(path), samples == 0 ? 0 : header_size_ + bytes(samples)) {
    if (samples == 0) file_.write(header(sample_shape_, 0).data(), header_size_);
  }

  /// Appends columns (features × n), features being the product of the sample shape.
  void append(const Eigen::Ref<const Columns>& columns) {
    if (columns.rows() != features_)
      detail::refuse(file_.path().string(), detail::text("columns of ", features_, " numbers"),
                     columns.rows());
    if (columns.outerStride() == columns.rows()) {
      file_.write(columns.data(), bytes(columns.cols()));
    } else {
      for (Eigen::Index i = 0; i < columns.cols(); ++i) file_.write(columns.col(i).data(), bytes(1));
    }
    samples_ += columns.cols();
  }

  /// Numbers of a sample.
  Eigen::Index features() const noexcept { return features_; }
  /// Written so far.
  Eigen::Index samples() const noexcept { return samples_; }

  /// Waits until the samples so far are on the disk.
  void flush() { file_.flush(); }

  /// Fixes the header, flushes, and puts the file in its place.
  void commit() {
    file_.write_at(0, header(sample_shape_, samples_).data(), header_size_);
    file_.commit();
  }

  /// What stands before the numbers of so many samples: of the same size for any number, so that it can be
  /// written last.
  static std::string header(const std::vector<Eigen::Index>& sample_shape, Eigen::Index samples) {
    std::vector<Eigen::Index> shape{std::numeric_limits<Eigen::Index>::max()};
    shape.insert(shape.end(), sample_shape.begin(), sample_shape.end());
    constexpr std::string_view descr = detail::npy_descr<Scalar>();
    const std::size_t size = detail::npy_header(descr, shape, 0).size();
    shape.front() = samples;
    return detail::npy_header(descr, shape, size);
  }

 private:
  static std::vector<Eigen::Index> checked(const std::filesystem::path& path,
                                           std::vector<Eigen::Index> sample_shape) {
    if (sample_shape.size() > 3)
      detail::refuse(path.string(), "samples of at most 3 dimensions", sample_shape.size());
    for (const Eigen::Index extent : sample_shape)
      if (extent < 0 || extent > 1 << 30)
        detail::refuse(path.string(), "a sample's extents from 0 to 2^30", extent);
    return sample_shape;
  }
  std::size_t bytes(Eigen::Index samples) const {
    return static_cast<std::size_t>(samples * features_) * sizeof(Scalar);
  }

  std::vector<Eigen::Index> sample_shape_;
  Eigen::Index features_ =
      std::accumulate(sample_shape_.begin(), sample_shape_.end(), Eigen::Index{1}, std::multiplies<>());
  Eigen::Index samples_ = 0;
  std::size_t header_size_ = header(sample_shape_, 0).size();
  AtomicFile file_;
};

/// Reads a NumPy .npy file (format 1, 2 or 3; C order; 1 to 4 dimensions; little-endian) as columns: the
/// first axis counts samples, the others are one sample's numbers in C order. Scalar is float, double,
/// std::int32_t, std::int64_t or std::uint8_t, and the file's type must be the same. Every malformed file is
/// an rbres::Error that names the path and what is wrong; no more is allocated than the file holds.
template <class Scalar>
class NpyReader {
  static_assert(!detail::npy_descr<Scalar>().empty(), "rbres: no .npy files of this type");

 public:
  /// Samples as columns.
  using Columns = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic>;

  /// Opens a file and reads its header.
  explicit NpyReader(std::filesystem::path path)
      : file_(std::move(path)), header_(detail::read_npy_header(file_)) {
    if (header_.descr != detail::npy_descr<Scalar>())
      detail::refuse(file_.path().string(), detail::text("dtype ", detail::npy_descr<Scalar>()),
                     header_.descr);
    std::uint64_t features = 1;
    for (std::size_t i = 1; i < header_.shape.size(); ++i)
      features =
          detail::checked_product(file_.path(), features, static_cast<std::uint64_t>(header_.shape[i]));
    features_ = static_cast<Eigen::Index>(features);
    const auto numbers =
        detail::checked_product(file_.path(), static_cast<std::uint64_t>(header_.shape.front()), features);
    const auto bytes = detail::checked_product(file_.path(), numbers, sizeof(Scalar));
    if (bytes != file_.size() - header_.data)
      detail::refuse(file_.path().string(), detail::text(bytes, " bytes of data, as its shape says"),
                     file_.size() - header_.data);
  }

  /// The array's shape, samples first.
  const std::vector<Eigen::Index>& shape() const noexcept { return header_.shape; }
  /// How many there are.
  Eigen::Index samples() const noexcept { return header_.shape.front(); }
  /// Numbers per sample: the product of the other extents.
  Eigen::Index features() const noexcept { return features_; }

  /// Samples first, ..., first + count - 1 as columns (features × count).
  Columns read(Eigen::Index first, Eigen::Index count) const {
    if (first < 0 || count < 0 || count > samples() - first)
      detail::refuse(file_.path().string(), detail::text("a range within ", samples(), " samples"),
                     detail::text(count, " from ", first));
    Columns columns(features_, count);
    const auto stride = static_cast<std::uint64_t>(features_) * sizeof(Scalar);
    file_.read(header_.data + static_cast<std::uint64_t>(first) * stride, columns.data(),
               static_cast<std::size_t>(columns.size()) * sizeof(Scalar));
    return columns;
  }

  /// All samples.
  Columns read() const { return read(0, samples()); }

 private:
  detail::InputFile file_;
  detail::NpyHeader header_;
  Eigen::Index features_ = 1;
};

/// Writes columns (features × samples) as a .npy file of shape (samples, features).
template <class Derived>
void write_npy(const std::filesystem::path& path, const Eigen::MatrixBase<Derived>& columns) {
  NpyWriter<typename Derived::Scalar> writer(path, {columns.rows()});
  writer.append(columns.derived());
  writer.commit();
}

/// Reads a whole .npy file as columns (features × samples); see NpyReader.
template <class Scalar>
Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic> read_npy(const std::filesystem::path& path) {
  return NpyReader<Scalar>(path).read();
}

}  // namespace rbres::RBRES_ABI
