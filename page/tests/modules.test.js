// What needs no browser: packed arrays, cameras, rays, sections, scenes and figures.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { deflateSync } from 'node:zlib';
import { metres, unpackArray, unpackRows } from '../src/arrays.js';
import { Camera, FIELD } from '../src/camera.js';
import { CELLS, City } from '../src/city.js';
import { modelColours, scaleOf } from '../src/colours.js';
import { Painter } from '../src/draw.js';
import { figure } from '../src/page.js';
import { hitTriangle, sightOf } from '../src/pick.js';
import { cutUpright } from '../src/profile.js';
import { boxOf, joinThings, shuffled, slopes, terrainMesh, without } from '../src/scene.js';
import { remembered, worstFirst } from '../src/table.js';

const BOX = { low: [-50, -40, 0], high: [50, 40, 20] };
const close = (/** @type {number} */ one, /** @type {number} */ two, far = 1e-6) => assert.ok(Math.abs(one - two) <= far, `${one} is not ${two}`);

test('arrays come back out of base64, deflate and planes of bytes', async () => {
  const values = Int32Array.from([1, -2, 300, -70000]), bytes = new Uint8Array(values.buffer), planes = Uint8Array.from({ length: 16 }, (_, place) => bytes[4 * (place % 4) + Math.floor(place / 4)]);
  assert.deepEqual(await unpackArray({ type: 'int32', data: deflateSync(planes).toString('base64') }), values);
  assert.deepEqual([...metres(Int32Array.from([1500]))], [1.5]);
  const rows = await unpackRows({ names: ['id', 'area_m2'], data: deflateSync(JSON.stringify([['a', 'b'], [1, null]])).toString('base64') });
  assert.deepEqual(rows, [{ id: 'a', area_m2: 1 }, { id: 'b', area_m2: null }]);
});

test('a place is seen where the camera projects it, flat or not', () => {
  for (const flat of [false, true]) {
    const camera = new Camera(BOX, 1.5);
    Object.assign(camera, { flat });
    const place = [12, -7, 5], matrix = camera.matrix(1.5), at = (/** @type {number} */ row) => [...place, 1].reduce((sum, value, column) => sum + value * matrix[4 * column + row], 0);
    const { aside, down } = sightOf(camera, 900, 600, 0, 0).seen(place[0], place[1], place[2]);
    close(aside, 450 * (1 + at(0) / at(3)), 0.01);
    close(down, 300 * (1 - at(1) / at(3)), 0.01);
    const { from, along } = sightOf(camera, 900, 600, aside, down), far = (place[2] - from[2]) / along[2];
    close(from[0] + far * along[0], place[0], 1e-3);
    close(from[1] + far * along[1], place[1], 1e-3);
  }
});

test('the camera opens with the whole box in sight, and from above a metre has its pixels', () => {
  const camera = new Camera(BOX, 1.5), { seen } = sightOf(camera, 900, 600, 0, 0);
  for (let corner = 0; corner < 8; corner++) {
    const at = [0, 1, 2].map(axis => (corner >> axis & 1 ? BOX.high : BOX.low)[axis]), { aside, down } = seen(at[0], at[1], at[2]);
    assert.ok(aside >= 0 && aside <= 900 && down >= 0 && down <= 600);
  }
  camera.above(false);
  camera.distance = 100 / (2 * Math.tan(FIELD / 2));
  close(camera.step(500), 0.2);
});

test('a ray hits a triangle at its distance, and misses beside it', () => {
  const corners = Float64Array.from([0, 0, 3, 4, 0, 3, 0, 4, 3]);
  close(hitTriangle(corners, 0, [1, 1, 10], [0, 0, -1]), 7);
  assert.equal(hitTriangle(corners, 0, [3, 3, 10], [0, 0, -1]), Infinity);
  assert.equal(hitTriangle(corners, 0, [1, 1, 10], [1, 0, 0]), Infinity);
});

test('a section has the heights of the slope that it cuts', () => {
  const pieces = cutUpright(Float32Array.from([0, -5, 0, 10, -5, 10, 5, 5, 5]), Uint32Array.from([0, 1, 2]), [0, 0, 0], [10, 0, 0], () => 'roof');
  assert.equal(pieces.length, 1);
  const [[s1, z1, s2, z2]] = pieces;
  close(s1, 2.5);
  close(z1, 2.5);
  close(s2, 7.5);
  close(z2, 7.5);
});

test('slopes, terrain and boxes are those of the geometry', () => {
  const { slope, azimuth } = slopes({ xyz: Float32Array.from([0, 0, 0, 1, 0, 0, 0, 1, 1]), count: 1 });
  close(slope[0], 45, 1e-4);
  close(azimuth[0], 180, 1e-4);
  const mesh = terrainMesh({ rows: 2, columns: 3, cell: 2, west: 0, north: 0, epoch: 0, heights: Float32Array.from([1, 1, 1, 1, 1, 2e6]) });
  assert.equal(mesh.details[0].length, 6, 'the cell with an unknown corner is left out');
  const grounds = [{ ...mesh, light: new Float32Array(6) }], none = { xyz: new Float32Array(0), building: new Uint32Array(0), epochs: new Uint8Array(0), count: 0 };
  assert.deepEqual(boxOf(/** @type {any} */ ({ grounds, triangles: none, points: none })).low, [1, -3, 0]);
});

