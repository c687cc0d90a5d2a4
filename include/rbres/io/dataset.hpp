#pragma once

#include <algorithm>
#include <filesystem>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include <rbres/io/atomic_file.hpp>
#include <rbres/io/npy.hpp>
#include <rbres/sim/dataset.hpp>

/// Data sets on disk: a folder that anyone's NumPy reads. Arrays count scenarios first, in C order:
///     initial.npy        float32 (n, 5, 13)   states at the start, body by body
///     wrench.npy         float32 (n, 5, 6)    force and torque on each body
///     state_0.5s.npy     float32 (n, 5, 13)   truth at that horizon; one file for each
///     body_count.npy     uint8   (n,)         bodies from this one on are absent: their numbers are zero
///     family.npy         uint8   (n,)         0 flight, 1 pair, 2 cluster, 3 drop, 4 scatter
///     first_contact.npy  float32 (n,)         s, to within a sample; inf: none
///     impacts.npy        int32   (n, h)       impacts by each of the h horizons
///     dataset.json       what they were made from, and how many scenarios are "done"
/// Columns and units are those of ScenarioData. The arrays appear when all scenarios are done.
namespace rbres {

namespace detail {

using Json = nlohmann::ordered_json;

/// What a data set depends on, and nothing else.
template <BodySet Set>
Json dataset_setting(const ScenarioSampler<Set>& sampler, Eigen::Index count,
                     const std::vector<double>& horizons, const TruthOptions& options) {
  return {{"format", 1},
          {"scenario_version", scenario_version},
          {"world", name(sampler.world())},
          {"set", name(Set)},
          {"seed", sampler.seed()},
          {"truth_step", options.step},
          {"sample_rate", options.sample_rate},
          {"horizons", horizons},
          {"scenarios", count}};
}

/// A folder with a data set in it, or to make one in.
class DatasetFolder {
 public:
  explicit DatasetFolder(std::filesystem::path path) : path_(std::move(path)) {}

  const std::filesystem::path& path() const { return path_; }
  std::string text() const { return path_.string(); }
  std::filesystem::path description() const { return path_ / "dataset.json"; }
  std::filesystem::path state(double horizon) const {
    return path_ / ("state_" + Json(horizon).dump() + "s.npy");  // not by locale, as streams would
  }
  bool described() const { return std::filesystem::exists(description()); }

  Json read_description() const {
    const InputFile file(description());
    if (file.size() > 1'000'000) refuse(file.path().string(), "at most a megabyte", file.size());
    std::string bytes(file.size(), '\0');
    file.read(0, bytes.data(), bytes.size());
    Json found = Json::parse(bytes, nullptr, false);
    const bool is_ours = found.is_object() && found.contains("done") && found["done"].is_number_unsigned();
    if (!is_ours) refuse(file.path().string(), "the description of a data set", "something else");
    return found;
  }

  void write_description(const Json& setting, Eigen::Index done) const {
    Json all = setting;
    all["done"] = static_cast<std::uint64_t>(done);
    const std::string bytes = all.dump(1) + "\n";
    AtomicFile file(description());
    file.write(bytes.data(), bytes.size());
    file.commit();
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
    if (problem) throw Error(detail::text(text(), ": cannot be made: ", problem.message()));
    if (described()) return;
    for (const auto& entry : std::filesystem::directory_iterator(path_))
      if (const auto name = entry.path().filename().string(); name != "dataset.json.partial")
        refuse(text(), "a data set or an empty folder", "one that holds " + name);
  }

