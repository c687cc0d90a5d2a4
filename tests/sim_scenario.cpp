#include "../examples/scenarios/compiled.hpp"

#include <doctest/doctest.h>

#include <map>

using namespace rbres;

namespace {

template <BodySet Set>
std::vector<Scenario> draw(World world, std::uint64_t count, std::uint64_t seed = 1) {
  const ScenarioSampler<Set> sampler(world, seed);
  std::vector<Scenario> all;
  for (std::uint64_t i = 0; i < count; ++i) all.push_back(sampler(i));
  return all;
}

bool equal(const Scenario& a, const Scenario& b) {
  return a.family == b.family && a.bodies == b.bodies && a.state == b.state && a.wrench == b.wrench;
}

/// Mean and deviation of numbers.
struct Moments {
  double sum = 0, squares = 0, least = 1e300, most = -1e300;
  long count = 0;

  void add(double x) {
    sum += x, squares += x * x, ++count;
    least = std::min(least, x), most = std::max(most, x);
  }
  void add(const Vec3<double>& v) { add(v.x), add(v.y), add(v.z); }
  double mean() const { return sum / static_cast<double>(count); }
  double deviation() const { return std::sqrt(squares / static_cast<double>(count) - mean() * mean()); }
};

/// Calls f(body's state, its wrench, family) for all present bodies.
template <class F>
void each_body(const std::vector<Scenario>& all, const F& f) {
  for (const Scenario& s : all)
    for (int b = 0; b < s.bodies; ++b) f(s.state[b], s.wrench[static_cast<std::size_t>(b)], s.family);
}

/// Normal with this deviation and no mean: within four standard errors.
void check_normal(const Moments& m, double deviation) {
  CAPTURE(deviation);
  const double error = 4 * deviation / std::sqrt(static_cast<double>(m.count));
  CHECK(m.count > 1000);
  CHECK(std::abs(m.mean()) < error);
  CHECK(std::abs(m.deviation() - deviation) < error);
  CHECK(m.most > 2.5 * deviation);
}
void check_uniform(const Moments& m, double from, double to) {
  const double error = (to - from) / std::sqrt(12.0 * static_cast<double>(m.count));
  CHECK(m.count > 1000);
  CHECK(m.least >= from);
  CHECK(m.most < to);
  CHECK(std::abs(m.mean() - 0.5 * (from + to)) < 4 * error);
  CHECK(std::abs(m.deviation() - (to - from) / std::sqrt(12.0)) < 4 * error);
}

/// Share of each family's scenarios that have had a contact by each horizon.
template <BodySet Set>
std::map<Family, std::vector<double>> contact_shares(World world, Eigen::Index count,
                                                     const std::vector<double>& horizons) {
  const ScenarioData data = generate(ScenarioSampler<Set>(world, 1), 0, count, horizons);
  std::map<Family, std::vector<double>> shares;
  std::map<Family, double> of;
  for (std::size_t i = 0; i < data.family.size(); ++i) {
    auto& met = shares[data.family[i]];
    met.resize(horizons.size());
    of[data.family[i]] += 1;
    for (std::size_t h = 0; h < horizons.size(); ++h) {
      met[h] += static_cast<double>(data.first_contact[i]) <= horizons[h] + 1e-6;
    }
  }
  for (auto& [family, met] : shares)
    for (double& share : met) share /= of[family];
  return shares;
}

}  // namespace

TEST_CASE("scenario i is a function of seed and i, and another one for each") {
  const auto check = [](World world) {
    const auto all = draw<BodySet::standard>(world, 12);
    const ScenarioSampler<BodySet::standard> sampler(world, 1);
    for (const std::uint64_t i : {11u, 3u, 3u, 0u}) CHECK(equal(sampler(i), all[i]));
    const auto other = draw<BodySet::standard>(world, 12, 2);
    for (std::size_t i = 0; i < 12; ++i) {
      CHECK(all[i].state[0].position.x != other[i].state[0].position.x);
      CHECK(all[i].state[0].position.x != all[(i + 1) % 12].state[0].position.x);
    }
  };
  check(World::free_space);
  check(World::room);
}

