// Second opinions on what lapseam writes: the Khronos validator on GLB files and tiles, an independent reader on E57,
// three.js and 3d-tiles-renderer in headless Chromium on GLB and tileset.
// Usage: LAPSEAM_TOOL=… node --experimental-wasm-modules web_test.mjs validator|e57|browser
// Exit code 77 and a line that says so where packages or the browser are missing.

import {execFileSync, spawn, spawnSync} from 'node:child_process';
import fs from 'node:fs';
import http from 'node:http';
import os from 'node:os';
import path from 'node:path';
import {fileURLToPath} from 'node:url';

const here = path.dirname(fileURLToPath(import.meta.url));
const tool = process.env.LAPSEAM_TOOL ?? 'build/release/lapseam';
const folder = fs.mkdtempSync(path.join(os.tmpdir(), 'lapseam_web_'));
process.on('exit', () => fs.rmSync(folder, {recursive: true, force: true}));

function skip(reason) {
  console.log(`skipped: ${reason} (npm install in tests/web; apt-get install chromium)`);
  process.exit(77);
}

function check(condition, message) {
  if (condition) return;
  console.error(`FAILED: ${message}`);
  process.exit(1);
}

const run = (...args) => execFileSync(tool, [...args, '--progress', 'none'], {encoding: 'utf8'});
const at = (...names) => path.join(folder, ...names);

function makeRoom() {
  run('simulate', 'room', '-o', at('room'), '--views', '6', '--size', '160x120');
  run('integrate', at('room', 'scene.json'), '-o', at('room.glb'));
  run('integrate', at('room', 'scene.json'), '-o', at('room.ply'));
  run('tiles', at('room.ply'), '-o', at('tiles'), '--max-triangles', '4000');
}

async function testValidator() {
  const {default: validator} = await import('gltf-validator').catch(() => skip('gltf-validator is not installed'));
  makeRoom();
  const tiles = fs.readdirSync(at('tiles', 'tiles')).map((name) => at('tiles', 'tiles', name));
  check(tiles.length > 4, `only ${tiles.length} tiles`);
  const ways = {
    png: ['--material', 'matte'],
    jpeg: ['--texture-format', 'jpeg'],
    webp: ['--texture-format', 'webp', '--quantize'],
    meshopt: ['--meshopt'],
    small: ['--texture-format', 'webp', '--quantize', '--meshopt', '--material', 'matte'],
  };
  for (const [name, options] of Object.entries(ways))
    run('texture', at('room.ply'), at('room', 'scene.json'), '-o', at(`${name}.glb`), ...options);
  for (const file of [at('room.glb'), ...Object.keys(ways).map((name) => at(`${name}.glb`)), ...tiles]) {
    const report = await validator.validateBytes(new Uint8Array(fs.readFileSync(file)));
    const {numErrors, numWarnings} = report.issues;
    check(numErrors === 0 && numWarnings === 0, `${file}: ${JSON.stringify(report.issues.messages.slice(0, 3))}`);
  }
  console.log(`validator: room.glb in ${1 + Object.keys(ways).length} ways and ${tiles.length} tiles, no error, no warning`);
}

// Points of a PTX file, in the world; scan by scan, row by row from the top, which is the order of our E57 files.
function pointsOfPtx(file) {
  const lines = fs.readFileSync(file, 'utf8').trim().split('\n').map((line) => line.split(' ').map(Number));
  const points = [];
  for (let i = 0; i < lines.length;) {
    const columns = lines[i][0], rows = lines[i + 1][0], m = lines.slice(i + 6, i + 10);
    for (let v = 0; v < rows; ++v) {
      for (let u = 0; u < columns; ++u) {
        const [x, y, z] = lines[i + 10 + u * rows + rows - 1 - v];
        if (x === 0 && y === 0 && z === 0) continue;
        points.push([0, 1, 2].map((k) => x * m[0][k] + y * m[1][k] + z * m[2][k] + m[3][k]));
      }
    }
    i += 10 + columns * rows;
  }
  return points;
}

