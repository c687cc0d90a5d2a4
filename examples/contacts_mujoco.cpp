// Makes trajectory sets by MuJoCo, whose contacts are soft, or by rbres with a law of its own: balls, or
// boxes and balls, thrown into a tray.
#include <mujoco/mujoco.h>

#include <chrono>
#include <memory>
#include <rbres/io/trajectories.hpp>
#include <rbres/learn/scene_system.hpp>

#include "common/command_line.hpp"
#include "contacts/fading_contacts.hpp"
#include "contacts/throws.hpp"

namespace {

using namespace rbres;
using namespace rbres::contacts_program;

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

/// Calls frame() for the states of the start and after each frame.
template <class Frame, class Go>
std::vector<RigidState<double>> recorded(int frames, const Frame& frame, const Go& go) {
  std::vector<RigidState<double>> states;
  for (int t = 0; t <= frames; ++t) {
    if (t > 0) go();
    frame(states);
  }
  return states;
}

/// `seconds` grows by the time that MuJoCo's steps take.
Trajectory by_mujoco(const ThrowOptions& options, const Start& start, double& seconds) {
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
  const auto frame = [&](std::vector<RigidState<double>>& states) {
    for (int i = 0; i < options.bodies; ++i) {
      const double *p = d->qpos + 7 * i, *v = d->qvel + 6 * i;
      states.push_back(
          {{p[0], p[1], p[2]}, {p[4], p[5], p[6], p[3]}, {v[0], v[1], v[2]}, {v[3], v[4], v[5]}});
    }
  };
  const auto go = [&] {
    const auto begin = std::chrono::steady_clock::now();
    for (int k = 0; k < steps_per_frame; ++k) mj_step(mujoco.model.get(), d);
    seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  };
  return {start.bodies, recorded(options.frames, frame, go)};
}

Trajectory by_rbres(const ThrowOptions& options, const Start& start, double& seconds) {
  const SceneSystem system(start.bodies, tray(half_width(options.bodies)));
  SceneState y{start.states};
  // Slower impacts rest: gravity alone gives 5 mm/s in a step.
  const FadingContacts law;
  FadingContacts::Step<SceneSystem> step(law, system, {.step = contacts_program::step, .rest_speed = 0.05});
  ContactTally<double> tally;
  int none = 0;
  const auto frame = [&](std::vector<RigidState<double>>& states) {
    states.insert(states.end(), y.body.begin(), y.body.end());
  };
  const auto go = [&] {
    const auto begin = std::chrono::steady_clock::now();
    for (int k = 0; k < steps_per_frame; ++k)
      step.step(Gravity<double>{}, Rk4{}, y, 0.0, contacts_program::step, none, tally);
    seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  };
  return {start.bodies, recorded(options.frames, frame, go)};
}

void run(const ThrowOptions& options) {
  const std::filesystem::path folder = options.folder;
  // What cannot be written is found out before the scenes are simulated.
  for (const char* name : {"train", "test"}) detail::make_empty_folder(folder / name);
  double seconds = 0;
  const auto write = [&](const char* name, int first, int count) {
    std::vector<Trajectory> scenes;
    for (int s = 0; s < count; ++s) {
      Random random(options.seed, static_cast<std::uint64_t>(first + s));
      const Start start = thrown(options, random);
      scenes.push_back((options.rbres ? by_rbres : by_mujoco)(options, start, seconds));
      if ((s + 1) % 100 == 0) std::fprintf(stderr, "%s: %d of %d scenes\n", name, s + 1, count);
    }
    write_trajectories(folder / name,
                       {frame_time, {0, 0, -9.81}, tray(half_width(options.bodies)), std::move(scenes)});
  };
  write("train", 0, options.train);
  write("test", options.train, options.test);
  std::fprintf(stderr, "%s: %.2f us a frame of %d steps, one scene, one thread\n",
               options.rbres ? "rbres" : "MuJoCo",
               1e6 * seconds / (1.0 * (options.train + options.test) * options.frames), steps_per_frame);
}

}  // namespace

int main(int argc, char** argv) {
  ThrowOptions options;
  CLI::App app{
      "Writes FOLDER/train and FOLDER/test: bodies thrown into a tray, by MuJoCo with soft contacts or by "
      "rbres with contacts whose restitution and friction fall with speed. Says how long a frame takes."};
  app.add_option("FOLDER", options.folder, "where the sets go")->required();
  flag(app, "--boxes", options.boxes, "boxes and balls instead of balls alone");
  flag(app, "--rbres", options.rbres, "by rbres instead of MuJoCo");
  number(app, "--bodies", options.bodies, 1, 1000, "in a scene");
  number(app, "--train", options.train, 1, 1'000'000, "scenes to train on");
  number(app, "--test", options.test, 1, 1'000'000, "scenes to test on");
  number(app, "--frames", options.frames, 1, 1'000'000, "of 10 ms after the first");
  seed_number(app, "--seed", options.seed, "of how they are thrown");
  return run_program("rbres_contacts_mujoco", app, argc, argv, [&] { run(options); });
}