TEST_CASE("these are the scenarios of version standard-3") {
  // Other numbers are another version: results name it.
  REQUIRE(scenario_version == "standard-3");
  const auto check = [](const Scenario& s, double x, double vz, double wz, double force) {
    CHECK(s.state[2].position.x == doctest::Approx(x).epsilon(1e-6));
    CHECK(s.state[2].velocity.z == doctest::Approx(vz).epsilon(1e-6));
    CHECK(s.state[2].angular_velocity.z == doctest::Approx(wz).epsilon(1e-6));
    CHECK(s.wrench[2].force.y == doctest::Approx(force).epsilon(1e-6));
  };
  const auto balls = [](World world, std::uint64_t i) {
    return ScenarioSampler<BodySet::standard>(world, 1)(i);
  };
  const auto boxes = [](World world, std::uint64_t i) { return ScenarioSampler<BodySet::box>(world, 1)(i); };
  check(balls(World::free_space, 4), 1.18885493, -0.034041822, 1.12382257, 3.58002448);
  check(balls(World::free_space, 5), 1.56623626, 3.6502583, 2.88270235, -0.309978306);
  check(balls(World::room, 4), 1.32557321, -0.017020911, 0.749215066, 3.58002448);
  check(balls(World::room, 5), -1.93719542, 0.653709233, -4.7374959, 4.89079046);
  check(boxes(World::free_space, 4), 0.109753974, 0.0368750803, -0.853696048, -1.53407288);
  check(boxes(World::room, 5), -1.80591488, 0.653709233, -4.7374959, 4.89079046);
}

TEST_CASE("families and body counts in equal shares") {
  const auto check = [](World world, std::vector<Family> families) {
    std::map<std::pair<Family, int>, int> counts;
    for (const Scenario& s : draw<BodySet::box>(world, 36)) ++counts[{s.family, s.bodies}];
    CHECK(counts.size() == 3 * families.size());
    for (const Family family : families)
      for (int n = 3; n <= 5; ++n) CHECK(counts[{family, n}] == 36 / (3 * std::ssize(families)));
  };
  check(World::free_space, {Family::flight, Family::pair, Family::cluster});
  check(World::room, {Family::drop, Family::scatter});
}

TEST_CASE_TEMPLATE("all start apart, within their bounds, in numbers that a float holds", Tag,
                   std::integral_constant<BodySet, BodySet::standard>,
                   std::integral_constant<BodySet, BodySet::box>) {
  constexpr BodySet set = Tag::value;
  const double radius = scenario_body<set>().bounding_radius();
  for (const World world : {World::free_space, World::room}) {
    const auto check_one = [&]<int N>(const Scenario& s, std::integral_constant<int, N>) {
      SystemState<double, N> present;
      std::copy_n(s.state.body.begin(), N, present.body.begin());
      CHECK_NOTHROW(check_state(scenario_system<set, N>(world), present));  // finite, unit, apart, inside
    };
    for (const Scenario& s : draw<set>(world, 180)) {
      if (s.bodies == 3) check_one(s, std::integral_constant<int, 3>{});
      if (s.bodies == 4) check_one(s, std::integral_constant<int, 4>{});
      if (s.bodies == 5) check_one(s, std::integral_constant<int, 5>{});
      for (int i = 0; i < s.bodies; ++i) {
        const Vec3<double>& p = s.state[i].position;
        for (int j = 0; j < i; ++j) CHECK(norm(p - s.state[j].position) >= 2 * radius + 0.02);
        const double wall = world == World::room ? 2.5 - radius - 0.02 + 1e-6 : 2;
        CHECK(std::max(std::abs(p.x), std::abs(p.y)) <= wall);
        if (s.family == Family::drop) CHECK((p.z >= 0.6f && p.z <= 3));
        if (s.family == Family::scatter) CHECK((p.z >= radius && p.z <= 5 - radius));
        if (world == World::free_space) CHECK(std::abs(p.z) <= 2);
        if (world == World::free_space) CHECK(norm(s.state[i].velocity) <= 6);
        for (int k = 0; k < 13; ++k) {
          const double x = s.state[i].vector()[k];
          CHECK(x == static_cast<double>(static_cast<float>(x)));
        }
      }
    }
  }
}

