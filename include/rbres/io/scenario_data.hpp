#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include <rbres/io/folder_lock.hpp>
#include <rbres/io/scenario_folder.hpp>

/// @file
/// Data sets on disk: a folder that anyone's NumPy reads. Arrays count scenarios first, in C order:
///
///     initial.npy        float32 (n, 5, 13)   states at the start, body by body
///     wrench.npy         float32 (n, 5, 6)    force and torque on each body
///     state_0.5s.npy     float32 (n, 5, 13)   truth at that horizon; one file for each
///     body_count.npy     uint8   (n,)         bodies from this one on are absent: their numbers are zero
///     family.npy         uint8   (n,)         0 flight, 1 pair, 2 cluster, 3 drop, 4 scatter
///     first_contact.npy  float32 (n,)         s, to within a sample; inf: none
///     impacts.npy        int32   (n, h)       impacts by each of the h horizons
///     dataset.json       what they were made from, how many scenarios are "done", and the SHA-256 of each
///                        array's file; its own is that of its text with zeros in the digest's place
///
/// Columns and units are those of ScenarioData. The arrays appear when all scenarios are done.
namespace rbres::RBRES_ABI {

namespace detail {

/// The arrays of a data set of which the first `done` scenarios are written.
class DatasetWriter {
 public:
  DatasetWriter(const DatasetFolder& folder, const std::vector<double>& horizons, Eigen::Index count,
                Eigen::Index done, const Json& digests)
      : initial_(folder, "initial.npy", states, count, done, digests),
        wrench_(folder, "wrench.npy", {ScenarioData::bodies, Wrench<float>::size}, count, done, digests),
        body_count_(folder, "body_count.npy", {}, count, done, digests),
        family_(folder, "family.npy", {}, count, done, digests),
        first_contact_(folder, "first_contact.npy", {}, count, done, digests),
        impacts_(folder, "impacts.npy", {std::ssize(horizons)}, count, done, digests) {
    for (const double h : horizons)
      states_.emplace_back(folder, DatasetFolder::state(h), states, count, done, digests);
  }

  /// Appends scenarios and waits until they are on the disk.
  void append(const ScenarioData& data) {
    initial_.append(data.initial);
    wrench_.append(data.wrench);
    for (std::size_t h = 0; h < states_.size(); ++h) states_[h].append(data.states[h]);
    DatasetArray<std::uint8_t>::Columns family(1, data.count());
    std::ranges::transform(data.family, family.data(), [](Family f) { return static_cast<std::uint8_t>(f); });
    family_.append(family);
    body_count_.append(
        Eigen::Map<const DatasetArray<std::uint8_t>::Columns>(data.body_count.data(), 1, data.count()));
    first_contact_.append(
        Eigen::Map<const DatasetArray<float>::Columns>(data.first_contact.data(), 1, data.count()));
    impacts_.append(data.impacts);
    each([](auto& file) { file.flush(); });
  }

  void commit() {
    each([](auto& file) { file.commit(); });
  }

  /// The digest of each file, by its name.
  Json digests() {
    Json all = Json::object();
    each([&](const auto& file) { all[file.name()] = file.digest(); });
    return all;
  }

 private:
  static inline const std::vector<Eigen::Index> states{ScenarioData::bodies, RigidState<float>::size};

  template <class Do>
  void each(const Do& act) {
    act(initial_), act(wrench_), act(body_count_), act(family_), act(first_contact_), act(impacts_);
    for (auto& file : states_) act(file);
  }

