#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include <rbres/io/scenario_folder.hpp>

/// @file
/// Data sets of the paper's scenarios on disk: a folder that anyone's NumPy reads. Arrays count scenarios
/// first, in C order:
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

/// Adds the arrays of a data set at these horizons.
inline void add_arrays(DatasetArrays& arrays, const std::vector<double>& horizons) {
  const std::vector<Eigen::Index> states{ScenarioData::bodies, RigidState<float>::size};
  arrays.add<float>("initial.npy", states);
  arrays.add<float>("wrench.npy", {ScenarioData::bodies, Wrench<float>::size});
  arrays.add<std::uint8_t>("body_count.npy", {});
  arrays.add<std::uint8_t>("family.npy", {});
  arrays.add<float>("first_contact.npy", {});
  arrays.add<std::int32_t>("impacts.npy", {std::ssize(horizons)});
  for (const double h : horizons) arrays.add<float>(state_file(h), states);
}

/// Appends scenarios.
inline void append_scenarios(DatasetArrays& arrays, const ScenarioData& data) {
  const auto row = [&]<class T>(const char* name, const std::vector<T>& numbers) {
    arrays.append(name, Eigen::Map<const typename DatasetArray<T>::Columns>(numbers.data(), 1, data.count()));
  };
  std::vector<std::uint8_t> family(data.family.size());
  std::transform(data.family.begin(), data.family.end(), family.begin(),
                 [](Family f) { return static_cast<std::uint8_t>(f); });
  arrays.append("initial.npy", data.initial);
  arrays.append("wrench.npy", data.wrench);
  row("body_count.npy", data.body_count);
  row("family.npy", family);
  row("first_contact.npy", data.first_contact);
  arrays.append("impacts.npy", data.impacts);
  for (std::size_t h = 0; h < data.horizons.size(); ++h)
    arrays.append(state_file(data.horizons[h]), data.states[h]);
}

/// Error where a number is not one that a scenario may have: finite, and no more than 1e6 in SI units.
inline void require_plausible(const std::filesystem::path& path, const ScenarioData::Columns& numbers) {
  for (Eigen::Index c = 0; c < numbers.cols(); ++c)
    for (const float x : numbers.col(c))
      if (!(std::abs(x) <= 1e6f)) refuse(text(path.string(), ": scenario ", c), "numbers up to 1e6", x);
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
  detail::make_dataset(
      {path, detail::scenario_kind}, detail::dataset_setting(sampler, count, horizons, options),
      detail::Json::object(), {count, detail::scenario_piece, detail::scenario_piece},
      [&](detail::DatasetArrays& arrays) { detail::add_arrays(arrays, horizons); },
      [&](detail::DatasetArrays& arrays, Eigen::Index first, Eigen::Index size) {
        detail::append_scenarios(
            arrays, generate(sampler, static_cast<std::uint64_t>(first), size, horizons, options));
      },
      progress);
}

/// Whether the folder holds a data set of which all scenarios are done. Error where it holds a broken one.
inline bool dataset_is_done(const std::filesystem::path& path) {
  const detail::DatasetFolder folder(path, detail::scenario_kind);
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
  const detail::DatasetFolder folder(path, detail::scenario_kind);
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
    const auto at = std::find(held.begin(), held.end(), detail::Json(horizon)) - held.begin();
    if (at == std::ssize(held))
      detail::refuse(folder.text() + ": horizons", detail::text("one of ", held), horizon);
    data.impacts.row(h) = impacts.row(at);
    data.states.push_back(read_numbers(detail::state_file(horizon), 13));
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
