#pragma once

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include <rbres/body/check_state.hpp>
#include <rbres/io/dataset_folder.hpp>
#include <rbres/io/utf8.hpp>
#include <rbres/io/world_setting.hpp>
#include <rbres/sim/transitions.hpp>

/// @file
/// Data sets of the user's own world on disk: a folder that anyone's NumPy reads. Arrays count transitions
/// first, in C order; bodies and their numbers stand as in SystemState and Wrench:
///
///     start.npy      float64 (n, bodies, 13)   states at the start
///     wrench.npy     float64 (n, bodies, 6)    force and torque on each body
///     end.npy        float64 (n, bodies, 13)   states one horizon later
///     collided.npy   uint8   (n,)              1: an impact came before the end
///     dataset.json   the world, how it was simulated, what wrote it, how many transitions are "done", and
///                    the SHA-256 of each array's file; its own is that of its text with zeros in its place
namespace rbres::RBRES_ABI {

/// How write_transitions makes a data set.
struct TransitionSetOptions {
  /// What draws the starts, in words, with its version: a folder that says otherwise is refused.
  std::string starts{};
  std::uint64_t seed = 0;       ///< of the starts; a folder that says otherwise is refused
  std::ptrdiff_t piece = 4096;  ///< transitions made at a time, and lost when it is stopped; changes no bit
  int threads = 0;              ///< 0: default_threads(); changes no bit
};

namespace detail {

inline constexpr DatasetKind transition_kind{"transitions", 1};

/// Transitions as columns, one for each.
template <int N>
struct TransitionColumns {
  using Columns = DatasetArray<double>::Columns;

  Columns start, wrench, end;
  DatasetArray<std::uint8_t>::Columns collided;

  explicit TransitionColumns(const Transitions<N>& all)
      : start(13 * N, all.count()),
        wrench(6 * N, all.count()),
        end(13 * N, all.count()),
        collided(1, all.count()) {
    for (Eigen::Index c = 0; c < all.count(); ++c) {
      std::copy_n(&all.start(c)[0].position.x, 13 * N, start.col(c).data());
      std::copy_n(&all.wrench(c)[0].force.x, 6 * N, wrench.col(c).data());
      std::copy_n(&all.end(c)[0].position.x, 13 * N, end.col(c).data());
      collided(c) = all.had_impact(c);
    }
  }

