/// The rows of rbres: the same scenes in double and in float lanes, how the cost grows with the number of
/// bodies.
#include <chrono>
#include <ctime>
#include <rbres/paper/paper.hpp>
#include <rbres/rbres.hpp>

#include "physics_rows.hpp"

namespace rbres::bench {
namespace {

/// `lanes` scenes of N bodies of one shape at once. The way contacts are found is that of the peers, at the
/// end of a step, unless told otherwise.
template <class S, template <class> class ShapeOf, int N = body_count>
class Rbres {
  using Body = rbres::Body<double, ShapeOf<double>>;
  using System = rbres::System<S, N, ShapeOf<S>>;
  using Air = Forces<Gravity<double>, FluidFriction<double>>;
  using Real = typename ScalarTraits<S>::Value;

 public:
  static constexpr int lanes = ScalarTraits<S>::lanes;

  Rbres(int first_scene, double step, ContactMode mode)
      : step_(as<S>(step)),
        stepper_(system_, forces(), Rk4{}, {.step = step, .duration = duration, .contacts = mode}),
        mode_(mode) {
    for (int i = 0; i < lanes; ++i) {
      const std::vector<Start> starts = scene(first_scene + i, N);
      SystemState<Real, N> start;
      for (int k = 0; k < N; ++k) {
        const auto& [p, q, v, w] = starts[static_cast<std::size_t>(k)];
        start[k] = {{Real(p[0]), Real(p[1]), Real(p[2])},
                    {Real(q[0]), Real(q[1]), Real(q[2]), Real(q[3])},
                    {Real(v[0]), Real(v[1]), Real(v[2])},
                    {Real(w[0]), Real(w[1]), Real(w[2])}};
      }
      set_lane(state_, i, start);
    }
  }
  Rbres(const Rbres&) = delete;
  Rbres& operator=(const Rbres&) = delete;

  void step() { stepper_.step(state_, S(0), step_); }

  /// In continuous mode, where nothing ever overlaps, the impacts.
  double contacts() const {
    const auto& tally = stepper_.tally();
    const auto& count = mode_ == ContactMode::continuous ? tally.impacts : tally.touching;
    if constexpr (lanes == 1) {
      return static_cast<double>(count);
    } else {
      double total = 0;
      for (int i = 0; i < lanes; ++i) total += static_cast<double>(count[i]);
      return total;
    }
  }

  double mean_height() const {
    double heights = 0.0;
    for (int i = 0; i < N; ++i) heights += sum(state_[i].position.z);
    return heights / (lanes * N);
  }

 private:
  static constexpr Shape shape = std::is_same_v<ShapeOf<double>, Sphere<double>> ? Shape::sphere : Shape::box;
  static ShapeOf<double> geometry() {
    if constexpr (shape == Shape::sphere)
      return {radius};
    else
      return {half_extents[0], half_extents[1], half_extents[2]};
  }
  static Air forces() {
    return {Gravity<double>{{0.0, 0.0, -gravity}},
            FluidFriction<double>{air_density, drag_coefficient(shape), 0.0}};  // no friction on the spin
  }
  static System make_system() {
    const Material<double> material{restitution, friction};
    return rbres::System<double, N, ShapeOf<double>>::of(Body(geometry(), mass, material),
                                                         {floor_plane(material)})
        .template cast<S>();
  }
  static double sum(const S& x) {
    double total = 0.0;
    for (int i = 0; i < lanes; ++i) total += ScalarTraits<S>::lane(x, i);
    return total;
  }

  S step_;
  System system_ = make_system();
  SystemState<S, N> state_;
  Stepper<System, Air, Rk4> stepper_;
  ContactMode mode_;
};

/// A scene of many bodies, continuous.
template <class Geometry>
class RbresCrowd {
  using System = rbres::System<double, dynamic, Geometry>;
  using State = typename System::State;

 public:
  RbresCrowd(const Scene& scene, double step)
      : step_(step),
        system_(make_system(scene)),
        stepper_(system_, Gravity<double>{{0.0, 0.0, -scene.gravity}}, Rk4{}, {.step = step}) {
    for (const Item& item : scene.items) {
      const auto& [p, q, v, w] = item.start;
      state_.body.push_back(
          {{p[0], p[1], p[2]}, {q[0], q[1], q[2], q[3]}, {v[0], v[1], v[2]}, {w[0], w[1], w[2]}});
    }
  }
  RbresCrowd(const RbresCrowd&) = delete;
  RbresCrowd& operator=(const RbresCrowd&) = delete;

  void step() { stepper_.step(state_, 0.0, step_); }
  double contacts() const { return static_cast<double>(stepper_.tally().impacts); }
  double mean_height() const {
    double sum = 0.0;
    for (const auto& body : state_.body) sum += body.position.z;
    return sum / static_cast<double>(state_.size());
  }

