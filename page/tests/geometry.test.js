// Geometry of the operator's tools: snapping, splitting, carrying on, undo.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { axisOf, carriedOn, closingCorner, contains, divided, Draft, edgeMoved, movedAside, rectangle, ridgesOf, snap, twiceArea } from '../src/edit/geometry.js';

/** @import { Place } from '../src/edit/geometry.js' */

/** @type {Place[]} */
const SQUARE = [[0, 0], [10, 0], [10, 10], [0, 10]];
/** @param {number[] | null} one @param {number[]} two */
const near = (one, two) => one === null ? assert.fail('nothing is there') : one.forEach((value, axis) => assert.ok(Math.abs(value - two[axis]) < 1e-9, `${one} is not ${two}`));

test('a corner goes before an edge, an edge before the frame, the frame before a point', () => {
  /** @type {import('../src/edit/geometry.js').Targets} */
  const targets = { corners: [[10, 0]], edges: [[[0, 5], [20, 5]]], points: [[3, 9]], from: [0, 0], axis: [1, 0] };
  assert.deepEqual(snap([10.2, 0.1], targets, 0.5), { place: [10, 0], kind: 'corner' });
  assert.equal(snap([7, 5.2], targets, 0.5).kind, 'edge');
  assert.deepEqual(snap([7, 0.3], targets, 0.5), { place: [7, 0], kind: 'frame' });
  assert.deepEqual(snap([3.1, 9.1], targets, 0.5), { place: [3, 9], kind: 'point' });
  assert.deepEqual(snap([13, 9], targets, 0.5), { place: [13, 9], kind: '' });
});

test('where a line of the frame meets an edge, both hold', () => {
  const found = snap([0.2, 4.8], { edges: [[[-5, 5], [20, 5]]], from: [0, 0] }, 0.5);
  assert.equal(found.kind, 'edge and frame');
  near(found.place, [0, 5]);
});

test('three clicks make a rectangle, on either side of the first edge', () => {
  const ring = rectangle([0, 0], [4, 3], [0, 5]);
  assert.equal(Math.abs(twiceArea(ring)) / 2, 20);
  assert.equal(Math.abs(twiceArea(rectangle([0, 0], [4, 3], [0, -5]))) / 2, 20);
  near(ring[3], [-2.4, 3.2]);
});

test('a polygon of right angles is closed by one corner', () => {
  near(closingCorner([[0, 0], [6, 0], [6, 4]]), [0, 4]);
  near(closingCorner([[0, 0], [6, 0], [6, 4], [3, 4], [3, 8]]), [0, 8]);
  assert.equal(closingCorner([[0, 0], [6, 0], [6, 4], [0, 4]]), null);
});

test('a line divides a ring in two whose areas are the whole', () => {
  const parts = divided(SQUARE, [4, 2], [5, 8]) ?? assert.fail();
  assert.equal(Math.round((twiceArea(parts[0]) + twiceArea(parts[1])) * 1e6) / 1e6, twiceArea(SQUARE));
  assert.equal(divided(SQUARE, [20, 0], [21, 9]), null);
  /** @type {Place[]} */
  const hook = [[0, 0], [9, 0], [9, 9], [6, 9], [6, 3], [3, 3], [3, 9], [0, 9]];
  assert.equal(divided(hook, [-1, 6], [10, 6]), null);
});

test('an edge moves along its normal, its neighbours keep their directions', () => {
  const [[, one], [, two]] = edgeMoved([[0, 0], [10, 0], [12, 10], [0, 10]], 1, [12, 0]);
  assert.deepEqual(one.map(value => Math.round(value * 100) / 100), [12, 0]);
  assert.deepEqual(two.map(value => Math.round(value * 100) / 100), [14, 10]);
});

test('a place lies in a ring or not, and the frame is that of the longest edge', () => {
  assert.ok(contains([5, 5], SQUARE) && !contains([11, 5], SQUARE));
  near(axisOf([[0, 0], [1, 0], [4, 4], [0, 1]]), [0.6, 0.8]);
});

test('places are taken back and set again, until another one is set', () => {
  const draft = new Draft();
  for (const x of [1, 2, 3]) draft.add([x, 0]);
  assert.ok(draft.undo() && draft.undo());
  assert.ok(draft.redo());
  assert.deepEqual(draft.places, [[1, 0], [2, 0]]);
  draft.add([9, 9]);
  assert.ok(!draft.redo());
  assert.deepEqual(draft.places, [[1, 0], [2, 0], [9, 9]]);
});

test('an edge is carried on over a cut corner, over a step, and to a neighbour', () => {
  /** @type {Place[]} */
  const cut = [[0, 0], [8, 0], [10, 2], [10, 10], [0, 10]];
  /** @type {Place[]} */
  const step = [[0, 0], [6, 0], [6, 1], [10, 1], [10, 10], [0, 10]];
  assert.deepEqual(carriedOn(cut, 0, true, []), [[0, 0], [10, 0], [10, 10], [0, 10]]);
  assert.deepEqual(carriedOn(cut, 2, false, [])?.map(String).sort(), ['0,0', '0,10', '10,0', '10,10']);
  assert.deepEqual(carriedOn(step, 0, true, []), [[0, 0], [10, 0], [10, 10], [0, 10]]);
  assert.equal(carriedOn(SQUARE, 0, true, []), null);
  assert.deepEqual(carriedOn(SQUARE, 0, true, [[[13, -5], [13, 20]], [[12, 5], [12, 20]]]), [[0, 0], [13, 0], [13, 10], [0, 10]]);
  assert.equal(carriedOn(SQUARE, 0, true, [[[40, -5], [40, 20]]]), null, 'nothing is met within 25 m');
});

test('ridges are the level edges inside the outline, each once, and move aside', () => {
  /** @type {[number, number, number][][]} */
  const edges = [[[0, 5, 9], [10, 5, 9]], [[10, 5, 9], [0, 5, 9]], [[0, 0, 6], [10, 0, 6]], [[0, 0, 6], [5, 5, 9]]];
  assert.deepEqual(ridgesOf(edges, [SQUARE]), [[[10, 5], [0, 5]]]);
  assert.deepEqual(movedAside([[0, 5], [10, 5]], [3, 6]), [[0, 6], [10, 6]]);
});
