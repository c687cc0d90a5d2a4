#pragma once

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <variant>
#include <vector>

#include <rbres/core/pack.hpp>
#include <rbres/io/atomic_file.hpp>
#include <rbres/io/digest.hpp>
#include <rbres/io/folder_lock.hpp>
#include <rbres/io/json_file.hpp>
#include <rbres/io/npy.hpp>
#include <rbres/version.hpp>

/// @file
/// What the folder of a data set holds, its description and its arrays, and how it is made piece by piece.
namespace rbres::RBRES_ABI::detail {

/// What data sets of one layout say of themselves.
struct DatasetKind {
  const char* name;
  int format;
  const char* former = "";  ///< why the format before is refused
};

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
  DatasetFolder(std::filesystem::path path, DatasetKind kind) : path_(std::move(path)), kind_(kind) {}

  const std::filesystem::path& path() const { return path_; }
  std::string text() const { return path_.string(); }
  std::filesystem::path description() const { return path_ / "dataset.json"; }
  bool described() const { return file_exists(description()); }

  Json read_description() const {
    std::string bytes = read_text(description());
    const std::string path = description().string();
    Json found = Json::parse(bytes, nullptr, false);
    const bool is_ours = found.is_object() && found.contains("done") && found["done"].is_number_unsigned();
    if (!is_ours) refuse(path, "the description of a data set", "something else");
    // Data sets of scenarios, which were the first, do not name their kind.
    if (const Json kind = found.value("kind", Json("scenarios")); kind != kind_.name)
      refuse(path, detail::text("a data set of ", kind_.name), kind);
    if (const Json format = found.value("format", Json("none")); format != kind_.format) {
      std::string who = format == kind_.format - 1 ? kind_.former : "";
      if (who.empty() && found.contains("writer")) who = detail::text(": ", found["writer"], " wrote it");
      refuse(path + ": format", detail::text(kind_.format), detail::text(format, who));
    }
    const std::size_t place = digest_place(bytes);
    if (place == bytes.npos || !found.contains("arrays") || !found["arrays"].is_object())
      refuse(path, "a description with digests (sha256)", "none");
    for (const Json& digest : found["arrays"])
      if (!digest.is_string()) refuse(path + ": arrays", "a digest of each", digest);
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
    all["writer"] =
        detail::text("rbres ", RBRES_VERSION_MAJOR, ".", RBRES_VERSION_MINOR, ".", RBRES_VERSION_PATCH);
    all["build"] = dataset_build();
    all["done"] = static_cast<std::uint64_t>(done);
    all["arrays"] = arrays;
    all["sha256"] = no_digest;
    std::string bytes = all.dump(1) + "\n";
    Sha256 hash;
    hash.add(bytes.data(), bytes.size());
    bytes.replace(digest_place(bytes), no_digest.size(), hash.text());
    if (bytes.size() > most_text) refuse(description().string(), "at most a megabyte", bytes.size());
    write_text(description(), bytes);
  }

  /// Refuses a description in which `key` is not what it should be. In a list of objects, such as that of the
  /// bodies, names the number that is not.
  void require(const Json& description, const Json& setting, const std::string& key) const {
    const Json found = description.value(key, Json("none"));
    const Json& expected = setting[key];
    if (found == expected) return;
    if (expected.is_array() && found.is_array() && found.size() == expected.size())
      for (std::size_t i = 0; i < expected.size(); ++i)
        if (expected[i].is_object() && found[i].is_object())
          for (const auto& entry : expected[i].items())
            if (const Json other = found[i].value(entry.key(), Json("none")); other != entry.value())
              refuse(detail::text(text(), ": ", key, "[", i, "], ", entry.key()), entry.value().dump(),
                     other);
    refuse(text() + ": " + key, expected.dump(), found);
  }

  /// Makes the folder where there is none. Refuses one that holds anything else than a data set.
  void make() const {
    make_folder(path_);
    if (described()) return;
    std::error_code problem;
    const std::filesystem::directory_iterator entries(path_, problem);
    refuse_problem(path_, "be looked at", problem);
    for (const auto& entry : entries)
      if (entry.path() != AtomicFile::partial(description()))
        refuse(text(), "a data set or an empty folder", "one that holds " + entry.path().filename().string());
  }