test('a building is taken out of things, and another comes in', () => {
  const things = { xyz: Float32Array.from([0, 0, 0, 1, 1, 1, 2, 2, 2]), building: Uint32Array.from([1, 2, 1]), epochs: new Uint8Array(3), count: 3 };
  const rest = without(things, 1);
  assert.deepEqual([...rest.xyz], [1, 1, 1]);
  assert.equal(rest.count, 1);
  const all = joinThings([rest, without(things, 2)]);
  assert.deepEqual([...all.building], [2, 1, 1]);
  assert.equal(all.count, 3);
  assert.equal(without(without(things, 1), 2).count, 0);
});

test('the order of drawing is a permutation, the same every time', () => {
  assert.deepEqual(shuffled(1000), shuffled(1000));
  assert.deepEqual([...shuffled(1000)].sort((one, two) => one - two), [...Array(1000).keys()]);
});

test('figures have the digits that mean something', () => {
  assert.deepEqual([71460.51, 843.27, 33.24].map(value => figure(value, 'area_m2')), ['71,460', '843', '33.2']);
  assert.equal(figure(9.1949, 'measuredHeight'), '9.19');
  assert.equal(figure(-0.001, 'h_ground'), '0.00');
  assert.deepEqual([null, 4, 'flat'].map(value => figure(value)), ['', '4', 'flat']);
});

test('legends have high before medium before low, and colours of missing values are grey', () => {
  const rows = ['low', 'high', 'medium'].map(trust => ({ id: trust, trust }));
  assert.deepEqual(modelColours('trust', /** @type {any} */ ({ rows, triangles: {} })).legend.words?.map(([word]) => word), ['high', 'medium', 'low']);
  assert.deepEqual(scaleOf(['#000000', '#ffffff'], 0, 1, 'm').colour(NaN), [139, 139, 139]);
});

test('buildings without a model come first, then by trust; nothing is remembered where there is no storage', () => {
  assert.deepEqual(worstFirst([{ id: 'a', lod: '2.2', trust_score: 0.9 }, { id: 'b', lod: null }, { id: 'c', lod: '2.2', trust_score: 0.2 }]), [1, 2, 0]);
  assert.deepEqual(remembered('columns', ['lod']), ['lod']);
});

test('the roof of a cell has the area of its buildings, and lies in its square', () => {
  const squares = [[0, 0, 480, 480, 3], [480, 0, 960, 480, 1]], corners = /** @type {number[]} */ ([]), places = [[10, 10, 10, 6], [22, 12, 4, 4], [300, 400, 8, 5], [500, 20, 9, 9]];
  for (const [x, y, wide, deep] of places) corners.push(x, y, x + wide, y, x + wide, y + deep, x, y + deep);
  const city = Object.assign(Object.create(City.prototype), { squares, corners, heights: places.flatMap(() => [0, 6]), square: [0, 0, 0, 1], order: [0, 1, 2, 3] });
  for (const side of CELLS) {
    const { xyz, building, count, first } = city.roofs(side);
    assert.deepEqual([count, first], [6, [0, 4, 6]]);
    assert.deepEqual([...building], [1, 1, 3, 3, 4, 4]);
    let area = 0;
    for (let at = 0; at < xyz.length; at += 9) area += Math.abs((xyz[at + 3] - xyz[at]) * (xyz[at + 7] - xyz[at + 1]) - (xyz[at + 4] - xyz[at + 1]) * (xyz[at + 6] - xyz[at])) / 2;
    close(area, places.reduce((sum, [, , wide, deep]) => sum + wide * deep, 0), 1e-3);
  }
});

test('blocks out of sight are left out, far ones are coarse, and neighbours of one way are one draw', () => {
  const camera = new Camera(BOX, 1.5), sight = { matrix: camera.matrix(1.5), eye: camera.eye(), step: camera.step(600), distance: camera.distance, flat: false }, painter = Object.assign(Object.create(Painter.prototype), { sight });
  close(painter.stepAt([-1, -1, 0], [1, 1, 1]), camera.step(600), 0.1 * camera.step(600));
  assert.ok(Number.isNaN(painter.stepAt([1e5, 1e5, 0], [1e5 + 1, 1e5 + 1, 1])));
  const [fine, coarse] = [{ numbers: 1 }, { numbers: 2 }], ways = (/** @type {number} */ first) => [{ list: fine, first: 30 * first, count: 30, size: 1e-3 }, { list: coarse, first: 6 * first, count: 6, size: 1e3 }];
  const blocks = [0, 1].map(number => ({ low: [number, 0, 0], high: [number + 1, 1, 1], ways: ways(number) }));
  const drawn = (/** @type {number} */ detail) => painter.piecesOf([...blocks, { low: [1e5, 0, 0], high: [1e5, 1, 1], ways: ways(2) }], detail).map((/** @type {any} */ piece) => [piece.list.numbers, piece.first, piece.count]);
  assert.deepEqual(drawn(0), [[1, 0, 60]]);
  assert.deepEqual(drawn(2), [[2, 0, 12]]);
});
