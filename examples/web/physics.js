// The functions of page.cpp, with JavaScript's arrays and exceptions.
import load from './physics.mjs';

export class Physics {
  static async load() {
    return new Physics(await load());
  }

  constructor(wasm) {
    this.wasm = wasm;
    this.hasLaw = false;
  }

  // Makes a scene; throws an Error with rbres's words where there is no such scene.
  start({ bodies, spheres, boxes, capsules, restitution, friction, gravity, seed }) {
    this.guarded(() => this.wasm._web_start(bodies, spheres, boxes, capsules, restitution, friction, gravity, seed));
    this.bodies = Array.from({ length: bodies }, (_, i) => {
      const kind = this.wasm._web_shape(i);
      return { kind, sizes: [...this.numbers(this.wasm._web_sizes(), 3)] };
    });
  }

  // A law of contacts as rbres saved it.
  loadLaw(bytes) {
    const file = 'law.safetensors';
    this.wasm.FS.writeFile(file, bytes);
    this.guarded(() => this.wasm.ccall('web_load_law', null, ['string'], [file]));
    this.hasLaw = true;
  }

  // One sixtieth of a second on; false where a number is no longer finite.
  step() { return Boolean(this.wasm._web_step()); }
  followGhost() { this.wasm._web_follow(); }
  restartGhost() { this.wasm._web_restart_ghost(); }

  get states() { return this.numbers(this.wasm._web_states(), 13 * this.bodies.length); }
  get ghostStates() { return this.numbers(this.wasm._web_ghost_states(), 13 * this.bodies.length); }
  get time() { return this.wasm._web_time(); }
  get energy() { return this.wasm._web_energy(); }
  get error() { return this.wasm._web_error(); }
  get impacts() { return this.wasm._web_impacts(); }
  // Positions of the points where bodies touch.
  get points() { const count = this.wasm._web_find_points(); return this.numbers(this.wasm._web_points(), 3 * count); }

  grip(body, point) { this.wasm._web_grip(body, ...point); }
  pull(point) { this.wasm._web_pull(...point); }
  letGo() { this.wasm._web_grip(-1, 0, 0, 0); }
  kick(body, velocity) { this.wasm._web_kick(body, ...velocity); }

  // Memory may grow and move: views are made on use.
  numbers(at, count) { return new Float64Array(this.wasm.HEAPF64.buffer, at, count); }

  // An exception leaves the stack as it was when it was thrown.
  guarded(f) {
    const top = this.wasm.stackSave();
    try {
      f();
    } finally {
      this.wasm.stackRestore(top);
    }
  }
}