  /// Keeps other processes out while it lives.
  FileDescriptor lock() const {
    FileDescriptor folder(::open(path_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
    if (!folder.valid()) refuse_file(path_, "read");
    if (::flock(folder.get(), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK)
      throw Error(detail::text(text(), ": another process makes this data set"));
    return folder;
  }

 private:
  std::filesystem::path path_;
};

/// The arrays of a data set of which the first `done` scenarios are written.
class DatasetWriter {
 public:
  DatasetWriter(const DatasetFolder& folder, const std::vector<double>& horizons, Eigen::Index done)
      : initial_(path(folder, "initial.npy"), {ScenarioData::bodies, RigidState<float>::size}, done),
        wrench_(path(folder, "wrench.npy"), {ScenarioData::bodies, Wrench<float>::size}, done),
        body_count_(path(folder, "body_count.npy"), {}, done),
        family_(path(folder, "family.npy"), {}, done),
        first_contact_(path(folder, "first_contact.npy"), {}, done),
        impacts_(path(folder, "impacts.npy"), {std::ssize(horizons)}, done) {
    for (const double h : horizons) {
      states_.emplace_back(unfinished(folder.state(h)),
                           std::vector<Eigen::Index>{ScenarioData::bodies, RigidState<float>::size}, done);
    }
  }

  /// Appends scenarios and waits until they are on the disk.
  void append(const ScenarioData& data) {
    initial_.append(data.initial);
    wrench_.append(data.wrench);
    for (std::size_t h = 0; h < states_.size(); ++h) states_[h].append(data.states[h]);
    NpyWriter<std::uint8_t>::Columns family(1, data.count());
    std::ranges::transform(data.family, family.data(), [](Family f) { return static_cast<std::uint8_t>(f); });
    family_.append(family);
    body_count_.append(
        Eigen::Map<const NpyWriter<std::uint8_t>::Columns>(data.body_count.data(), 1, data.count()));
    first_contact_.append(
        Eigen::Map<const NpyWriter<float>::Columns>(data.first_contact.data(), 1, data.count()));
    impacts_.append(data.impacts);
    each([](auto& file) { file.flush(); });
  }

  void commit() {
    each([](auto& file) { file.commit(); });
  }

 private:
  /// A run that was killed while it put its arrays in their places is not done: they become partial again.
  static std::filesystem::path unfinished(std::filesystem::path path) {
    if (std::filesystem::exists(path)) std::filesystem::rename(path, path.string() + ".partial");
    return path;
  }
  static std::filesystem::path path(const DatasetFolder& folder, const char* name) {
    return unfinished(folder.path() / name);
  }
  template <class Do>
  void each(const Do& act) {
    act(initial_), act(wrench_), act(body_count_), act(family_), act(first_contact_), act(impacts_);
    for (auto& file : states_) act(file);
  }

  NpyWriter<float> initial_, wrench_;
  NpyWriter<std::uint8_t> body_count_, family_;
  NpyWriter<float> first_contact_;
  NpyWriter<std::int32_t> impacts_;
  std::vector<NpyWriter<float>> states_;
};

/// The first `count` samples of an array of `samples` of this shape.
template <class Scalar>
auto read_samples(const std::filesystem::path& path, std::vector<Eigen::Index> shape, Eigen::Index count) {
  const NpyReader<Scalar> file(path);
  if (file.shape() != shape)
    refuse(path.string(), "the shape " + Json(shape).dump(), Json(file.shape()).dump());
  return file.read(0, count);
}

}  // namespace detail

/// Makes scenarios 0 ... count - 1 of a sampler and their truth at the horizons (s, increasing) into a
/// folder, a few thousand at a time, as generate() does and with its errors. The bytes are the same for any
/// number of threads. It may be stopped at any moment: called again it goes on where it was, and does nothing
/// when all is done. progress(done) is called at the start and after each piece. Error too where the folder
/// holds a data set of another setting, or other files: nothing is then overwritten.
template <BodySet Set, class Progress>
void write_dataset(const std::filesystem::path& path, const ScenarioSampler<Set>& sampler, Eigen::Index count,
                   const std::vector<double>& horizons, const TruthOptions& options, Progress&& progress) {
  if (count < 1) detail::refuse("number of scenarios", "1 or more", count);
  detail::check_horizons(horizons, options.sample_rate);
  const detail::DatasetFolder folder(path);
  folder.make();
  const auto lock = folder.lock();
  const detail::Json setting = detail::dataset_setting(sampler, count, horizons, options);
  if (!folder.described()) folder.write_description(setting, 0);
  const detail::Json found = folder.read_description();
  for (const auto& entry : setting.items()) folder.require(found, setting, entry.key());
  auto done = found["done"].get<Eigen::Index>();
  if (done < 0 || done > count || (done < count && done % detail::scenario_piece != 0))
    detail::refuse(folder.text() + ": done", "scenarios done piece by piece", done);
  progress(done);
  if (done == count) return;
  detail::DatasetWriter files(folder, horizons, done);
  while (done < count) {
    const Eigen::Index size = std::min(detail::scenario_piece, count - done);
    files.append(generate(sampler, static_cast<std::uint64_t>(done), size, horizons, options));
    done += size;
    if (done < count) folder.write_description(setting, done);
    progress(done);
  }
  files.commit();
  folder.write_description(setting, count);
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
/// setting or is not done, or a file of it is malformed.
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
  data.initial = detail::read_samples<float>(path / "initial.npy", {n, bodies, 13}, count);
  data.wrench = detail::read_samples<float>(path / "wrench.npy", {n, bodies, 6}, count);
  const auto impacts = detail::read_samples<std::int32_t>(path / "impacts.npy", {n, std::ssize(held)}, count);
  data.impacts.resize(std::ssize(horizons), count);
  for (Eigen::Index h = 0; h < std::ssize(horizons); ++h) {
    const double horizon = horizons[static_cast<std::size_t>(h)];
    const auto at = std::ranges::find(held, detail::Json(horizon)) - held.begin();
    if (at == std::ssize(held))
      detail::refuse(folder.text() + ": horizons", detail::text("one of ", held), horizon);
    data.impacts.row(h) = impacts.row(at);
    data.states.push_back(detail::read_samples<float>(folder.state(horizon), {n, bodies, 13}, count));
  }
  const auto first_contact = detail::read_samples<float>(path / "first_contact.npy", {n}, count);
  data.first_contact.assign(first_contact.data(), first_contact.data() + count);
  const auto body_count = detail::read_samples<std::uint8_t>(path / "body_count.npy", {n}, count);
  const auto family = detail::read_samples<std::uint8_t>(path / "family.npy", {n}, count);
  for (Eigen::Index i = 0; i < count; ++i) {
    if (body_count(i) < 3 || body_count(i) > bodies)
      detail::refuse((path / "body_count.npy").string(), "3 to 5 bodies", static_cast<int>(body_count(i)));
    if (family(i) > static_cast<int>(Family::scatter))
      detail::refuse((path / "family.npy").string(), "families 0 to 4", static_cast<int>(family(i)));
    data.body_count.push_back(body_count(i));
    data.family.push_back(static_cast<Family>(family(i)));
  }
  return data;
}

}  // namespace rbres
