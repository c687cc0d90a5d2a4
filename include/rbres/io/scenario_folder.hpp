#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include <rbres/io/atomic_file.hpp>
#include <rbres/io/digest.hpp>
#include <rbres/io/json_file.hpp>
#include <rbres/io/npy.hpp>
#include <rbres/paper/scenario_data.hpp>

/// @file
/// What the folder of a data set holds: its description and its arrays.
namespace rbres::RBRES_ABI::detail {

inline constexpr int dataset_format = 2;

/// What a data set depends on, and nothing else.
template <BodySet Set>
Json dataset_setting(const ScenarioSampler<Set>& sampler, Eigen::Index count,
                     const std::vector<double>& horizons, const TruthOptions& options) {
  const bool continuous = SimulationOptions{}.contacts == ContactMode::continuous;
  return {{"format", dataset_format},
          {"scenario_version", scenario_version},
          {"world", name(sampler.world())},
          {"set", name(Set)},
          {"seed", sampler.seed()},
          {"truth_step", options.step},
          {"contacts", continuous ? "continuous" : "discrete"},
          {"sample_rate", options.sample_rate},
          {"horizons", horizons},
          {"scenarios", count}};
}

/// What decides the last bits of truth beside the setting: how this program was compiled.
inline Json dataset_build() {
#ifdef __FMA__
  constexpr bool fma = true;
#else
  constexpr bool fma = false;
#endif
#ifdef __OPTIMIZE__
  constexpr bool optimized = true;
#else
  constexpr bool optimized = false;
#endif
  return {{"lanes", double_lanes}, {"fma", fma}, {"optimized", optimized}, {"compiler", __VERSION__}};
}

/// A folder with a data set in it, or to make one in.
class DatasetFolder {
 public:
  explicit DatasetFolder(std::filesystem::path path) : path_(std::move(path)) {}

  const std::filesystem::path& path() const { return path_; }
  std::string text() const { return path_.string(); }
  std::filesystem::path description() const { return path_ / "dataset.json"; }
  static std::string state(double horizon) {
    return "state_" + Json(horizon).dump() + "s.npy";  // not by locale, as streams would
  }
  bool described() const { return std::filesystem::exists(description()); }

  Json read_description() const {
    std::string bytes = read_text(description());
    const std::string path = description().string();
    Json found = Json::parse(bytes, nullptr, false);
    const bool is_ours = found.is_object() && found.contains("done") && found["done"].is_number_unsigned();
    if (!is_ours) refuse(path, "the description of a data set", "something else");
    if (const Json format = found.value("format", Json("none")); format == 1)
      refuse(path + ": format", detail::text(dataset_format),
             "1: rbres 0.1.0 before digests made it, and truth of boxes that hit planes was wrong then; "
             "make it anew in another folder");
    else if (format != dataset_format)
      refuse(path + ": format", detail::text(dataset_format), format);
    const std::size_t place = digest_place(bytes);
    if (place == bytes.npos || !found.contains("arrays") || !found["arrays"].is_object())
      refuse(path, "a description with digests (sha256)", "none");
    const std::string expected = bytes.substr(place, no_digest.size());
    bytes.replace(place, no_digest.size(), no_digest);
    Sha256 hash;
    hash.add(bytes.data(), bytes.size());
    require_digest(description(), expected, hash);
    return found;
  }

  /// `arrays`: the digest of each array's file as it will be when no more than the scenarios that are done
  /// stand in it.
  void write_description(const Json& setting, Eigen::Index done, const Json& arrays) const {
    Json all = setting;
    all["build"] = dataset_build();
    all["done"] = static_cast<std::uint64_t>(done);
    all["arrays"] = arrays;
    all["sha256"] = no_digest;
    std::string bytes = all.dump(1) + "\n";
    Sha256 hash;
    hash.add(bytes.data(), bytes.size());
    bytes.replace(digest_place(bytes), no_digest.size(), hash.text());
    write_text(description(), bytes);
  }

  /// Refuses a description in which `key` is not what it should be.
  void require(const Json& description, const Json& setting, const std::string& key) const {
    const Json found = description.value(key, Json("none"));
    if (found != setting[key]) refuse(text() + ": " + key, setting[key].dump(), found);
  }

  /// Makes the folder where there is none. Refuses one that holds anything else than a data set.
  void make() const {
    std::error_code problem;
    std::filesystem::create_directories(path_, problem);
    if (problem) detail::fail(detail::text(text(), ": cannot be made: ", problem.message()));
    if (described()) return;
    for (const auto& entry : std::filesystem::directory_iterator(path_))
      if (entry.path() != AtomicFile::partial(description()))
        refuse(text(), "a data set or an empty folder", "one that holds " + entry.path().filename().string());
  }

 private:
  std::filesystem::path path_;
};

/// One array of a data set of `count` scenarios while it is made, and its file's digest.
template <class Scalar>
class DatasetArray {
 public:
  using Columns = typename NpyWriter<Scalar>::Columns;

  /// Goes on after `done` scenarios, which must be those of which `digests` has the digest.
  DatasetArray(const DatasetFolder& folder, std::string name, std::vector<Eigen::Index> sample_shape,
               Eigen::Index count, Eigen::Index done, const Json& digests)
      : name_(std::move(name)),
        hash_(resumed(folder.path() / name_, sample_shape, count, done, digests)),
        file_(folder.path() / name_, std::move(sample_shape), done) {}

  void append(const Eigen::Ref<const Columns>& columns) {
    file_.append(columns);
    for (Eigen::Index i = 0; i < columns.cols(); ++i)
      hash_.add(columns.col(i).data(), static_cast<std::size_t>(columns.rows()) * sizeof(Scalar));
  }
  void flush() { file_.flush(); }
  void commit() { file_.commit(); }

  const std::string& name() const { return name_; }
  /// Of the header of the whole array and the scenarios so far: in the end what sha256sum prints.
  std::string digest() const { return hash_.text(); }

 private:
  static Sha256 resumed(const std::filesystem::path& path, const std::vector<Eigen::Index>& sample_shape,
                        Eigen::Index count, Eigen::Index done, const Json& digests) {
    // A run that was killed while it put its arrays in their places is not done: they become partial again.
    const auto partial = AtomicFile::partial(path);
    if (std::filesystem::exists(path)) std::filesystem::rename(path, partial);
    const std::string header = NpyWriter<Scalar>::header(sample_shape, count);
    Sha256 hash;
    hash.add(header.data(), header.size());
    if (done == 0) return hash;
    const InputFile file(partial);
    std::uint64_t bytes = sizeof(Scalar) * static_cast<std::uint64_t>(done);
    for (const Eigen::Index extent : sample_shape) bytes *= static_cast<std::uint64_t>(extent);
    if (file.size() < header.size() + bytes)
      refuse(partial.string(), detail::text("at least ", header.size() + bytes, " bytes"), file.size());
    add_bytes(hash, file, header.size(), header.size() + bytes);
    require_digest(partial, digests.value(path.filename().string(), ""), hash);
    return hash;
  }

  std::string name_;
  Sha256 hash_;
  NpyWriter<Scalar> file_;
};

}  // namespace rbres::RBRES_ABI::detail
