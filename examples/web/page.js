import { Physics } from './physics.js';
import { Plot } from './plot.js';
import { Recording } from './recording.js';
import { View } from './view.js';

const $ = (id) => document.getElementById(id);
const frame = 1 / 60;  // s
const stepsPerFrame = 4;  // as in world.hpp

const sliders = ['bodies', 'restitution', 'friction', 'gravity', 'seed'];
const shapes = ['spheres', 'boxes', 'capsules'];
const standard = { bodies: 14, restitution: 0.5, friction: 0.3, gravity: 9.81, seed: 1, spheres: true, boxes: true, capsules: true, law: false, points: false, run: true };

const physics = await Physics.load();
const view = new View($('view'));
const plots = { energy: new Plot($('energy'), '#5ddf9b'), contacts: new Plot($('contacts'), '#ff6b8b'), cost: new Plot($('cost'), '#4cc9f0'), error: new Plot($('error'), '#ffd166') };
let scene = { ...standard };
let recording = null;
let frames = 0;  // simulated since the start
let cost = 0;  // of a step, smoothed, us
let stale = true;  // what the picture shows

function say(text) { $('message').textContent = text; }

// What refuses says so on the page.
async function attempt(f) {
  try {
    await f();
    return true;
  } catch (error) {
    say(error.message);
    return false;
  }
}

// The scene as the address says it: #bodies=20&gravity=1.62; what it does not name is standard.
function readAddress() {
  const words = new URLSearchParams(location.hash.slice(1));
  const read = { ...standard };
  for (const [name, value] of Object.entries(standard)) {
    if (!words.has(name)) continue;
    if (typeof value === 'boolean') read[name] = words.get(name) === '1';
    else if (words.get(name) !== '' && Number.isFinite(Number(words.get(name)))) read[name] = Number(words.get(name));
  }
  return read;
}
function address() {
  const words = new URLSearchParams();
  for (const [name, value] of Object.entries(standard))
    if (scene[name] !== value) words.set(name, typeof value === 'boolean' ? Number(scene[name]) : scene[name]);
  return '#' + words;
}

function showControls() {
  for (const id of sliders) {
    $(id).value = scene[id];
    $(id).parentElement.querySelector('output').textContent = scene[id];
  }
  for (const id of [...shapes, 'law', 'points']) $(id).checked = scene[id];
  $('run').textContent = scene.run ? 'Pause' : 'Run';
  $('error-figure').hidden = !scene.law;
  $('restart').disabled = !scene.law;
}

function start() {
  physics.start(scene);
  view.setBodies(physics.bodies);
  for (const plot of Object.values(plots)) plot.clear();
  frames = 0;
  cost = 0;
  say('');
  measure();
}

// Takes over what the controls say; a scene that cannot be leaves everything as it was.
async function change(next) {
  const before = scene;
  scene = { ...scene, ...next };
  const restarts = [...sliders, ...shapes].some((name) => scene[name] !== before[name]);
  const done = await attempt(async () => {
    if (scene.law) await loadLaw();
    if (restarts) start();
    else say('');
  });
  if (!done) scene = before;
  history.replaceState(null, '', address());
  showControls();
  stale = true;
}

// The page's own law, where no other was opened.
async function loadLaw(bytes) {
  if (physics.hasLaw && !bytes) return;
  if (!bytes) {
    const answer = await fetch('law.safetensors');
    if (!answer.ok) throw new Error('law.safetensors: ' + answer.statusText);
    bytes = await answer.arrayBuffer();
  }
  physics.loadLaw(new Uint8Array(bytes));
}

function step() {
  const before = performance.now();
  const finite = physics.step();
  const spent = ((performance.now() - before) * 1e3) / stepsPerFrame;
  cost += (frames === 0 ? 1 : 0.1) * (spent - cost);
  ++frames;
  if (scene.law) physics.followGhost();
  if (!finite) {
    change({ run: false });
    say('A number is no longer finite: the run has ended.');
  }
  measure();
}

function measure() {
  stale = true;
  const time = physics.time;
  const values = { energy: physics.energy, contacts: physics.points.length / 3, cost, error: scene.law ? physics.error : 0 };
  for (const [name, value] of Object.entries(values)) plots[name].add(time, value);
  $('energy-text').textContent = values.energy.toFixed(1) + ' J';
  $('contacts-text').textContent = values.contacts + ', ' + physics.impacts + ' impacts';
  $('cost-text').textContent = cost.toFixed(0) + ' µs';
  $('error-text').textContent = (100 * values.error).toFixed(1) + ' cm';
}

// Throws a body up and towards the middle.
function throwBody() {
  if (view.chosen < 0) view.choose(0);
  const at = 13 * view.chosen, states = physics.states;
  physics.kick(view.chosen, [-1.2 * states[at], -1.2 * states[at + 1], 4.5]);
  change({ run: true });
}

