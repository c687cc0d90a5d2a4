// Opens the built page in a headless Chromium: it draws, each control does what it says, and its bodies move as those
// of the native program do, bit for bit. Usage: node test.mjs PAGE NATIVE [FOLDER for pictures]
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdtemp, readFile, rm } from 'node:fs/promises';
import { createServer } from 'node:http';
import { tmpdir } from 'node:os';
import { extname, join, normalize } from 'node:path';
import { chromium } from 'playwright-core';

const [folder, native, pictures] = process.argv.slice(2);
const types = { '.html': 'text/html', '.js': 'text/javascript', '.mjs': 'text/javascript', '.css': 'text/css', '.wasm': 'application/wasm' };

const server = createServer(async (request, answer) => {
  const path = normalize(new URL(request.url, 'http://localhost').pathname);
  try {
    const bytes = await readFile(join(folder, path === '/' ? 'index.html' : path));
    answer.writeHead(200, { 'content-type': types[extname(path)] ?? (path === '/' ? 'text/html' : 'application/octet-stream') });
    answer.end(bytes);
  } catch {
    answer.writeHead(404).end();
  }
});
await new Promise((done) => server.listen(0, '127.0.0.1', done));
const root = `http://127.0.0.1:${server.address().port}/`;

const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium',
  args: ['--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'],
});
const scratch = await mkdtemp(join(tmpdir(), 'rbres-web-'));
const faults = [];

async function openPage(hash = '', size = { width: 780, height: 320 }) {
  const page = await browser.newPage({ viewport: size });
  page.setDefaultTimeout(60_000);
  page.on('console', (message) => {
    if (['error', 'warning'].includes(message.type()) && !message.text().includes('GPU stall')) faults.push(message.text());
  });
  page.on('pageerror', (error) => faults.push(error.message));
  await page.goto(root + hash);
  await page.waitForSelector('[data-ready]', { state: 'attached' });
  return page;
}

// The page that most tests share, since loading takes a software renderer seconds.
let shared;
async function visit(hash) {
  shared ??= await openPage('#run=0');
  await shared.evaluate((to) => { location.hash = to; }, hash);
  await drawn(shared);
  await shared.click('#reset');
  return shared;
}

const frames = (page) => page.evaluate(() => rbres.frames);
const states = (page) => page.evaluate(() => [...rbres.physics.states]);
const set = (page, id, value) => page.locator('#' + id).fill(String(value));
const drawn = (page) => page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
// The colours of the picture's pixels, 4 bits a channel, and how many pixels have each.
const picture = (page) => page.evaluate(() => {
  const view = document.getElementById('view'), copy = document.createElement('canvas');
  copy.width = view.width;
  copy.height = view.height;
  const draw = copy.getContext('2d');
  draw.drawImage(view, 0, 0);
  return [...draw.getImageData(0, 0, copy.width, copy.height).data];
});
const differing = (a, b) => {
  let count = 0;
  for (let i = 0; i < a.length; i += 4) if (Math.abs(a[i] - b[i]) + Math.abs(a[i + 1] - b[i + 1]) + Math.abs(a[i + 2] - b[i + 2]) > 30) ++count;
  return (4 * count) / a.length;
};
// The share of pixels with a strong colour, as bodies have and the room has not.
const coloured = (pixels) => {
  let count = 0;
  for (let i = 0; i < pixels.length; i += 4) {
    const most = Math.max(pixels[i], pixels[i + 1], pixels[i + 2]), least = Math.min(pixels[i], pixels[i + 1], pixels[i + 2]);
    if (most > 110 && most - least > 0.45 * most) ++count;
  }
  return (4 * count) / pixels.length;
};
// Hexadecimal floating-point numbers as printf("%a") writes them.
function number(text) {
  const [, sign, whole, fraction = '', exponent] = /^(-?)0x([01])(?:\.([0-9a-f]+))?p([+-]\d+)$/.exec(text);
  const size = parseInt(whole + fraction, 16) * 2 ** (-4 * fraction.length) * 2 ** Number(exponent);
  return sign ? -size : size;
}

