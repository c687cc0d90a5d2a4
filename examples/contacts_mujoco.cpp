// Makes trajectory sets by MuJoCo, whose contacts are soft: balls, or boxes and balls, thrown into a tray.
#include <mujoco/mujoco.h>

#include <memory>
#include <rbres/core/philox.hpp>
#include <rbres/io/trajectories.hpp>

#include "common/command_line.hpp"

namespace {

using namespace rbres;

struct Options {
  std::string folder;
  bool boxes = false;
  int bodies = 6, train = 900, test = 100, frames = 150;
  std::uint64_t seed = 7;
};

constexpr double frame_time = 0.01, step = 0.0005;  // s
constexpr int steps_per_frame = 20;

double within(Random& random, double least, double most) { return least + (most - least) * random.uniform(); }

/// Half the tray's width, m: as much room for each body, however many there are.
double half_width(int bodies) { return 0.5 * std::sqrt(bodies / 6.0); }

std::vector<Plane<double>> tray(double w) {
  return {{{0, 0, 1}, 0, {}},
          {{1, 0, 0}, -w, {}},
          {{-1, 0, 0}, -w, {}},
          {{0, 1, 0}, -w, {}},
          {{0, -1, 0}, -w, {}}};
}

/// Bodies and where they start: apart from one another and from the tray.
struct Start {
  std::vector<Body<double>> bodies;
  std::vector<RigidState<double>> states;
};

Start thrown(const Options& options, Random& random) {
  Start start;
  const double w = half_width(options.bodies);
  for (int i = 0; i < options.bodies; ++i) {
    const bool box = options.boxes && random.uniform() < 0.5;
    const AnyShape<double> shape =
        box ? AnyShape<double>(Box<double>(within(random, 0.04, 0.08), within(random, 0.04, 0.08),
                                           within(random, 0.04, 0.08)))
            : AnyShape<double>(Sphere<double>(within(random, 0.05, 0.1)));
    const auto body = Body<double>::of_density(shape, 1000 * within(random, 0.15, 0.25));
    const double room = w - std::max(0.12, body.bounding_radius() + 0.01);
    RigidState<double> y;
    bool apart = false;
    for (int tries = 0; !apart; ++tries) {
      if (tries == 100'000)
        detail::refuse("bodies", "fewer, so that they fit above the tray", options.bodies);
      y.position = {within(random, -room, room), within(random, -room, room),
                    within(random, std::max(0.12, body.bounding_radius() + 0.01), 0.9)};
      apart = true;
      for (int j = 0; j < i && apart; ++j) {
        const auto k = static_cast<std::size_t>(j);
        apart = norm(y.position - start.states[k].position) >
                body.bounding_radius() + start.bodies[k].bounding_radius() + 0.01;
      }
    }
    if (box) {
      y.orientation =
          normalized(Quat<double>{random.normal(), random.normal(), random.normal(), random.normal()});
    }
    for (double* v : {&y.velocity.x, &y.velocity.y, &y.velocity.z}) *v = within(random, -1.5, 1.5);
    for (double* v : {&y.angular_velocity.x, &y.angular_velocity.y, &y.angular_velocity.z})
      *v = within(random, -8, 8);
    start.bodies.push_back(body);
    start.states.push_back(y);
  }
  return start;
}

/// The scene in MuJoCo's words. Its contacts are springs and dampers that take 30 ms, with friction 0.4.
std::string scene_xml(const Start& start, double w) {
  using detail::exact;
  std::string xml =
      "<mujoco><option timestep=\"" + exact(step) +
      "\" cone=\"elliptic\"/><default><geom solref=\"-10000 -30\" friction=\"0.4 0.005 0.0001\" "
      "condim=\"4\"/></default><worldbody><geom type=\"plane\" size=\"5 5 1\"/>";
  const std::string d = exact(w);
  xml += "<geom type=\"plane\" size=\"5 5 1\" pos=\"-" + d + " 0 0\" xyaxes=\"0 1 0 0 0 1\"/>";
  xml += "<geom type=\"plane\" size=\"5 5 1\" pos=\"" + d + " 0 0\" xyaxes=\"0 -1 0 0 0 1\"/>";
  xml += "<geom type=\"plane\" size=\"5 5 1\" pos=\"0 -" + d + " 0\" xyaxes=\"-1 0 0 0 0 1\"/>";
  xml += "<geom type=\"plane\" size=\"5 5 1\" pos=\"0 " + d + " 0\" xyaxes=\"1 0 0 0 0 1\"/>";
  for (std::size_t i = 0; i < start.bodies.size(); ++i) {
    const AnyShape<double>& shape = start.bodies[i].shape();
    const Vec3<double>& p = start.states[i].position;
    xml += "<body pos=\"" + exact(p.x) + " " + exact(p.y) + " " + exact(p.z) +
           "\"><freejoint/><geom mass=\"" + exact(start.bodies[i].mass()) + "\" type=\"";
    if (const auto* sphere = std::get_if<Sphere<double>>(&shape)) {
      xml += "sphere\" size=\"" + exact(sphere->radius);
    } else {
      const Vec3<double>& half = std::get<Box<double>>(shape).half;
      xml += "box\" size=\"" + exact(half.x) + " " + exact(half.y) + " " + exact(half.z);
    }
    xml += "\"/></body>";
  }
  return xml + "</worldbody></mujoco>";
}

/// MuJoCo reads models from files, or from such a virtual one.
struct Model {
  struct Deleter {
    void operator()(mjModel* m) const { mj_deleteModel(m); }
    void operator()(mjData* d) const { mj_deleteData(d); }
  };
  std::unique_ptr<mjModel, Deleter> model;
  std::unique_ptr<mjData, Deleter> data;

  explicit Model(const std::string& xml) {
    const auto files = std::make_unique<mjVFS>();
    mj_defaultVFS(files.get());
    if (mj_makeEmptyFileVFS(files.get(), "scene.xml", static_cast<int>(xml.size())) != 0)
      throw Error("MuJoCo: a scene that it has no room for");
    std::copy(xml.begin(), xml.end(), static_cast<char*>(files->filedata[files->nfile - 1]));
    char problem[500] = "";
    model.reset(mj_loadXML("scene.xml", files.get(), problem, sizeof problem));
    mj_deleteVFS(files.get());
    if (!model) throw Error(detail::text("MuJoCo: ", problem));
    data.reset(mj_makeData(model.get()));
  }
};

Trajectory simulated(const Options& options, std::uint64_t number) {
  Random random(options.seed, number);
  const Start start = thrown(options, random);
  const Model mujoco(scene_xml(start, half_width(options.bodies)));
  mjData* d = mujoco.data.get();
  for (int i = 0; i < options.bodies; ++i) {
    const RigidState<double>& y = start.states[static_cast<std::size_t>(i)];
    const Quat<double>& q = y.orientation;
    const double pose[] = {q.w, q.x, q.y, q.z};  // MuJoCo's order
    std::copy(pose, pose + 4, d->qpos + 7 * i + 3);
    const Vec3<double>&v = y.velocity, &spin = y.angular_velocity;
    const double motion[] = {v.x, v.y, v.z, spin.x, spin.y, spin.z};
    std::copy(motion, motion + 6, d->qvel + 6 * i);
  }
  std::vector<RigidState<double>> states;
  for (int t = 0; t <= options.frames; ++t) {
    for (int i = 0; i < options.bodies; ++i) {
      const double *p = d->qpos + 7 * i, *v = d->qvel + 6 * i;
      states.push_back(
          {{p[0], p[1], p[2]}, {p[4], p[5], p[6], p[3]}, {v[0], v[1], v[2]}, {v[3], v[4], v[5]}});
    }
    for (int k = 0; k < steps_per_frame; ++k) mj_step(mujoco.model.get(), d);
  }
  return {start.bodies, states};
}

void run(const Options& options) {
  const auto write = [&](const char* name, int first, int count) {
    std::vector<Trajectory> scenes;
    for (int s = 0; s < count; ++s) {
      scenes.push_back(simulated(options, static_cast<std::uint64_t>(first + s)));
      if ((s + 1) % 100 == 0) std::fprintf(stderr, "%s: %d of %d scenes\n", name, s + 1, count);
    }
    write_trajectories(std::filesystem::path(options.folder) / name,
                       {frame_time, {0, 0, -9.81}, tray(half_width(options.bodies)), std::move(scenes)});
  };
  write("train", 0, options.train);
  write("test", options.train, options.test);
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  CLI::App app{
      "Writes FOLDER/train and FOLDER/test: bodies thrown into a tray, by MuJoCo with soft contacts."};
  app.add_option("FOLDER", options.folder, "where the sets go")->required();
  app.add_flag("--boxes", options.boxes, "boxes and balls instead of balls alone");
  app.add_option("--bodies", options.bodies, "in a scene")->check(CLI::Range(1, 1000))->capture_default_str();
  app.add_option("--train", options.train, "scenes to train on")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option("--test", options.test, "scenes to test on")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option("--frames", options.frames, "of 10 ms after the first")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option("--seed", options.seed)->capture_default_str();
  return run_program("rbres_contacts_mujoco", app, argc, argv, [&] { run(options); });
}