async function open(file) {
  const bytes = await file.arrayBuffer();
  await attempt(async () => {
    if (file.name.endsWith('.safetensors')) {
      await loadLaw(bytes);
      await change({ law: true });
      say(file.name + ': learned law');
    } else {
      show(await Recording.read(bytes));
      say(file.name);
    }
  });
}

// Shows a recording in the place of the bodies, or the bodies again.
function show(next) {
  if (recording) view.recording.remove(recording.group);
  recording = next;
  if (next) {
    view.recording.add(next.group);
    next.playing = true;
    $('at').max = next.duration;
  } else {
    say('');
  }
  $('timeline').hidden = !next;
  view.solid.visible = view.room.visible = !next;
  stale = true;
}

function drawRecording(seconds) {
  if (recording.playing) stale = true;
  if (recording.playing) recording.show(recording.time >= recording.duration ? 0 : recording.time + seconds);
  $('at').value = recording.time;
  $('at-text').textContent = recording.time.toFixed(2) + ' s';
  $('play').textContent = recording.playing ? '❚❚' : '▶';
}

// Draws where something has changed: a page that rests costs nothing.
function draw() {
  if (!stale) return;
  stale = false;
  view.place(view.solid, physics.states);
  view.ghost.visible = scene.law && !recording;
  if (view.ghost.visible) view.place(view.ghost, physics.ghostStates);
  view.points.visible = scene.points && !recording;
  if (view.points.visible) view.placePoints(physics.points);
  $('time').textContent = physics.time.toFixed(2) + ' s';
  for (const plot of Object.values(plots)) plot.draw();
  view.draw();
}

const controls = {
  run: () => change({ run: !scene.run }),
  step: () => { change({ run: false }); step(); },
  reset: () => attempt(start),
  throw: throwBody,
  restart: () => { if (scene.law) physics.restartGhost(); plots.error.clear(); measure(); },
  share: () => attempt(async () => { await navigator.clipboard.writeText(location.href); say('The link is copied.'); }),
  play: () => { recording.playing = !recording.playing; },
  close: () => show(null),
};
for (const [id, act] of Object.entries(controls)) $(id).addEventListener('click', act);
for (const id of sliders) $(id).addEventListener('input', () => change({ [id]: Number($(id).value) }));
for (const id of [...shapes, 'law', 'points']) $(id).addEventListener('change', () => change({ [id]: $(id).checked }));
$('at').addEventListener('input', () => { recording.playing = false; recording.show(Number($('at').value)); stale = true; });
$('file').addEventListener('change', () => { if ($('file').files.length > 0) open($('file').files[0]); $('file').value = ''; });
view.controls.addEventListener('change', () => { stale = true; });
new ResizeObserver(() => { stale = true; }).observe($('view'));
addEventListener('hashchange', () => change(readAddress()));

const keys = {
  ' ': controls.run, s: controls.step, r: controls.reset, t: throwBody, g: controls.restart,
  n: () => { view.choose((view.chosen + 1) % physics.bodies.length); stale = true; },
};
addEventListener('keydown', (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const turns = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.06], ArrowDown: [0, 0.06] }[event.key];
  if (turns && event.target === $('view')) {
    view.turn(...turns);
    stale = true;
    event.preventDefault();
    return;
  }
  const act = keys[event.key.toLowerCase()];
  // A button or a box that has the focus takes the space bar for itself.
  if (!act || (event.key === ' ' && event.target.matches('button, input'))) return;
  event.preventDefault();
  act();
});

// The pointer holds a body with a spring, and lets it go with the velocity that it has.
let held = null;
$('view').addEventListener('pointerdown', (event) => {
  const hit = held || recording ? null : view.pick(event);
  if (!hit) return;
  held = event.pointerId;
  view.controls.enabled = false;
  $('view').setPointerCapture(held);
  $('view').classList.add('holding');
  view.choose(hit.body);
  physics.grip(hit.body, hit.point);
  change({ run: true });
}, { capture: true });
$('view').addEventListener('pointermove', (event) => {
  const at = event.pointerId === held ? view.follow(event) : null;
  if (at) physics.pull(at);
});
for (const end of ['pointerup', 'pointercancel']) {
  $('view').addEventListener(end, (event) => {
    if (event.pointerId !== held) return;
    held = null;
    physics.letGo();
    view.controls.enabled = true;
    $('view').classList.remove('holding');
  });
}

let last = performance.now(), due = 0;
function tick(now) {
  const seconds = Math.min((now - last) / 1000, 0.05);
  last = now;
  if (recording) {
    drawRecording(seconds);
  } else if (scene.run) {
    for (due += seconds; due >= frame && scene.run; due -= frame) step();
  }
  draw();
  requestAnimationFrame(tick);
}

const wanted = readAddress();
if (!(await attempt(start))) throw new Error('the standard scene is refused');
await change(wanted);
// For the console, and for tests.
globalThis.rbres = { physics, view, get scene() { return scene; }, get frames() { return frames; }, get recording() { return recording; } };
requestAnimationFrame((now) => { last = now; tick(now); });
document.body.dataset.ready = '';
