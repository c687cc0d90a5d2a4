// A shape that no detect() knows: simulating it must not compile. The test looks for the word in the error.
#include <rbres/rbres.hpp>

template <class S>
struct Cone {
  S radius;
  S bounding_radius() const { return radius; }
  S lever() const { return radius; }
  S volume() const { return radius; }
  rbres::Vec3<S> unit_inertia() const { return {S(1), S(1), S(1)}; }
  S frontal(const rbres::Vec3<S>&) const { return S(0); }
  void check(const std::string&) const {}
};

int main() {
#ifdef RBRES_KNOWN_PAIR
  using Shape = rbres::Sphere<double>;
#else
  using Shape = Cone<double>;
#endif
  const auto system = rbres::System<double, 2, Shape>::of(rbres::Body<double, Shape>(Shape{1.0}, 1.0));
  rbres::SystemState<double, 2> state;
  rbres::simulate(system, state, rbres::Gravity{}, rbres::Rk4{}, {});
}
