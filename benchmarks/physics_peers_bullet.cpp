/// Bullet (Debian: libbullet-dev), its sequential-impulse world with its defaults; single precision, as
/// Debian's default build of it.
#include <btBulletDynamicsCommon.h>

#include <algorithm>
#include <memory>

#include "physics_rows.hpp"

namespace rbres::bench {
namespace {

btScalar real(double x) { return static_cast<btScalar>(x); }
btVector3 vector(const Vec3& v) { return {real(v[0]), real(v[1]), real(v[2])}; }

// By default Bullet multiplies the two materials' numbers; these are the combining rules of rbres.
btScalar larger_restitution(const btCollisionObject* first, const btCollisionObject* second) {
  return std::max(first->getRestitution(), second->getRestitution());
}
btScalar mean_friction(const btCollisionObject* first, const btCollisionObject* second) {
  return std::sqrt(first->getFriction() * second->getFriction());
}

class Bullet {
 public:
  Bullet(const Scene& scene, double step) : scene_(scene), step_(real(step)) {
    gCalculateCombinedRestitutionCallback = larger_restitution;
    gCalculateCombinedFrictionCallback = mean_friction;
    world_.setGravity({0, 0, real(-scene.gravity)});
    // Penetration is always taken out apart from the velocities (default: only beyond 4 cm), else bounces
    // gain energy.
    world_.getSolverInfo().m_splitImpulsePenetrationThreshold = 0;
    for (const Wall& wall : scene.walls)
      add(0, btTransform::getIdentity(),
          std::make_unique<btStaticPlaneShape>(vector(wall.normal), real(wall.offset)));
    for (const auto& [shape, size, item_mass, start] : scene.items) {
      const auto [x, y, z, w] = start.orientation;
      const btTransform pose(btQuaternion(real(x), real(y), real(z), real(w)), vector(start.position));
      btRigidBody& body = add(real(item_mass), pose, geometry(shape, size));
      body.setLinearVelocity(vector(start.velocity));
      body.setAngularVelocity(pose.getBasis() * vector(start.spin));
    }
  }
  Bullet(const Bullet&) = delete;
  Bullet& operator=(const Bullet&) = delete;
  ~Bullet() {
    for (const auto& body : bodies_) world_.removeRigidBody(body.get());
  }

  void step() {
    for (std::size_t i = scene_.walls.size(); scene_.air && i < bodies_.size(); ++i) {
      const Shape shape = scene_.items[i - scene_.walls.size()].shape;
      const btVector3& v = bodies_[i]->getLinearVelocity();
      const btVector3 in_body = v * bodies_[i]->getWorldTransform().getBasis();  // transposed times v
      bodies_[i]->applyCentralForce(
          vector(drag(shape, {v.x(), v.y(), v.z()}, {in_body.x(), in_body.y(), in_body.z()})));
    }
    world_.stepSimulation(step_, 0);  // 0: exactly one step of this length
    for (int i = 0; i < dispatcher_.getNumManifolds(); ++i) {
      const btPersistentManifold& manifold = *dispatcher_.getManifoldByIndexInternal(i);
      for (int k = 0; k < manifold.getNumContacts(); ++k)
        contacts_ += manifold.getContactPoint(k).getDistance() <= 0;
    }
  }

  double contacts() const { return contacts_; }

  double mean_height() const {
    double sum = 0.0;
    for (std::size_t i = scene_.walls.size(); i < bodies_.size(); ++i)
      sum += bodies_[i]->getWorldTransform().getOrigin().z();
    return sum / static_cast<double>(scene_.items.size());
  }

 private:
  static std::unique_ptr<btCollisionShape> geometry(Shape shape, const Vec3& size) {
    if (shape == Shape::sphere) return std::make_unique<btSphereShape>(real(size[0]));
    if (shape == Shape::box) return std::make_unique<btBoxShape>(vector(size));
    return std::make_unique<btCapsuleShapeZ>(real(size[0]), real(2 * size[1]));
  }
  btRigidBody& add(btScalar body_mass, const btTransform& pose, std::unique_ptr<btCollisionShape> geometry) {
    btVector3 moments(0, 0, 0);
    if (body_mass > 0) geometry->calculateLocalInertia(body_mass, moments);
    geometries_.push_back(std::move(geometry));
    bodies_.push_back(std::make_unique<btRigidBody>(body_mass, nullptr, geometries_.back().get(), moments));
    btRigidBody& body = *bodies_.back();
    body.setWorldTransform(pose);
    body.setInterpolationWorldTransform(pose);
    body.setFriction(real(scene_.friction));
    body.setRestitution(real(scene_.restitution));
    body.setContactProcessingThreshold(
        0);  // else a contact ahead slows the body before it arrives: no bounce
    body.setActivationState(DISABLE_DEACTIVATION);
    world_.addRigidBody(&body);
    return body;
  }

  Scene scene_;
  btScalar step_;
  btDefaultCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_{&configuration_};
  btDbvtBroadphase broad_phase_;
  btSequentialImpulseConstraintSolver solver_;
  btDiscreteDynamicsWorld world_{&dispatcher_, &broad_phase_, &solver_, &configuration_};
  std::vector<std::unique_ptr<btCollisionShape>> geometries_;  // of the bodies
  std::vector<std::unique_ptr<btRigidBody>> bodies_;           // the walls first
  double contacts_ = 0;
};

const bool registered = register_peer<Bullet>("bullet") && register_crowds<Bullet>("bullet");

}  // namespace
}  // namespace rbres::bench
