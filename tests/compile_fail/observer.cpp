// Observers that simulate would pass over in silence, or misunderstand: they must not compile. The tests look
// for the words in the error.
#include <rbres/sim/simulate.hpp>

using State = rbres::SystemState<double, 1>;

int main() {
  const rbres::System<double, 1, rbres::Sphere<double>> system{{rbres::Body{rbres::Sphere{1.0}, 1.0}}};
  State state;
#if defined(RBRES_OTHER_ARGUMENTS)
  const auto observer = [](const State&) {};
#elif defined(RBRES_CHANGES_THE_STATE)
  const auto observer = [](double, State&) {};
#elif defined(RBRES_RETURNS_A_NUMBER)
  const auto observer = [](double time, const State&) { return time; };
#elif defined(RBRES_OTHER_IMPACT)
  struct {
    void operator()(double, const State&) {}
    void impact(double, const State&) {}
  } observer;
#else
  const auto observer = [](double, const State&) { return true; };
#endif
  rbres::simulate(system, state, rbres::Gravity{}, rbres::Rk4{}, {}, observer);
}