  /// The digest of all numbers.
  std::string digest() const {
    Sha256 hash;
    for (const Columns* columns : {&start, &wrench, &end})
      hash.add(columns->data(), static_cast<std::size_t>(columns->size()) * sizeof(double));
    return hash.text();
  }
};

template <int N>
void add_arrays(DatasetArrays& arrays) {
  arrays.add<double>("start.npy", {N, 13});
  arrays.add<double>("wrench.npy", {N, 6});
  arrays.add<double>("end.npy", {N, 13});
  arrays.add<std::uint8_t>("collided.npy", {});
}

/// The finite number of a description under a key.
inline double positive_at(const DatasetFolder& folder, const Json& description, const char* key) {
  const double number = number_at(description, key, folder.description().string());
  if (!(number > 0 && number <= 1e30)) refuse(folder.text() + ": " + key, "a positive number", number);
  return number;
}

}  // namespace detail

/// Makes the transitions of simulate_transitions from start(0) ... start(count - 1) into a folder, piece by
/// piece, with its errors. The bytes are the same for any size of the pieces and any number of threads. It
/// may be stopped at any moment: called again it goes on where it was, and does nothing when all is done.
/// progress(done), if given, is called at the start and after each piece. Error too where the folder holds a
/// data set of another world or other options, one of which the same start, forces and integrator do not give
/// the first transitions, one half made by a program that was compiled otherwise or changed since, or other
/// files: nothing is then overwritten.
template <int N, class Shape, class Model, class Integrator, class MakeStart>
void write_transitions(const std::filesystem::path& path, const System<double, N, Shape>& system,
                       const Model& forces, const Integrator& integrator, std::ptrdiff_t count,
                       const MakeStart& start, const SimulationOptions& options,
                       const TransitionSetOptions& set = {},
                       const std::function<void(std::ptrdiff_t)>& progress = {}) {
  constexpr std::ptrdiff_t lanes = detail::double_lanes;
  options.check();
  if (!(options.duration > 0)) detail::refuse("duration of transitions", "more than 0 s", options.duration);
  if (!detail::is_utf8(set.starts)) detail::refuse("what draws the starts", "UTF-8", "something else");
  if (count < 1) detail::refuse("number of transitions", "1 or more", count);
  if (set.piece < 1) detail::refuse("transitions of a piece", "1 or more", set.piece);
  const auto make = [&](std::ptrdiff_t first, std::ptrdiff_t size) {
    return detail::naming([&] { return detail::text("transitions from ", first, " on: "); },
                          [&] {
                            return detail::TransitionColumns<N>(simulate_transitions(
                                system, forces, integrator, size,
                                [&](std::ptrdiff_t i) { return start(first + i); }, options, set.threads));
                          });
  };
  detail::Json setting{{"kind", detail::transition_kind.name},
                       {"format", detail::transition_kind.format},
                       {"starts", set.starts},
                       {"seed", set.seed},
                       {"step", options.step},
                       {"horizon", options.duration},
                       {"contacts", options.contacts == ContactMode::continuous ? "continuous" : "discrete"},
                       {"rest_speed", options.rest_speed},
                       {"max_events", options.max_events},
                       {"transitions", count}};
  setting.update(detail::world_setting(system, forces));
  detail::check_numbers(setting);
  // Functions do not say what they compute: the first transitions stand for them.
  const detail::Json probe =
      detail::Json::object({{"first_transitions", make(0, std::min(lanes, count)).digest()}});
  // Scenarios that share lanes may decide each other's last bits: pieces end where lanes do.
  const std::ptrdiff_t piece = (std::min(set.piece, count) + lanes - 1) / lanes * lanes;
  detail::make_dataset(
      {path, detail::transition_kind}, setting, probe, {count, piece, lanes}, detail::add_arrays<N>,
      [&](detail::DatasetArrays& arrays, Eigen::Index first, Eigen::Index size) {
        const auto columns = make(first, size);
        arrays.append("start.npy", columns.start);
        arrays.append("wrench.npy", columns.wrench);
        arrays.append("end.npy", columns.end);
        arrays.append("collided.npy", columns.collided);
      },
      [&](Eigen::Index done) {
        if (progress) progress(done);
      });
}

/// Reads a data set of transitions of this world: the same bits as simulate_transitions gives. Error where
/// the folder is not there or not done, is of another world (bodies, planes or forces; of force models that
/// are not the library's it is known only that there are some), or a file of it is malformed or changed.
template <int N, class Shape, class Model>
Transitions<N> read_transitions(const std::filesystem::path& path, const System<double, N, Shape>& system,
                                const Model& forces) {
  const detail::DatasetFolder folder(path, detail::transition_kind);
  const detail::Json found = folder.read_description(), world = detail::world_setting(system, forces);
  for (const auto& entry : world.items()) folder.require(found, world, entry.key());
  const auto count = found.value("transitions", detail::Json());
  if (!count.is_number_unsigned() || count != found["done"])
    detail::refuse(folder.text(), detail::text("all of its ", count, " transitions done"), found["done"]);
  const auto n = count.get<Eigen::Index>();
  if (n < 1) detail::refuse(folder.text() + ": transitions", "1 or more", n);
  Transitions<N> all{detail::positive_at(folder, found, "horizon"), {}, {}, {}};
  const auto read = [&]<class Scalar>(const char* name, std::vector<Eigen::Index> shape, Scalar) {
    return detail::read_samples<Scalar>(folder, name, std::move(shape), n, found);
  };
  const auto starts = read("start.npy", {n, N, 13}, 0.0), wrenches = read("wrench.npy", {n, N, 6}, 0.0),
             ends = read("end.npy", {n, N, 13}, 0.0);
  const auto collided = read("collided.npy", {n}, std::uint8_t{});
  const auto number = static_cast<std::size_t>(n);
  all.starts.resize(number), all.ends.resize(number), all.collided.resize(number);
  for (std::size_t i = 0; i < number; ++i) {
    const auto c = static_cast<Eigen::Index>(i);
    std::copy_n(starts.col(c).data(), 13 * N, &all.starts[i].state[0].position.x);
    std::copy_n(wrenches.col(c).data(), 6 * N, &all.starts[i].wrench[0].force.x);
    std::copy_n(ends.col(c).data(), 13 * N, &all.ends[i][0].position.x);
    all.collided[i] = collided(c) != 0;
    detail::naming([&] { return detail::text(folder.text(), ": transition ", i, ": "); },
                   [&] {
                     for (int b = 0; b < N; ++b) {
                       detail::check_rigid_state(all.starts[i].state[b]);
                       detail::check_rigid_state(all.ends[i][b]);
                     }
                     if (!wrenches.col(c).allFinite()) detail::refuse("wrench", "finite numbers", "others");
                     if (collided(c) > 1) detail::refuse("collided", "0 or 1", int{collided(c)});
                   });
  }
  return all;
}

}  // namespace rbres::RBRES_ABI
