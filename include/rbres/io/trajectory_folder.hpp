#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include <Eigen/Core>

#include <rbres/io/npy.hpp>
#include <rbres/learn/trajectory.hpp>

namespace rbres::RBRES_ABI::detail {

inline std::string array_shape_text(const std::vector<Eigen::Index>& shape) {
  std::string all;
  for (const Eigen::Index extent : shape)
    all += (all.empty() ? "(" : ", ") + (extent < 0 ? std::string("any") : text(extent));
  return all + ")";
}

/// Error where an array's shape is another; an expected extent of -1 fits any but 0.
inline void require_shape(const std::filesystem::path& path, const std::vector<Eigen::Index>& found,
                          const std::vector<Eigen::Index>& expected) {
  bool fits = found.size() == expected.size();
  for (std::size_t i = 0; fits && i < found.size(); ++i)
    fits = expected[i] < 0 ? found[i] > 0 : found[i] == expected[i];
  if (!fits) refuse(path.string(), "shape " + array_shape_text(expected), array_shape_text(found));
}

/// An array of float or double that is read as double, scene by scene.
class TrajectoryArray {
 public:
  TrajectoryArray(const std::filesystem::path& path, const std::vector<Eigen::Index>& expected)
      : file_(open(path)) {
    require_shape(path, shape(), expected);
  }

  const std::vector<Eigen::Index>& shape() const {
    return std::visit(
        [](const auto& file) -> const auto& { return file.shape(); }, file_);
  }
  /// The numbers of a scene, in C order.
  Eigen::VectorXd scene(Eigen::Index i) const {
    const auto read = [&](const auto& file) -> Eigen::VectorXd {
      return file.read(i, 1).template cast<double>();
    };
    return std::visit(read, file_);
  }

 private:
  using File = std::variant<NpyReader<float>, NpyReader<double>>;

  static File open(const std::filesystem::path& path) {
    const std::string descr = read_npy_header(InputFile(path)).descr;
    if (descr == npy_descr<float>()) return NpyReader<float>(path);
    if (descr == npy_descr<double>()) return NpyReader<double>(path);
    refuse(path.string(), "dtype <f4 or <f8", descr);
  }

  File file_;
};

/// A folder of trajectories that is open for reading.
class TrajectoryFolder {
 public:
  explicit TrajectoryFolder(const std::filesystem::path& path)
      : path_(path),
        states_(path / "states.npy", {-1, -1, -1, 13}),
        kind_(open_integers("kind.npy", {scenes(), bodies()})),
        size_(path / "size.npy", {scenes(), bodies(), 3}),
        mass_(path / "mass.npy", {scenes(), bodies()}) {
    if (has("inertia.npy")) inertia_.emplace(path / "inertia.npy", Shape{scenes(), bodies(), 3});
    if (has("material.npy")) material_.emplace(path / "material.npy", Shape{scenes(), bodies(), 2});
    if (has("wrench.npy")) wrench_.emplace(path / "wrench.npy", Shape{scenes(), bodies(), 6});
    if (has("length.npy")) length_ = open_integers("length.npy", {scenes()});
  }

  Eigen::Index scenes() const { return states_.shape()[0]; }

  Trajectory scene(Eigen::Index s) const {
    const Eigen::Index most = states_.shape()[1];
    const Eigen::Index frames = length_ ? length_->read(s, 1)(0) : most;
    if (frames < 2 || frames > most) refuse("length", text("2 to ", most, " frames"), frames);
    const Eigen::VectorXd numbers = states_.scene(s);
    std::vector<RigidState<double>> states(static_cast<std::size_t>(frames * bodies()));
    for (std::size_t k = 0; k < states.size(); ++k)
      states[k].vector() = numbers.segment<13>(13 * static_cast<Eigen::Index>(k));
    return {read_bodies(s), std::move(states), read_wrenches(s)};
  }

 private:
  using Shape = std::vector<Eigen::Index>;
  using Integers = NpyReader<std::int64_t>;

  bool has(const char* name) const { return file_exists(path_ / name); }
  Integers open_integers(const char* name, const Shape& expected) const {
    Integers file(path_ / name);
    require_shape(path_ / name, file.shape(), expected);
    return file;
  }
  Eigen::Index bodies() const { return states_.shape()[2]; }

  std::vector<Body<double>> read_bodies(Eigen::Index s) const {
    const auto kinds = kind_.read(s, 1);
    const Eigen::VectorXd sizes = size_.scene(s), masses = mass_.scene(s);
    const Eigen::VectorXd moments = inertia_ ? inertia_->scene(s) : Eigen::VectorXd();
    const Eigen::VectorXd materials = material_ ? material_->scene(s) : Eigen::VectorXd();
    std::vector<Body<double>> all;
    const auto read = [&](Eigen::Index i) -> Body<double> {
      const AnyShape<double> shape = shape_of(kinds(i), sizes.segment<3>(3 * i));
      Material<double> material;
      if (material_) material = {materials(2 * i), materials(2 * i + 1)};
      if (!inertia_) return {shape, masses(i), material};
      return {shape, masses(i), Vec3<double>(moments.segment<3>(3 * i)), material};
    };
    for (Eigen::Index i = 0; i < bodies(); ++i)
      all.push_back(naming([&] { return text("body ", i, ": "); }, [&] { return read(i); }));
    return all;
  }
  std::vector<Wrench<double>> read_wrenches(Eigen::Index s) const {
    if (!wrench_) return {};
    const Eigen::VectorXd numbers = wrench_->scene(s);
    std::vector<Wrench<double>> all;
    for (Eigen::Index i = 0; i < bodies(); ++i)
      all.push_back({Vec3<double>(numbers.segment<3>(6 * i)), Vec3<double>(numbers.segment<3>(6 * i + 3))});
    return all;
  }
  static AnyShape<double> shape_of(std::int64_t kind, const Eigen::Vector3d& size) {
    if (kind == 0) return Sphere<double>(size(0));
    if (kind == 1) return Box<double>(size(0), size(1), size(2));
    if (kind == 2) return Capsule<double>(size(0), size(1));
    refuse("kind", "0 (sphere), 1 (box) or 2 (capsule)", kind);
  }

  std::filesystem::path path_;
  TrajectoryArray states_;
  Integers kind_;
  TrajectoryArray size_, mass_;
  std::optional<TrajectoryArray> inertia_, material_, wrench_;
  std::optional<Integers> length_;
};

}  // namespace rbres::RBRES_ABI::detail
