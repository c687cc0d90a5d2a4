/// ODE (Debian: libode-dev), quickstep with its defaults; double precision, as Debian builds it.
#include <ode/ode.h>

#include "physics_rows.hpp"

namespace rbres::bench {
namespace {

class Ode {
 public:
  Ode(const Scene& scene, double step) : scene_(scene), step_(step) {
    [[maybe_unused]] static const int initialised = (dInitODE2(0), 0);
    // The quickest of its spaces for a handful of bodies, and for many.
    space_ = scene.items.size() > 30 ? dSweepAndPruneSpaceCreate(nullptr, dSAP_AXES_XYZ)
                                     : dSimpleSpaceCreate(nullptr);
    dWorldSetGravity(world_, 0.0, 0.0, -scene.gravity);
    for (const auto& [n, offset] : scene.walls) dCreatePlane(space_, n[0], n[1], n[2], offset);
    for (const auto& [shape, size, item_mass, start] : scene.items) {
      const dBodyID body = dBodyCreate(world_);
      const auto [a, b, c] = size;
      dGeomID geometry;
      dMass inertial;
      if (shape == Shape::sphere) {
        geometry = dCreateSphere(space_, a);
        dMassSetSphereTotal(&inertial, item_mass, a);
      } else if (shape == Shape::box) {
        geometry = dCreateBox(space_, 2 * a, 2 * b, 2 * c);
        dMassSetBoxTotal(&inertial, item_mass, 2 * a, 2 * b, 2 * c);
      } else {
        geometry = dCreateCapsule(space_, a, 2 * b);
        dMassSetCapsuleTotal(&inertial, item_mass, 3, a, 2 * b);
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
    for (std::size_t i = 0; scene_.air && i < bodies_.size(); ++i) {
      const dBodyID body = bodies_[i];
      const dReal* v = dBodyGetLinearVel(body);
      dVector3 in_body;
      dBodyVectorFromWorld(body, v[0], v[1], v[2], in_body);
      const auto [x, y, z] =
          drag(scene_.items[i].shape, {v[0], v[1], v[2]}, {in_body[0], in_body[1], in_body[2]});
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
      contacts[i].surface.mu = ode.scene_.friction;
      contacts[i].surface.bounce = ode.scene_.restitution;
      contacts[i].surface.bounce_vel = 0.0;
      const dJointID joint = dJointCreateContact(ode.world_, ode.joints_, &contacts[i]);
      dJointAttach(joint, dGeomGetBody(first), dGeomGetBody(second));
    }
    ode.contacts_ += count;
  }

  Scene scene_;
  double step_;
  dWorldID world_ = dWorldCreate();
  dSpaceID space_;
  dJointGroupID joints_ = dJointGroupCreate(0);
  std::vector<dBodyID> bodies_;
  double contacts_ = 0;
};

const bool registered = register_peer<Ode>("ode") && register_crowds<Ode>("ode");

}  // namespace
}  // namespace rbres::bench
