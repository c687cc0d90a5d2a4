#include <doctest/doctest.h>

#include <map>
#include <rbres/core/philox.hpp>
#include <rbres/sim/batch.hpp>
#include <string>

using namespace rbres;

namespace {

constexpr int bodies = 3;
constexpr Material<double> material{0.6, 0.3};
const auto balls =
    System<double, bodies, Sphere<double>>::of(Body{Sphere{0.25}, 1.0, material}, {floor_plane(material)});
const auto boxes = System<double, bodies, Box<double>>::of(Body{Box{0.30, 0.22, 0.15}, 1.0, material},
                                                           {floor_plane(material)});
const SimulationOptions options{.step = 2e-3, .duration = 0.5, .sample_rate = 20};

/// Bodies that fall on the floor and into each other.
SystemState<double, bodies> start(std::ptrdiff_t scenario) {
  Random random(11, static_cast<std::uint64_t>(scenario));
  SystemState<double, bodies> y;
  for (int i = 0; i < bodies; ++i) {
    y[i].position = {0.8 * i - 0.8 + random.uniform(-0.05, 0.05), random.uniform(-0.05, 0.05),
                     0.5 + 0.1 * i + random.uniform(-0.05, 0.05)};
    y[i].velocity = {0.8 * (1 - i), random.uniform(-0.3, 0.3), random.uniform(-1.0, 1.0)};
    y[i].angular_velocity = {random.uniform(-3.0, 3.0), random.uniform(-3.0, 3.0), random.uniform(-3.0, 3.0)};
  }
  return y;
}

/// Gravity, and on every body a push of its scenario's own; one of infinity from 0.2 s on for scenario `bad`.
template <class S>
auto pushes(const std::array<std::ptrdiff_t, ScalarTraits<S>::lanes>& lanes, std::ptrdiff_t bad = -1) {
  S push(0), blow(0);
  for (int l = 0; l < ScalarTraits<S>::lanes; ++l) {
    const std::ptrdiff_t scenario = lanes[static_cast<std::size_t>(l)];
    ScalarTraits<S>::set_lane(push, l, 0.1 * static_cast<double>(scenario));
    if (scenario == bad) ScalarTraits<S>::set_lane(blow, l, std::numeric_limits<double>::infinity());
  }
  return Forces{Gravity{}, [push, blow](const auto&, const auto&, int, const S& time) {
                  return Wrench<S>{{push, select(time > S(0.2), blow, S(0)), S(0)}, {}};
                }};
}

/// What an observer heard of each scenario.
struct Heard {
  std::vector<long> samples;
  std::vector<double> times;
  std::vector<SystemState<double, bodies>> states;
  std::vector<long> impacts;
  std::vector<bool> finite;
  bool operator==(const Heard&) const = default;
};

template <class S, class System>
std::vector<Heard> run(const System& system, std::ptrdiff_t count, int threads, std::ptrdiff_t bad = -1) {
  std::vector<Heard> heard(static_cast<std::size_t>(count));
  simulate_batch<S>(
      system, count, start, [bad](const auto& lanes) { return pushes<S>(lanes, bad); }, Rk4{}, options,
      [&](const auto& sample) {
        Heard& h = heard.at(static_cast<std::size_t>(sample.scenario));
        h.samples.push_back(sample.sample);
        h.times.push_back(sample.time);
        h.states.push_back(sample.state);
        h.impacts.push_back(sample.impacts);
        h.finite.push_back(sample.finite);
      },
      threads);
  return heard;
}

}  // namespace

TEST_CASE("the bits are the same for any number of threads") {
  const auto one = run<Pack<double, 4>>(boxes, 37, 1);
  long impacts = 0;
  for (const Heard& h : one) impacts += h.impacts.back();
  CHECK(impacts > 100);  // or it would prove little
  for (const int threads : {2, 4}) CHECK(run<Pack<double, 4>>(boxes, 37, threads) == one);
}