const tests = {
  async 'draws bodies, which move when it runs and stand still when it pauses'() {
    const page = await visit('#run=0');
    await drawn(page);
    const first = await picture(page);
    assert.ok(coloured(first) > 0.01, `bodies on ${coloured(first)} of the picture`);
    await drawn(page);
    assert.equal(differing(first, await picture(page)), 0);
    assert.equal(await frames(page), 0);
    await page.click('#run');
    await page.waitForFunction(() => rbres.frames > 20);
    await page.click('#run');
    await drawn(page);
    assert.ok(differing(first, await picture(page)) > 0.01);
    const at = await frames(page);
    await drawn(page);
    assert.equal(await frames(page), at);
    await visit('#run=0&bodies=1&boxes=0&capsules=0');
    await drawn(page);
    assert.ok(coloured(await picture(page)) < 0.5 * coloured(first));
    // The picture has the one ball where physics has it.
    for (let k = 0; k < 3; ++k) {
      for (let j = 0; j < 10; ++j) await page.click('#step');
      await drawn(page);
      const [x, y, width] = await page.evaluate(() => {
        const { view, physics } = rbres, at = view.camera.position.clone().fromArray(physics.states).project(view.camera);
        return [Math.round(((at.x + 1) / 2) * view.canvas.width), Math.round(((1 - at.y) / 2) * view.canvas.height), view.canvas.width];
      });
      const pixel = (await picture(page)).slice(4 * (y * width + x), 4 * (y * width + x) + 3);
      assert.ok(Math.max(...pixel) - Math.min(...pixel) > 60, `at ${x}, ${y}: ${pixel}; the floor is grey`);
    }
  },

  async 'moves bodies as the native program does, bit for bit'() {
    const page = await visit('#run=0');
    const scenes = [
      [14, true, true, true, 0.5, 0.3, 9.81, 1, 600],
      [9, true, false, false, 0.9, 0.1, 9.81, 2, 600],
      [12, false, true, false, 0, 0.6, 9.81, 3, 300],
      [8, false, false, true, 0.3, 0.5, 1.62, 4, 600],
      [30, true, true, true, 0.5, 0.3, 9.81, 5, 300],
    ];
    for (const [bodies, spheres, boxes, capsules, restitution, friction, gravity, seed, count] of scenes) {
      const scene = { bodies, spheres, boxes, capsules, restitution, friction, gravity, seed };
      const own = await page.evaluate(([scene, count]) => {
        rbres.physics.start(scene);
        for (let k = 0; k < count; ++k) if (!rbres.physics.step()) throw new Error('not finite');
        return [...rbres.physics.states];
      }, [scene, count]);
      const words = [bodies, Number(spheres), Number(boxes), Number(capsules), restitution, friction, gravity, seed, count].map(String);
      const theirs = execFileSync(native, words).toString().trim().split(/\s+/).map(number);
      assert.equal(own.length, 13 * bodies);
      assert.deepEqual(own, theirs, `scene ${JSON.stringify(scene)}`);
    }
  },

  async 'simulates 30 bodies faster than they move'() {
    const page = await visit('#run=0');
    const times = await page.evaluate(() => {
      rbres.physics.start({ bodies: 30, spheres: true, boxes: true, capsules: true, restitution: 0.5, friction: 0.3, gravity: 9.81, seed: 1 });
      return Array.from({ length: 600 }, () => { const start = performance.now(); rbres.physics.step(); return performance.now() - start; });
    });
    const mean = times.reduce((a, b) => a + b) / times.length, late = times.filter((ms) => ms > 1000 / 60).length;
    console.log(`  30 bodies, 10 s: ${mean.toFixed(2)} ms of simulation a frame, the longest ${Math.max(...times).toFixed(1)} ms, ${late} of 600 longer than 16.7 ms`);
    assert.ok(mean < 1000 / 60, `${mean} ms`);
  },

  async 'each control does what it says'() {
    const page = await visit('#run=0');
    await set(page, 'bodies', 5);
    assert.equal((await states(page)).length, 13 * 5);
    assert.ok(page.url().includes('bodies=5'));
    await page.uncheck('#spheres');
    await page.uncheck('#capsules');
    assert.deepEqual(await page.evaluate(() => rbres.physics.bodies.map((b) => b.kind)), [1, 1, 1, 1, 1]);
    await page.click('#boxes');  // the last one, which stays
    assert.match(await page.textContent('#message'), /shapes: expected one or more/);
    assert.ok(await page.isChecked('#boxes'));
    await page.check('#spheres');

    const first = await states(page);
    await page.click('#step');
    assert.equal(await frames(page), 1);
    assert.notDeepEqual(await states(page), first);
    await page.click('#reset');
    assert.equal(await frames(page), 0);
    assert.deepEqual(await states(page), first);
    await set(page, 'seed', 7);
    assert.notDeepEqual(await states(page), first);

    const fall = async () => page.evaluate(() => {
      const before = rbres.physics.states[9];
      rbres.physics.step();
      return (rbres.physics.states[9] - before) * 60;
    });
    for (const gravity of [0, 3.7]) {
      await set(page, 'gravity', gravity);
      assert.ok(Math.abs((await fall()) + gravity) < 1e-9);
    }
    const height = async () => page.evaluate(() => {  // of the first bounce of a ball
      let last = 0, bounced = false;
      for (let k = 0; k < 400; ++k) {
        rbres.physics.step();
        const speed = rbres.physics.states[9];
        if (!bounced && speed > 0 && rbres.physics.impacts > 0) bounced = true;
        if (bounced && speed <= 0) break;
        last = rbres.physics.states[2];
      }
      return last;
    });
    await page.uncheck('#boxes');
    await set(page, 'bodies', 1);
    await set(page, 'gravity', 9.81);
    await set(page, 'restitution', 0.2);
    const low = await height();
    await set(page, 'restitution', 0.9);
    assert.ok((await height()) > low + 0.1);
    const slide = async () => page.evaluate(() => {
      for (let k = 0; k < 240; ++k) rbres.physics.step();
      return Math.hypot(rbres.physics.states[10], rbres.physics.states[11], rbres.physics.states[12]);
    });
    await set(page, 'restitution', 0);
    await set(page, 'friction', 0);
    const spinning = await slide();
    await set(page, 'friction', 1);
    assert.notEqual(await slide(), spinning);
  },

  async 'keys run, step, reset, choose and throw'() {
    const page = await visit('#run=0');
    await page.focus('#view');
    await page.keyboard.press('s');
    assert.equal(await frames(page), 1);
    await page.keyboard.press('r');
    assert.equal(await frames(page), 0);
    const camera = () => page.evaluate(() => rbres.view.camera.position.toArray());
    const before = await camera();
    await page.keyboard.press('ArrowLeft');
    assert.notDeepEqual(await camera(), before);
    await page.keyboard.press('n');
    await page.keyboard.press('n');
    assert.equal(await page.evaluate(() => rbres.view.chosen), 1);
    const [rising, after] = await page.evaluate(() => {
      const speed = rbres.physics.states[13 + 9];
      window.dispatchEvent(new KeyboardEvent('keydown', { key: 't' }));
      return [speed, rbres.physics.states[13 + 9]];
    });
    assert.ok(Math.abs(after - rising - 4.5) < 1e-9);
    await page.waitForFunction(() => rbres.frames > 2);
    await page.keyboard.press(' ');
    assert.equal(await page.evaluate(() => rbres.scene.run), false);
  },

  async 'the pointer throws a body'() {
    const page = await visit('#run=0&gravity=0&bodies=1&boxes=0&capsules=0');
    const place = () => page.evaluate(() => {
      const view = rbres.view, at = view.solid.children[0].position.clone().project(view.camera);
      const box = view.canvas.getBoundingClientRect();
      return [box.left + ((at.x + 1) / 2) * box.width, box.top + ((1 - at.y) / 2) * box.height];
    });
    await drawn(page);
    const [x, y] = await place();
    await page.mouse.move(x, y);
    await page.mouse.down();
    assert.equal(await page.evaluate(() => rbres.view.chosen), 0);
    await page.mouse.move(x + 60, y - 30, { steps: 3 });
    await page.waitForFunction(() => rbres.frames > 30);
    const [now] = await place();
    await page.mouse.up();
    assert.ok(Math.abs(now - x - 60) < 25, `the body went ${now - x} pixels with the pointer, which went 60`);
    // Beside the bodies the pointer turns the view.
    const camera = () => page.evaluate(() => rbres.view.camera.position.toArray());
    const before = await camera();
    await page.mouse.move(20, 300);
    await page.mouse.down();
    await page.mouse.move(80, 300, { steps: 3 });
    await page.mouse.up();
    await drawn(page);
    assert.notDeepEqual(await camera(), before);
  },

  async 'takes its scene from the address'() {
    await visit('#run=0');
    const page = await openPage('#run=0&bodies=3&gravity=1.62&seed=9&spheres=0');
    assert.deepEqual(await page.evaluate(() => [rbres.scene.bodies, rbres.scene.gravity, rbres.scene.seed, rbres.scene.spheres]), [3, 1.62, 9, false]);
    assert.equal(await page.inputValue('#gravity'), '1.62');
    const wrong = await openPage('#run=0&bodies=99');
    assert.match(await wrong.textContent('#message'), /bodies: expected 1 to 32, found 99/);
    await wrong.close();
    await page.close();
  },

  async 'the learned law follows from the same start'() {
    const page = await visit('#run=0&law=1&bodies=6');
    const errors = await page.evaluate(() => Array.from({ length: 60 }, () => { rbres.physics.step(); rbres.physics.followGhost(); return rbres.physics.error; }));
    assert.ok(errors[0] < 1e-9, `${errors[0]} m in flight`);
    console.log(`  the law is ${errors.filter((_, k) => k % 15 === 14).map((e) => (100 * e).toFixed(1)).join(', ')} cm off after 0.25, 0.5, 0.75, 1 s`);
    assert.ok(errors[29] < 0.1 && errors[59] > 0);
    await drawn(page);
    const seen = await picture(page);
    await page.evaluate(() => { rbres.view.ghost.visible = false; });
    await page.click('#restart');
    assert.equal(await page.evaluate(() => rbres.physics.error), 0);
    await page.uncheck('#law');
    await drawn(page);
    assert.ok(differing(seen, await picture(page)) > 1e-3);
    await page.setInputFiles('#file', { name: 'wrong.safetensors', mimeType: '', buffer: Buffer.from('not a model') });
    await page.waitForFunction(() => document.getElementById('message').textContent.includes('law.safetensors'));
    await page.setInputFiles('#file', join(folder, 'law.safetensors'));
    await page.waitForFunction(() => rbres.scene.law);
  },

  async 'plays a glTF animation and takes the time from its line'() {
    const page = await visit('#run=0&bodies=4');
    const file = join(scratch, 'run.glb'), count = 60;
    const states = execFileSync(native, ['4', '1', '1', '1', '0.5', '0.3', '9.81', '1', String(count), file]).toString().trim().split(/\s+/).map(number);
    await page.setInputFiles('#file', file);
    await page.waitForFunction(() => rbres.recording);
    assert.ok(await page.isVisible('#timeline'));
    await page.waitForFunction(() => rbres.recording.time > 0.05);
    await set(page, 'at', 0.5);
    assert.equal(await page.evaluate(() => rbres.recording.time), 0.5);
    await drawn(page);
    const middle = await picture(page);
    await set(page, 'at', count / 60);
    await drawn(page);
    assert.ok(differing(middle, await picture(page)) > 1e-3);
    const places = await page.evaluate(() => [0, 1, 2, 3].map((i) => {
      const mesh = rbres.recording.group.getObjectByName('run_' + i);
      rbres.recording.group.updateMatrixWorld(true);
      return mesh.matrixWorld.elements.slice(12, 15);
    }));
    places.forEach((place, i) => place.forEach((x, d) => assert.ok(Math.abs(x - states[13 * i + d]) < 1e-5, `body ${i}: ${place}`)));
    await page.click('#close');
    assert.ok(!(await page.isVisible('#timeline')));
    await page.setInputFiles('#file', { name: 'wrong.glb', mimeType: '', buffer: Buffer.from('no animation') });
    await page.waitForFunction(() => document.getElementById('message').textContent !== '');
    assert.equal(await page.evaluate(() => rbres.recording), null);
  },

  async 'fits a phone'() {
    const page = await openPage('#bodies=6&run=0', { width: 390, height: 844 });
    assert.equal(await page.evaluate(() => document.documentElement.scrollWidth), 390);
    for (const id of ['run', 'step', 'reset', 'throw']) assert.ok((await page.locator('#' + id).boundingBox()).height >= 44);
    await page.evaluate(() => document.getElementById('share').scrollIntoView());
    assert.ok((await page.locator('#view').boundingBox()).height > 300);
    await page.close();
  },
};

let failed = 0;
for (const [name, test] of Object.entries(tests)) {
  const started = Date.now();
  try {
    await test();
    assert.deepEqual(faults.splice(0), [], 'the console');
    console.log(`passed: ${name} (${((Date.now() - started) / 1000).toFixed(1)} s)`);
  } catch (error) {
    ++failed;
    console.error(`FAILED: ${name}\n${error.stack.slice(0, 1500)}`);
    faults.length = 0;
  }
}
if (pictures) {
  for (const [name, size, hash] of [['web', { width: 1280, height: 800 }, '#bodies=16&seed=3&law=1&run=0'], ['web_phone', { width: 390, height: 844 }, '#run=0']]) {
    const page = await openPage(hash, size);
    for (let k = 0; k < 70; ++k) await page.evaluate(() => document.getElementById('step').click());
    await drawn(page);
    await page.screenshot({ path: join(pictures, name + '.png') });
    await page.close();
  }
}
await browser.close();
server.close();
await rm(scratch, { recursive: true });
console.log(`${Object.keys(tests).length - failed} passed, ${failed} failed`);
process.exit(failed ? 1 : 0);
