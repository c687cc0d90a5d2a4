// A glTF animation, as GltfScene writes them, with its time line.
import * as THREE from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';

export class Recording {
  static async read(bytes) {
    return new Recording(await new GLTFLoader().parseAsync(bytes, ''));
  }

  constructor(gltf) {
    if (gltf.animations.length === 0) throw new Error('the file has no animation');
    // The format's y points up.
    this.group = new THREE.Group().add(gltf.scene);
    this.group.rotation.x = Math.PI / 2;
    gltf.scene.traverse((node) => { if (node.isMesh) node.castShadow = node.receiveShadow = true; });
    this.mixer = new THREE.AnimationMixer(gltf.scene);
    this.duration = 0;
    for (const clip of gltf.animations) {
      this.duration = Math.max(this.duration, clip.duration);
      const action = this.mixer.clipAction(clip);
      action.setLoop(THREE.LoopOnce);
      action.clampWhenFinished = true;
      action.play();
    }
    this.show(0);
  }

  show(time) {
    this.time = Math.min(Math.max(time, 0), this.duration);
    this.mixer.setTime(this.time);
  }
}