async function testE57() {
  const reader = await import('web-e57').catch((error) => skip(`web-e57 is not installed (${error.code})`));
  run('simulate', 'room', '-o', at('laser'), '--views', '2', '--sensor', 'laser', '--size', '120x60');
  run('simulate', 'room', '-o', at('camera'), '--views', '2', '--size', '64x48');
  for (const scene of ['laser', 'camera']) {
    run('convert', at(scene, 'scene.json'), '-o', at(`${scene}.e57`));
    run('convert', at(scene, 'scene.json'), '-o', at(`${scene}.ptx`));
    const text = reader.convertE57(new Uint8Array(fs.readFileSync(at(`${scene}.e57`))), 'XYZ');
    const theirs = text.trim().split('\n').map((line) => line.trim().split(/\s+/).map(Number));
    const ours = pointsOfPtx(at(`${scene}.ptx`));
    check(theirs.length === ours.length, `${theirs.length} points read, ${ours.length} written`);
    let worst = 0;
    for (let i = 0; i < ours.length; ++i)
      for (let k = 0; k < 3; ++k) worst = Math.max(worst, Math.abs(ours[i][k] - theirs[i][k]));
    // Half a micrometre of each coordinate in the scanner's frame.
    check(worst < 1e-6, `points are off by up to ${worst} m`);
    console.log(`web-e57: ${ours.length} points of ${scene}, up to ${worst} m apart`);
  }
}

function serve() {
  const types = {'.js': 'text/javascript', '.html': 'text/html', '.json': 'application/json'};
  const held = [];
  const server = http.createServer((request, response) => {
    const name = decodeURIComponent(new URL(request.url, 'http://localhost').pathname);
    // The browser looks at the page when all of it is loaded: a picture of it is held back until the page says that it has
    // drawn. A budget of virtual time would pass without waiting for decoders and workers.
    if (name === '/hold') {
      held.push(response);
      setTimeout(() => response.end(), kLongestWait_ms).unref();
      return;
    }
    if (name === '/done') {
      for (const waiting of held.splice(0)) waiting.end();
      response.end();
      return;
    }
    const file = name.startsWith('/data/') ? at(name.slice(6)) : path.join(here, name);
    fs.readFile(file, (error, bytes) => {
      response.writeHead(error ? 404 : 200, {'Content-Type': types[path.extname(file)] ?? 'application/octet-stream'});
      response.end(error ? '' : bytes);
    });
  });
  return new Promise((resolve) => server.listen(0, '127.0.0.1', () => resolve(server)));
}

const kLongestWait_ms = 120000;

function look(url, screenshot) {
  const common = ['--headless=new', '--no-sandbox', '--disable-gpu-sandbox', '--use-angle=swiftshader',
    '--enable-unsafe-swiftshader', '--window-size=640,480',
    `--user-data-dir=${at('profile')}`];
  return new Promise((resolve) => {
    const browser = spawn('chromium', [...common, `--screenshot=${screenshot}`, '--dump-dom', url]);
    let dom = '';
    browser.stdout.on('data', (data) => { dom += data; });
    browser.on('close', () => resolve(dom));
  });
}

async function testBrowser() {
  if (spawnSync('chromium', ['--version']).error) skip('chromium is not installed');
  for (const name of ['three', '3d-tiles-renderer'])
    if (!fs.existsSync(path.join(here, 'node_modules', name))) skip(`${name} is not installed`);
  makeRoom();
  const server = await serve();
  for (const [kind, url] of [['glb', 'data/room.glb'], ['tiles', 'data/tiles/tileset.json']]) {
    const picture = process.env.LAPSEAM_SCREENSHOTS ? path.join(process.env.LAPSEAM_SCREENSHOTS, `${kind}.png`)
                                                    : at(`${kind}.png`);
    const dom = await look(`http://127.0.0.1:${server.address().port}/viewer.html?kind=${kind}&url=/${url}`, picture);
    const result = /id="result">([^<]*)</.exec(dom)?.[1] ?? 'nothing';
    const [state, triangles, covered] = result.split(' ');
    check(state === 'done', `${kind}: the page says '${result}'`);
    check(Number(triangles) > 1000, `${kind}: ${triangles} triangles were drawn`);
    check(Number(covered) > 0.1, `${kind}: only ${covered} of the picture shows something`);
    check(fs.statSync(picture).size > 5000, `${kind}: the screenshot is empty`);
    console.log(`browser: ${kind}: ${triangles} triangles cover ${covered} of the picture`);
  }
  server.close();
}

const tests = {validator: testValidator, e57: testE57, browser: testBrowser};
check(tests[process.argv[2]], 'expected validator, e57 or browser');
await tests[process.argv[2]]();
process.exit(0);