 private:
  std::filesystem::path path_;
  DatasetKind kind_;
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
    if (file_exists(path)) std::filesystem::rename(path, partial);
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

/// The arrays of a data set of `count` samples, of which the first `done` are written.
class DatasetArrays {
 public:
  DatasetArrays(const DatasetFolder& folder, Eigen::Index count, Eigen::Index done, const Json& digests)
      : folder_(&folder), count_(count), done_(done), digests_(&digests) {}

  template <class Scalar>
  void add(const std::string& name, std::vector<Eigen::Index> sample_shape) {
    all_.emplace_back(std::in_place_type<DatasetArray<Scalar>>, *folder_, name, std::move(sample_shape),
                      count_, done_, *digests_);
  }

  /// Appends columns to the array of this name.
  template <class Derived>
  void append(std::string_view name, const Eigen::MatrixBase<Derived>& columns) {
    for (auto& array : all_)
      if (auto* to = std::get_if<DatasetArray<typename Derived::Scalar>>(&array); to && to->name() == name)
        to->append(columns.derived());
  }

  /// Waits until all samples are on the disk.
  void flush() {
    for (auto& array : all_) std::visit([](auto& file) { file.flush(); }, array);
  }
  void commit() {
    for (auto& array : all_) std::visit([](auto& file) { file.commit(); }, array);
  }
  /// The digest of each file, by its name.
  Json digests() const {
    Json digests = Json::object();
    for (const auto& array : all_)
      std::visit([&](const auto& file) { digests[file.name()] = file.digest(); }, array);
    return digests;
  }

 private:
  const DatasetFolder* folder_;
  Eigen::Index count_, done_;
  const Json* digests_;
  std::vector<std::variant<DatasetArray<float>, DatasetArray<double>, DatasetArray<std::uint8_t>,
                           DatasetArray<std::int32_t>>>
      all_;
};

/// How many samples a data set has, how many are made at a time, and of what number their count is a multiple
/// wherever it stops.
struct DatasetPieces {
  Eigen::Index count, piece, multiple;
};

/// Makes a data set, or what is left of it: declare(arrays) adds its arrays, append(arrays, first, size)
/// appends samples. `probe`, where there is one, says what the numbers are beside the setting: it is held
/// against that of the folder where the same build made both.
template <class Declare, class Append, class Progress>
void make_dataset(const DatasetFolder& folder, const Json& setting, const Json& probe,
                  const DatasetPieces& pieces, const Declare& declare, const Append& append,
                  Progress&& progress) {
  const Eigen::Index count = pieces.count;
  folder.make();
  const FolderLock lock(folder.path(), "makes this data set");
  Json written = setting;
  written.update(probe);
  if (!folder.described()) folder.write_description(written, 0, Json::object());
  const Json found = folder.read_description();
  for (const auto& entry : setting.items()) folder.require(found, setting, entry.key());
  auto done = found["done"].get<Eigen::Index>();
  if (done < 0 || done > count || (done < count && done % pieces.multiple != 0))
    refuse(folder.text() + ": done", "samples done piece by piece", done);
  // Other flags give other last bits, which must not be mixed. What is done may be read under any.
  const Json build = Json::object({{"build", dataset_build()}});
  if (done > 0 && done < count) folder.require(found, build, "build");
  if (found.value("build", Json()) == build["build"])
    for (const auto& entry : probe.items()) folder.require(found, probe, entry.key());
  progress(done);
  if (done == count) return;
  DatasetArrays arrays(folder, count, done, found["arrays"]);
  declare(arrays);
  while (done < count) {
    const Eigen::Index size = std::min(pieces.piece, count - done);
    append(arrays, done, size);
    arrays.flush();
    done += size;
    if (done < count) folder.write_description(written, done, arrays.digests());
    progress(done);
  }
  arrays.commit();
  folder.write_description(written, count, arrays.digests());
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

}  // namespace rbres::RBRES_ABI::detail
