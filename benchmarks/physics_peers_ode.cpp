/// ODE (Debian: libode-dev), quickstep with its defaults; double precision, as Debian builds it.
#include <ode/ode.h>

#include "physics_rows.hpp"

namespace rbres::bench {
namespace {

class Ode {
 public:
  Ode(Shape shape, const std::vector<Start>& starts, double step) : shape_(shape), step_(step) {
    [[maybe_unused]] static const int initialised = (dInitODE2(0), 0);
    dWorldSetGravity(world_, 0.0, 0.0, -gravity);
    dCreatePlane(space_, 0.0, 0.0, 1.0, 0.0);
    for (const Start& start : starts) {
      const dBodyID body = dBodyCreate(world_);
      dGeomID geometry;
      dMass inertial;
      if (shape == Shape::sphere) {
        geometry = dCreateSphere(space_, radius);
        dMassSetSphereTotal(&inertial, mass, radius);
      } else {
        const auto [a, b, c] = half_extents;
        geometry = dCreateBox(space_, 2 * a, 2 * b, 2 * c);
        dMassSetBoxTotal(&inertial, mass, 2 * a, 2 * b, 2 * c);
      }
      dBodySetMass(body, &inertial);
      dGeomSetBody(geometry, body);
      const auto [x, y, z] = start.position;
      dBodySetPosition(body, x, y, z);
      const auto [qx, qy, qz, qw] = start.orientation;
      const dQuaternion scalar_first{qw, qx, qy, qz};
      dBodySetQuaternion(body, scalar_first);
      const auto [vx, vy, vz] = start.velocity;
      dBodySetLinearVel(body, vx, vy, vz);
      dVector3 spin;
      dBodyVectorToWorld(body, start.spin[0], start.spin[1], start.spin[2], spin);
      dBodySetAngularVel(body, spin[0], spin[1], spin[2]);
      bodies_.push_back(body);
    }
  }
  Ode(const Ode&) = delete;
  Ode& operator=(const Ode&) = delete;
  ~Ode() {
    dJointGroupDestroy(joints_);
    dSpaceDestroy(space_);
    dWorldDestroy(world_);
  }

  void step() {
    for (const dBodyID body : bodies_) {
      const dReal* v = dBodyGetLinearVel(body);
      dVector3 in_body;
      dBodyVectorFromWorld(body, v[0], v[1], v[2], in_body);
      const auto [x, y, z] = drag(shape_, {v[0], v[1], v[2]}, {in_body[0], in_body[1], in_body[2]});
      dBodyAddForce(body, x, y, z);
    }
    dSpaceCollide(space_, this, &collide);
    dWorldQuickStep(world_, step_);
    dJointGroupEmpty(joints_);
  }

  double contacts() const { return contacts_; }

  double mean_height() const {
    double sum = 0.0;
    for (const dBodyID body : bodies_) sum += dBodyGetPosition(body)[2];
    return sum / static_cast<double>(bodies_.size());
  }

 private:
  static void collide(void* self, dGeomID first, dGeomID second) {
    auto& ode = *static_cast<Ode*>(self);
    constexpr int capacity = 8;  // as many as a pair of boxes has
    dContact contacts[capacity];
    const int count = dCollide(first, second, capacity, &contacts[0].geom, sizeof(dContact));
    for (int i = 0; i < count; ++i) {
      contacts[i].surface.mode = dContactBounce | dContactApprox1;
      contacts[i].surface.mu = friction;
      contacts[i].surface.bounce = restitution;
      contacts[i].surface.bounce_vel = 0.0;
      const dJointID joint = dJointCreateContact(ode.world_, ode.joints_, &contacts[i]);
      dJointAttach(joint, dGeomGetBody(first), dGeomGetBody(second));
    }
    ode.contacts_ += count;
  }

  Shape shape_;
  double step_;
  dWorldID world_ = dWorldCreate();
  dSpaceID space_ = dSimpleSpaceCreate(nullptr);  // the quickest of its spaces for a handful of bodies
  dJointGroupID joints_ = dJointGroupCreate(0);
  std::vector<dBodyID> bodies_;
  double contacts_ = 0;
};

const bool registered = register_peer<Ode>("ode");

}  // namespace
}  // namespace rbres::bench
