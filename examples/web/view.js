// The room and its bodies, drawn with three.js. The world's z points up.
import * as THREE from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';
import { RoomEnvironment } from 'three/addons/environments/RoomEnvironment.js';
import { RoundedBoxGeometry } from 'three/addons/geometries/RoundedBoxGeometry.js';

const half = 1.6;  // of the room, m; as in world.hpp
const colours = [0x4cc9f0, 0xff8552, 0xb388ff, 0x5ddf9b, 0xffd166, 0xf2668b];
const mostPoints = 1024;

// Half of each body is paler, so that its spin can be seen.
function stripes() {
  const canvas = document.createElement('canvas');
  canvas.width = 256;
  canvas.height = 4;
  const draw = canvas.getContext('2d');
  for (let i = 0; i < 4; ++i) {
    draw.fillStyle = i % 2 ? '#ffffff' : '#a9b4c6';
    draw.fillRect(64 * i, 0, 64, 4);
  }
  const texture = new THREE.CanvasTexture(canvas);
  texture.colorSpace = THREE.SRGBColorSpace;
  return texture;
}

function geometry({ kind, sizes: [a, b, c] }) {
  if (kind === 0) return new THREE.SphereGeometry(a, 40, 24).rotateX(Math.PI / 2);
  if (kind === 1) return new RoundedBoxGeometry(2 * a, 2 * b, 2 * c, 3, 0.12 * Math.min(a, b, c));
  return new THREE.CapsuleGeometry(a, 2 * b, 12, 32).rotateX(Math.PI / 2);
}

export class View {
  constructor(canvas) {
    this.canvas = canvas;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
    this.renderer.shadowMap.enabled = true;
    this.renderer.toneMapping = THREE.ACESFilmicToneMapping;
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color(0x0c111b);
    this.scene.fog = new THREE.Fog(0x0c111b, 8, 18);
    const room = new RoomEnvironment();
    this.scene.environment = new THREE.PMREMGenerator(this.renderer).fromScene(room, 0.04).texture;
    this.scene.environmentIntensity = 0.28;

    this.camera = new THREE.PerspectiveCamera(38, 1, 0.05, 60);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.maxPolarAngle = 0.49 * Math.PI;
    this.controls.minDistance = 2;
    this.controls.maxDistance = 14;
    this.controls.enablePan = false;
    this.controls.target.set(0, 0, 0.45);
    this.camera.position.set(3.6, -5.2, 3.5);

    const sun = new THREE.DirectionalLight(0xfff1de, 3.6);
    sun.position.set(4.2, -1.6, 5);
    sun.castShadow = true;
    sun.shadow.mapSize.set(1024, 1024);
    sun.shadow.radius = 3;
    sun.shadow.bias = -2e-4;
    sun.shadow.normalBias = 0.01;
    Object.assign(sun.shadow.camera, { left: -3, right: 3, top: 3, bottom: -3, near: 1, far: 14 });
    const sky = new THREE.HemisphereLight(0x9ec9ff, 0x1a2233, 0.45);
    this.scene.add(sun, sky);
    this.build();

    this.texture = stripes();
    this.solid = new THREE.Group();
    this.ghost = new THREE.Group();
    this.recording = new THREE.Group();
    this.scene.add(this.solid, this.ghost, this.recording);
    const dots = new THREE.BufferGeometry();
    dots.setAttribute('position', new THREE.BufferAttribute(new Float32Array(3 * mostPoints), 3));
    this.points = new THREE.Points(dots, new THREE.PointsMaterial({ color: 0xff3b6b, size: 7, sizeAttenuation: false, depthTest: false, transparent: true, fog: false }));
    this.points.frustumCulled = false;
    this.scene.add(this.points);
    this.ray = new THREE.Raycaster();
    this.plane = new THREE.Plane();
    this.chosen = -1;
  }

  // A floor with lines every 40 cm, and four walls of glass.
  build() {
    const floor = new THREE.Mesh(new THREE.CircleGeometry(16, 96), new THREE.MeshStandardMaterial({ color: 0x1a2336, roughness: 0.85, metalness: 0.1 }));
    floor.position.z = -0.002;
    const inside = new THREE.Mesh(new THREE.PlaneGeometry(2 * half, 2 * half), new THREE.MeshStandardMaterial({ color: 0x33436a, roughness: 0.6 }));
    floor.receiveShadow = inside.receiveShadow = true;
    const grid = new THREE.GridHelper(2 * half, 8, 0x6f88b8, 0x51668f).rotateX(Math.PI / 2);
    grid.position.z = 0.001;
    this.room = new THREE.Group().add(floor, inside, grid);
    const glass = new THREE.MeshBasicMaterial({ color: 0x8fc7ff, transparent: true, opacity: 0.045, side: THREE.DoubleSide, depthWrite: false });
    const height = 1.1;
    for (let i = 0; i < 4; ++i) {
      const wall = new THREE.Mesh(new THREE.PlaneGeometry(2 * half, height), glass);
      const angle = (Math.PI / 2) * i;
      wall.rotation.set(Math.PI / 2, angle, 0);
      wall.position.set(half * Math.sin(angle), -half * Math.cos(angle), height / 2);
      const edge = new THREE.LineSegments(new THREE.EdgesGeometry(wall.geometry), new THREE.LineBasicMaterial({ color: 0x7fb2e8, transparent: true, opacity: 0.35 }));
      wall.add(edge);
      this.room.add(wall);
    }
    this.scene.add(this.room);
  }