TEST_CASE("lanes, their tail, and one at a time give what simulate gives") {
  const auto check = [](const std::vector<Heard>& all) {
    for (std::size_t s = 0; s < all.size(); ++s) {
      CAPTURE(s);
      Heard expected;
      auto y = start(static_cast<std::ptrdiff_t>(s));
      const auto report = simulate(balls, y, pushes<double>({static_cast<std::ptrdiff_t>(s)}), Rk4{}, options,
                                   [&](double time, const auto& state) {
                                     expected.times.push_back(time);
                                     expected.states.push_back(state);
                                   });
      REQUIRE(all[s].samples == std::vector<long>{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10});
      CHECK(all[s].times == expected.times);
      CHECK(all[s].impacts.front() == 0);
      CHECK(all[s].impacts.back() == report.impacts);
      CHECK(report.impacts > 0);
      CHECK(all[s].finite == std::vector<bool>(11, true));
      for (std::size_t k = 0; k < 11; ++k) {
        CHECK((all[s].states[k].vector() - expected.states[k].vector()).cwiseAbs().maxCoeff() < 1e-9);
      }
    }
  };
  for (const std::ptrdiff_t count : {0, 1, 4, 6}) {  // in lanes of 4: none, a tail alone, no tail, both
    check(run<Pack<double, 4>>(balls, count, 0));
    check(run<double>(balls, count, 0));
  }
}

TEST_CASE("lanes past the end repeat the last scenario") {
  std::map<std::ptrdiff_t, std::array<std::ptrdiff_t, 4>> blocks;
  simulate_batch<Pack<double, 4>>(
      balls, 6, start,
      [&](const auto& lanes) {
        blocks[lanes[0]] = lanes;
        return Gravity{};
      },
      Rk4{}, {.step = 1e-3, .duration = 1e-3}, [](const auto&) {}, 1);
  CHECK(blocks.size() == 2);
  CHECK(blocks[0] == std::array<std::ptrdiff_t, 4>{0, 1, 2, 3});
  CHECK(blocks[4] == std::array<std::ptrdiff_t, 4>{4, 5, 5, 5});
}

TEST_CASE("a scenario that is not finite stops alone, with its last good state") {
  const auto good = run<Pack<double, 4>>(balls, 6, 0);
  const auto with_bad = run<Pack<double, 4>>(balls, 6, 0, 2);
  for (std::size_t s = 0; s < 6; ++s) {
    if (s != 2) CHECK(with_bad[s] == good[s]);
  }
  const Heard& bad = with_bad[2];
  for (std::size_t k = 0; k < 11; ++k) {
    CAPTURE(k);
    CHECK(bad.finite[k] == (k <= 4));  // 0.2 s is sample 4
    CHECK(bad.states[k] == good[2].states[std::min<std::size_t>(k, 4)]);
  }
}

TEST_CASE("bad options and starts are refused before anything is observed") {
  const auto refusal = [](const SimulationOptions& o, const auto& from) -> std::string {
    try {
      simulate_batch<Pack<double, 4>>(
          balls, 6, from, [](const auto&) { return Gravity{}; }, Rk4{}, o,
          [](const auto&) { FAIL("observed"); });
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  CHECK(refusal({.step = 0}, start) == "step: expected a positive time in s, found 0");
  CHECK(refusal({.step = NAN}, start) == "step: expected a positive time in s, found nan");
  CHECK(refusal({.duration = -1}, start) == "duration: expected a time of 0 s or more, found -1");
  CHECK(refusal({.sample_rate = INFINITY}, start).starts_with("sample rate: "));
  CHECK(refusal({.rest_speed = -1}, start).starts_with("rest speed: "));
  CHECK(refusal({.max_events = 0}, start) == "max events: expected 1 or more, found 0");
  CHECK(refusal({}, [](std::ptrdiff_t i) {
          auto y = start(i);
          if (i == 4) y[1].velocity.y = NAN;
          return y;
        }).starts_with("scenario 4: body 1, "));
  CHECK(refusal({}, [](std::ptrdiff_t i) {
          auto y = start(i);
          if (i == 5) y[2].position.z = 0.1;
          return y;
        }).starts_with("scenario 5: body 2 and plane 0: expected surfaces apart or touching"));
}