 private:
  static System make_system(const Scene& scene) {
    const Material<double> material{scene.restitution, scene.friction};
    std::vector<Body<double, Geometry>> bodies;
    for (const auto& [shape, size, item_mass, start] : scene.items)
      bodies.push_back({geometry(shape, size), item_mass, material});
    std::vector<Plane<double>> planes;
    for (const auto& [n, offset] : scene.walls) planes.push_back({{n[0], n[1], n[2]}, offset, material});
    return {std::move(bodies), std::move(planes)};
  }
  static Geometry geometry(Shape shape, const Vec3& size) {
    if constexpr (!std::is_same_v<Geometry, Sphere<double>>) {
      if (shape == Shape::box) return Box<double>(size[0], size[1], size[2]);
    }
    if constexpr (std::is_same_v<Geometry, AnyShape<double>>) {
      if (shape == Shape::capsule) return Capsule<double>(size[0], size[1]);
    }
    if constexpr (!std::is_same_v<Geometry, Box<double>>) return Sphere<double>(size[0]);
    throw std::logic_error("a shape that the scene's engine has not");
  }

  double step_;
  System system_;
  State state_;
  Stepper<System, Gravity<double>, Rk4> stepper_;
};

template <class S, template <class> class ShapeOf>
void register_shape(Shape shape, const std::string& kind, ContactMode mode) {
  using Engine = Rbres<S, ShapeOf>;
  static_assert(scene_count % Engine::lanes == 0);
  register_rows(shape, "rbres/" + kind, [=](double step) {
    std::deque<Engine> engines;
    for (int i = 0; i < scene_count; i += Engine::lanes) engines.emplace_back(i, step, mode);
    return engines;
  });
}

template <class S>
void register_kind(const std::string& kind, ContactMode mode) {
  register_shape<S, Sphere>(Shape::sphere, kind, mode);
  register_shape<S, Box>(Shape::box, kind, mode);
}

/// One step of N spheres, over the first simulated second.
template <int N>
void scaling(benchmark::State& state) {
  constexpr int steps = 500;
  double contacts = 0.0;
  for (auto _ : state) {
    state.PauseTiming();
    Rbres<double, Sphere, N> engine(0, 0.002, ContactMode::continuous);
    state.ResumeTiming();
    for (int i = 0; i < steps; ++i) engine.step();
    contacts = engine.contacts();
  }
  using benchmark::Counter;
  const double taken = 1e-6 * steps * static_cast<double>(state.iterations());
  state.counters["us_per_step"] = Counter(taken, Counter::kIsRate | Counter::kInvert);
  state.counters["us_per_body_and_step"] = Counter(taken * N, Counter::kIsRate | Counter::kInvert);
  state.counters["contacts_per_step"] = contacts / steps;
}

template <int... N>
void register_scaling() {
  (benchmark::RegisterBenchmark(("scaling/N" + std::to_string(N)).c_str(), scaling<N>)
       ->Unit(benchmark::kMillisecond),
   ...);
}

/// The experiment's scenarios, 3 to 5 bodies over 5 s in continuous mode, drawn and simulated on all threads:
/// wall time, what 100,000 of them would take, and the processor time of all threads together, which other
/// work on the machine disturbs less.
template <BodySet Set>
void dataset(benchmark::State& state, World world) {
  constexpr int count = Set == BodySet::standard ? 768 : 96;
  const ScenarioSampler<Set> sampler(world, 1);
  const auto start = std::chrono::steady_clock::now();
  const std::clock_t processor_start = std::clock();
  for (auto _ : state) benchmark::DoNotOptimize(generate(sampler, 0, count, {duration}));
  const std::chrono::duration<double> time = std::chrono::steady_clock::now() - start;
  const double processor_time = static_cast<double>(std::clock() - processor_start) / CLOCKS_PER_SEC;
  const double scenarios = count * static_cast<double>(state.iterations());
  state.counters["us_per_scenario"] = 1e6 * time.count() / scenarios;
  state.counters["s_per_100000"] = 1e5 * time.count() / scenarios;
  state.counters["processor_us_per_scenario"] = 1e6 * processor_time / scenarios;
  state.counters["threads"] = default_threads();
}

template <BodySet Set>
void register_dataset() {
  for (const World world : {World::free_space, World::room})
    benchmark::RegisterBenchmark(
        ("dataset/" + std::string(name(world)) + "/" + std::string(name(Set))).c_str(), dataset<Set>, world)
        ->Unit(benchmark::kMillisecond);
}

const bool registered = [] {
  register_kind<double>("double", ContactMode::discrete);
  register_kind<Pack<float, native_lanes<float>>>("lanes", ContactMode::discrete);
  register_kind<double>("continuous", ContactMode::continuous);
  register_scaling<2, 5, 8, 27, 64, 125, 216>();
  register_scenes<RbresCrowd<AnyShape<double>>>("pile60/rbres", piles(60));
  register_scenes<RbresCrowd<AnyShape<double>>>("pile64/rbres", {wide_pile(64)});
  register_scenes<RbresCrowd<AnyShape<double>>>("pile1000/rbres", {wide_pile(1000)});
  register_scenes<RbresCrowd<Box<double>>>("stack20/rbres", {stack(20)});
  register_scenes<RbresCrowd<Sphere<double>>>("gas64/rbres", {gas(64)});
  register_scenes<RbresCrowd<Sphere<double>>>("gas1000/rbres", {gas(1000)});
  register_dataset<BodySet::standard>();
  register_dataset<BodySet::box>();
  return true;
}();

}  // namespace
}  // namespace rbres::bench