  // Bodies are {kind, sizes}; see web_shape in page.cpp.
  setBodies(bodies) {
    for (const group of [this.solid, this.ghost]) {
      group.traverse((mesh) => { mesh.geometry?.dispose(); mesh.material?.dispose(); });
      group.clear();
    }
    bodies.forEach((body, i) => {
      const shape = geometry(body);
      const mesh = new THREE.Mesh(shape, new THREE.MeshStandardMaterial({
        color: colours[i % colours.length], map: body.kind === 1 ? null : this.texture, roughness: 0.22,
      }));
      mesh.castShadow = mesh.receiveShadow = true;
      this.solid.add(mesh);
      const ghost = new THREE.Mesh(shape, new THREE.MeshStandardMaterial({ color: 0xffffff, transparent: true, opacity: 0.28, depthWrite: false, roughness: 0.4 }));
      this.ghost.add(ghost);
    });
    this.choose(-1);
  }

  // 13 numbers a body, of which the first seven say where it is.
  place(group, states) {
    group.children.forEach((mesh, i) => {
      mesh.position.fromArray(states, 13 * i);
      mesh.quaternion.fromArray(states, 13 * i + 3);
    });
  }

  placePoints(positions) {
    const attribute = this.points.geometry.getAttribute('position');
    attribute.array.set(positions);
    attribute.needsUpdate = true;
    this.points.geometry.setDrawRange(0, positions.length / 3);
  }

  choose(i) {
    this.chosen = i;
    this.solid.children.forEach((mesh, k) => mesh.material.emissive.setHex(k === i ? 0x35506b : 0));
  }

  aim(event) {
    const box = this.canvas.getBoundingClientRect();
    this.ray.setFromCamera(new THREE.Vector2(((event.clientX - box.left) / box.width) * 2 - 1, 1 - ((event.clientY - box.top) / box.height) * 2), this.camera);
  }

  // The body under the pointer and the point of its surface there, or null. The pointer then moves in the plane
  // through that point that faces the camera.
  pick(event) {
    this.aim(event);
    const [hit] = this.ray.intersectObjects(this.solid.children, false);
    if (!hit || !this.solid.visible) return null;
    this.plane.setFromNormalAndCoplanarPoint(this.camera.getWorldDirection(new THREE.Vector3()), hit.point);
    return { body: this.solid.children.indexOf(hit.object), point: hit.point.toArray() };
  }

  // Where the pointer is in that plane, within the room.
  follow(event) {
    this.aim(event);
    const at = this.ray.ray.intersectPlane(this.plane, new THREE.Vector3());
    if (!at) return null;
    return at.clamp(new THREE.Vector3(-half, -half, 0.05), new THREE.Vector3(half, half, 3)).toArray();
  }

  turn(sideways, up) {
    const offset = this.camera.position.clone().sub(this.controls.target);
    const spherical = new THREE.Spherical().setFromVector3(new THREE.Vector3(offset.x, offset.z, -offset.y));
    spherical.theta += sideways;
    spherical.phi = Math.min(Math.max(spherical.phi + up, 0.15), 0.49 * Math.PI);
    const v = new THREE.Vector3().setFromSpherical(spherical);
    this.camera.position.copy(this.controls.target).add(new THREE.Vector3(v.x, -v.z, v.y));
  }

  draw() {
    const width = this.canvas.clientWidth, height = this.canvas.clientHeight;
    const ratio = Math.min(devicePixelRatio, 2);
    const size = this.renderer.getSize(new THREE.Vector2());
    if (size.x !== width || size.y !== height) {
      this.renderer.setPixelRatio(ratio);
      this.renderer.setSize(width, height, false);
      this.camera.aspect = width / height;
      // The whole room stays in sight, on a narrow picture too.
      this.camera.fov = width < height ? 2 * Math.atan(Math.tan((17 * Math.PI) / 180) / Math.max(this.camera.aspect, 0.5)) * (180 / Math.PI) : 34;
      this.camera.updateProjectionMatrix();
    }
    this.controls.update();
    this.renderer.render(this.scene, this.camera);
  }
}
