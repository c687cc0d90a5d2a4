/// MuJoCo (Debian: libmujoco-dev) with its defaults for solver and cone; double precision.
#include <mujoco/mujoco.h>

#include <cstring>
#include <memory>
#include <sstream>
#include <stdexcept>

#include "physics_rows.hpp"

namespace rbres::bench {
namespace {

// MuJoCo has no restitution number: a contact is a spring and damper, given as solref = -stiffness -damping
// (per unit of effective mass). A bounce on it returns e of the approach speed where damping = 2 zeta omega
// and zeta = -ln e / sqrt(pi^2 + ln^2 e); omega is chosen so that a bounce lasts about 30 ms, three steps of
// 10 ms.
std::string bouncy_solref() {
  constexpr double omega = 100.0;
  const double log_e = std::log(restitution);
  const double zeta = -log_e / std::hypot(std::numbers::pi, log_e);
  std::ostringstream out;
  out << -omega * omega << ' ' << -2.0 * zeta * omega;
  return out.str();
}

std::string scene_xml(const Scene& scene, double step, const char* integrator) {
  std::ostringstream xml;
  xml << "<mujoco><option timestep='" << step << "' integrator='" << integrator << "' gravity='0 0 "
      << -gravity << "'/><default><geom condim='3' friction='" << friction << " 0 0' solref='"
      << bouncy_solref() << "'/></default><worldbody><geom type='plane' size='0 0 1'/>";
  for (const Item& item : scene.items) {
    xml << "<body><freejoint/><geom mass='" << item.mass << "' ";
    const auto [a, b, c] = item.size;
    if (item.shape == Shape::sphere)
      xml << "type='sphere' size='" << a << "'/>";
    else
      xml << "type='box' size='" << a << ' ' << b << ' ' << c << "'/>";
    xml << "</body>";
  }
  xml << "</worldbody></mujoco>";
  return xml.str();
}

mjModel* load(const std::string& xml) {
  const auto files = std::make_unique<mjVFS>();
  mj_defaultVFS(files.get());
  mj_makeEmptyFileVFS(files.get(), "scene.xml", static_cast<int>(xml.size()));
  std::memcpy(files->filedata[0], xml.data(), xml.size());
  char error[1000] = "";
  mjModel* model = mj_loadXML("scene.xml", files.get(), error, sizeof error);
  mj_deleteVFS(files.get());
  if (model == nullptr) throw std::runtime_error(error);
  return model;
}

class Mujoco {
 public:
  Mujoco(const Scene& scene, double step, const char* integrator)
      : shape_(scene.items.front().shape),
        bodies_(scene.items.size()),
        model_(load(scene_xml(scene, step, integrator))) {
    for (std::size_t i = 0; i < bodies_; ++i) {
      const Start& start = scene.items[i].start;
      const auto [x, y, z, w] = start.orientation;
      const std::array scalar_first{w, x, y, z};
      mjtNum* pose = data_->qpos + 7 * i;
      mjtNum* twist = data_->qvel + 6 * i;
      std::copy_n(start.position.data(), 3, pose);
      std::copy_n(scalar_first.data(), 4, pose + 3);
      std::copy_n(start.velocity.data(), 3, twist);  // world frame
      std::copy_n(start.spin.data(), 3, twist + 3);  // body frame
    }
  }
  Mujoco(const Mujoco&) = delete;
  Mujoco& operator=(const Mujoco&) = delete;
  ~Mujoco() {
    mj_deleteData(data_);
    mj_deleteModel(model_);
  }

  void step() {
    for (std::size_t i = 0; i < bodies_; ++i) {
      const mjtNum* v = data_->qvel + 6 * i;
      mjtNum to_body[4], in_body[3];
      mju_negQuat(to_body, data_->qpos + 7 * i + 3);
      mju_rotVecQuat(in_body, v, to_body);
      const Vec3 force = drag(shape_, {v[0], v[1], v[2]}, {in_body[0], in_body[1], in_body[2]});
      std::copy_n(force.data(), 3, data_->xfrc_applied + 6 * (i + 1));  // body 0 is the world
    }
    mj_step(model_, data_);
    for (int i = 0; i < data_->ncon; ++i) contacts_ += data_->contact[i].dist <= 0;
  }

  double contacts() const { return contacts_; }

  double mean_height() const {
    double sum = 0.0;
    for (std::size_t i = 0; i < bodies_; ++i) sum += data_->qpos[7 * i + 2];
    return sum / static_cast<double>(bodies_);
  }

 private:
  Shape shape_;
  std::size_t bodies_;
  mjModel* model_;
  mjData* data_ = mj_makeData(model_);
  double contacts_ = 0;
};

const bool registered_rk4 = register_peer<Mujoco>("mujoco_rk4", "RK4");
const bool registered_euler = register_peer<Mujoco>("mujoco_euler", "Euler");

}  // namespace
}  // namespace rbres::bench