  DatasetArray<float> initial_, wrench_;
  DatasetArray<std::uint8_t> body_count_, family_;
  DatasetArray<float> first_contact_;
  DatasetArray<std::int32_t> impacts_;
  std::vector<DatasetArray<float>> states_;
};

/// Error where a number is not one that a scenario may have: finite, and no more than 1e6 in SI units.
inline void require_plausible(const std::filesystem::path& path, const ScenarioData::Columns& numbers) {
  for (Eigen::Index c = 0; c < numbers.cols(); ++c)
    for (const float x : numbers.col(c))
      if (!(std::abs(x) <= 1e6f)) refuse(text(path.string(), ": scenario ", c), "numbers up to 1e6", x);
}

/// The first `count` samples of an array of this shape, which must be the file that `description` means.
template <class Scalar>
auto read_samples(const DatasetFolder& folder, const std::string& name, std::vector<Eigen::Index> shape,
                  Eigen::Index count, const Json& description) {
  const auto path = folder.path() / name;
  const NpyReader<Scalar> file(path);
  if (file.shape() != shape)
    refuse(path.string(), "the shape " + Json(shape).dump(), Json(file.shape()).dump());
  const InputFile bytes(path);
  Sha256 hash;
  add_bytes(hash, bytes, 0, bytes.size());
  require_digest(path, description["arrays"].value(name, ""), hash);
  return file.read(0, count);
}

}  // namespace detail

/// Makes scenarios 0 ... count - 1 of a sampler and their truth at the horizons (s, increasing) into a
/// folder, a few thousand at a time, as generate() does and with its errors. The bytes are the same for any
/// number of threads. It may be stopped at any moment: called again it goes on where it was, and does nothing
/// when all is done. progress(done) is called at the start and after each piece. Error too where the folder
/// holds a data set of another setting, one half made by a program that was compiled otherwise (whose last
/// bits differ) or changed since, or other files: nothing is then overwritten.
template <BodySet Set, class Progress>
void write_dataset(const std::filesystem::path& path, const ScenarioSampler<Set>& sampler, Eigen::Index count,
                   const std::vector<double>& horizons, const TruthOptions& options, Progress&& progress) {
  if (count < 1) detail::refuse("number of scenarios", "1 or more", count);
  detail::check_horizons(horizons, options.sample_rate);
  const detail::DatasetFolder folder(path);
  folder.make();
  const FolderLock lock(path, "makes this data set");
  const detail::Json setting = detail::dataset_setting(sampler, count, horizons, options);
  if (!folder.described()) folder.write_description(setting, 0, detail::Json::object());
  const detail::Json found = folder.read_description();
  for (const auto& entry : setting.items()) folder.require(found, setting, entry.key());
  auto done = found["done"].get<Eigen::Index>();
  if (done < 0 || done > count || (done < count && done % detail::scenario_piece != 0))
    detail::refuse(folder.text() + ": done", "scenarios done piece by piece", done);
  // Other flags give other last bits, which must not be mixed. What is done may be read under any.
  if (done > 0 && done < count) folder.require(found, {{"build", detail::dataset_build()}}, "build");
  progress(done);
  if (done == count) return;
  detail::DatasetWriter files(folder, horizons, count, done, found["arrays"]);
  while (done < count) {
    const Eigen::Index size = std::min(detail::scenario_piece, count - done);
    files.append(generate(sampler, static_cast<std::uint64_t>(done), size, horizons, options));
    done += size;
    if (done < count) folder.write_description(setting, done, files.digests());
    progress(done);
  }
  files.commit();
  folder.write_description(setting, count, files.digests());
}

/// Whether the folder holds a data set of which all scenarios are done. Error where it holds a broken one.
inline bool dataset_is_done(const std::filesystem::path& path) {
  const detail::DatasetFolder folder(path);
  if (!folder.described()) return false;
  const detail::Json found = folder.read_description();
  return found["done"] == found.value("scenarios", detail::Json());
}

/// Reads the first `count` scenarios and the given horizons of a data set, which may hold more of both; the
/// first contacts are those up to its last horizon. Error where the folder is not there, is of another
/// setting or is not done, or a file of it is malformed or changed.
template <BodySet Set>
ScenarioData read_dataset(const std::filesystem::path& path, const ScenarioSampler<Set>& sampler,
                          Eigen::Index count, const std::vector<double>& horizons,
                          const TruthOptions& options = {}) {
  const detail::DatasetFolder folder(path);
  const detail::Json found = folder.read_description();
  const detail::Json setting = detail::dataset_setting(sampler, count, horizons, options);
  for (const auto& entry : setting.items())
    if (entry.key() != "horizons" && entry.key() != "scenarios") folder.require(found, setting, entry.key());
  const auto scenarios = found.value("scenarios", detail::Json()), held = found.value("horizons", scenarios);
  if (!scenarios.is_number_unsigned() || scenarios != found["done"])
    detail::refuse(folder.text(), detail::text("all of its ", scenarios, " scenarios done"), found["done"]);
  const auto n = scenarios.get<Eigen::Index>();
  if (count < 1 || count > n)
    detail::refuse(folder.text() + ": scenarios", detail::text("1 to ", n, " to be read"), count);
  constexpr Eigen::Index bodies = ScenarioData::bodies;
  ScenarioData data;
  data.horizons = horizons;
  const auto read = [&]<class Scalar>(const std::string& name, std::vector<Eigen::Index> shape, Scalar) {
    return detail::read_samples<Scalar>(folder, name, std::move(shape), count, found);
  };
  const auto read_numbers = [&](const std::string& name, Eigen::Index size) {
    ScenarioData::Columns numbers = read(name, {n, bodies, size}, 0.0f);
    detail::require_plausible(path / name, numbers);
    return numbers;
  };
  data.initial = read_numbers("initial.npy", 13);
  data.wrench = read_numbers("wrench.npy", 6);
  const auto impacts = read("impacts.npy", {n, std::ssize(held)}, std::int32_t{});
  data.impacts.resize(std::ssize(horizons), count);
  for (Eigen::Index h = 0; h < std::ssize(horizons); ++h) {
    const double horizon = horizons[static_cast<std::size_t>(h)];
    const auto at = std::ranges::find(held, detail::Json(horizon)) - held.begin();
    if (at == std::ssize(held))
      detail::refuse(folder.text() + ": horizons", detail::text("one of ", held), horizon);
    data.impacts.row(h) = impacts.row(at);
    data.states.push_back(read_numbers(folder.state(horizon), 13));
  }
  const auto first_contact = read("first_contact.npy", {n}, 0.0f);
  data.first_contact.assign(first_contact.data(), first_contact.data() + count);
  const auto body_count = read("body_count.npy", {n}, std::uint8_t{});
  const auto family = read("family.npy", {n}, std::uint8_t{});
  const auto require = [&](bool fits, const char* name, const char* expected, double number) {
    if (!fits) detail::refuse((path / name).string(), expected, number);
  };
  for (Eigen::Index i = 0; i < count; ++i) {
    require(body_count(i) >= 3 && body_count(i) <= bodies, "body_count.npy", "3 to 5 bodies", body_count(i));
    require(family(i) <= static_cast<int>(Family::scatter), "family.npy", "families 0 to 4", family(i));
    require(first_contact(i) >= 0, "first_contact.npy", "times of 0 s or more", first_contact(i));
    require((impacts.col(i).array() >= 0).all(), "impacts.npy", "numbers of 0 or more",
            impacts.col(i).minCoeff());
    data.body_count.push_back(body_count(i));
    data.family.push_back(static_cast<Family>(family(i)));
  }
  return data;
}

}  // namespace rbres::RBRES_ABI