TEST_CASE("numbers are distributed as documented") {
  Moments force, torque, orientation, orientation2, free_spin, drop_spin, drop_velocity, drop_height, drop_x,
      scatter_spin, scatter_speed;
  const auto common = [&](const RigidState<double>& y, const Wrench<double>& w) {
    force.add(w.force);
    torque.add(w.torque);
    for (const double q : {y.orientation.x, y.orientation.y, y.orientation.z, y.orientation.w}) {
      orientation.add(q);
      orientation2.add(q * q);
    }
  };
  each_body(draw<BodySet::standard>(World::room, 2000), [&](const auto& y, const auto& w, Family family) {
    common(y, w);
    (family == Family::drop ? drop_spin : scatter_spin).add(y.angular_velocity);
    if (family == Family::scatter) scatter_speed.add(norm(y.velocity));
    if (family != Family::drop) return;
    drop_velocity.add(y.velocity);
    drop_height.add(y.position.z);
    drop_x.add(y.position.x);
  });
  each_body(draw<BodySet::standard>(World::free_space, 200), [&](const auto& y, const auto& w, Family) {
    common(y, w);
    free_spin.add(y.angular_velocity);
  });
  check_normal(force, 2);
  check_normal(torque, 0.02);
  check_normal(free_spin, 1.5);
  check_normal(drop_spin, 1);
  check_normal(drop_velocity, 0.5);
  check_normal(scatter_spin, 3);
  check_uniform(scatter_speed, 2 - 1e-6, 6 + 1e-6);
  CHECK(drop_height.most > 2.95);
  CHECK(drop_height.least < 0.65);
  CHECK(std::abs(drop_height.mean() - 1.8) < 0.06);  // bodies are apart, so not quite uniform
  CHECK(std::abs(drop_x.mean()) < 0.1);
  CHECK(drop_x.most > 2.2);
  CHECK(drop_x.least < -2.2);
  // Uniform over rotations: each component has mean 0, mean square 1/4, and its square the deviation 1/4.
  CHECK(std::abs(orientation.mean()) < 0.01);
  CHECK(orientation2.mean() == doctest::Approx(0.25).epsilon(1e-6));
  CHECK(orientation2.deviation() == doctest::Approx(0.25).epsilon(0.02));
}

TEST_CASE("contacts come as the page of the scenarios says") {
  // Bounds: the page's shares, four standard errors of the few scenarios drawn here.
  const auto near = [](double share, double page, double count) {
    CAPTURE(page);
    CHECK(std::abs(share - page) <= 4 * std::sqrt(page * (1 - page) / count) + 1e-9);
  };
  auto free = contact_shares<BodySet::standard>(World::free_space, 360, {0.5, 1, 2.1, 5});
  CHECK(free[Family::flight] == std::vector<double>{0, 0, 0, 0});
  near(free[Family::pair][0], 0.230, 120);
  CHECK(free[Family::pair][2] >= 0.99);
  near(free[Family::cluster][0], 0.512, 120);
  CHECK(free[Family::cluster][2] >= 0.99);
  auto room = contact_shares<BodySet::standard>(World::room, 240, {0.02, 0.1, 0.5, 1});
  near(room[Family::drop][1], 0.042, 120);
  near(room[Family::drop][2], 0.889, 120);
  near(room[Family::scatter][1], 0.402, 120);
  CHECK(room[Family::drop].back() == 1);
  CHECK(room[Family::scatter].back() == 1);
  auto boxes = contact_shares<BodySet::box>(World::free_space, 180, {0.5, 1, 2.1, 5});
  CHECK(boxes[Family::flight] == std::vector<double>{0, 0, 0, 0});
  near(boxes[Family::pair][1], 0.662, 60);
  CHECK(boxes[Family::pair][2] >= 0.99);
  CHECK(boxes[Family::cluster][2] >= 0.99);
}
