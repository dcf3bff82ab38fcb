// Which building is under the pointer: a ray through what is shown, so that no picture has to be drawn for it.
import { FIELD } from './camera.js';

/** @import { Things } from './types.js' */
/** @import { Camera } from './camera.js' */
/** @import { Viewer } from './viewer.js' */

export const NEAR_ENOUGH = 4;

// Answers for a place (x, y, z) its distance from the pointer in pixels and its depth.
/** @param {Camera} camera @param {number} width @param {number} height @param {number} x @param {number} y */
export function sightOf(camera, width, height, x, y) {
  const { right, up, back } = camera.axes(), eye = camera.eye(), tall = Math.tan(FIELD / 2);
  const dot = (/** @type {number[]} */ axis, /** @type {number} */ px, /** @type {number} */ py, /** @type {number} */ pz) => axis[0] * (px - eye[0]) + axis[1] * (py - eye[1]) + axis[2] * (pz - eye[2]);
  const seen = (/** @type {number} */ px, /** @type {number} */ py, /** @type {number} */ pz) => {
    const depth = -dot(back, px, py, pz), reach = camera.flat ? camera.distance : depth;
    const step = 2 * reach * tall / height;
    return { aside: dot(right, px, py, pz) / step + width / 2 - x, down: height / 2 - dot(up, px, py, pz) / step - y, depth, ahead: camera.flat || depth > 0 };
  };
  const [across, over] = [(x - width / 2) * 2 * tall / height, (height / 2 - y) * 2 * tall / height];
  const bent = (/** @type {number} */ axis) => right[axis] * across + up[axis] * over;
  const axes = [0, 1, 2];
  return camera.flat
    ? { seen, from: axes.map(axis => eye[axis] + camera.distance * bent(axis)), along: back.map(value => -value) }
    : { seen, from: eye, along: axes.map(axis => bent(axis) - back[axis]) };
}

// How far along the ray a triangle (nine numbers from `at`) is hit; Infinity when it is not.
/** @param {Float32Array | Float64Array} xyz @param {number} at @param {number[]} from @param {number[]} along */
export function hitTriangle(xyz, at, [fx, fy, fz], [dx, dy, dz]) {
  const ax = xyz[at], ay = xyz[at + 1], az = xyz[at + 2];
  const ux = xyz[at + 3] - ax, uy = xyz[at + 4] - ay, uz = xyz[at + 5] - az, vx = xyz[at + 6] - ax, vy = xyz[at + 7] - ay, vz = xyz[at + 8] - az;
  const px = dy * vz - dz * vy, py = dz * vx - dx * vz, pz = dx * vy - dy * vx, size = ux * px + uy * py + uz * pz;
  if (Math.abs(size) < 1e-12) return Infinity;
  const tx = fx - ax, ty = fy - ay, tz = fz - az, one = (tx * px + ty * py + tz * pz) / size;
  if (one < 0 || one > 1) return Infinity;
  const qx = ty * uz - tz * uy, qy = tz * ux - tx * uz, qz = tx * uy - ty * ux, two = (dx * qx + dy * qy + dz * qz) / size;
  return two < 0 || one + two > 1 ? Infinity : (vx * qx + vy * qy + vz * qz) / size;
}

// The number of the building nearest to the eye under a place of the canvas (pixels of the page); 0 for none.
/** @param {Viewer} viewer @param {number} x @param {number} y */
export function pickBuilding(viewer, x, y) {
  const { camera, canvas, layers, look, scene } = viewer, { triangles, points, prints } = scene;
  const { seen, from, along } = sightOf(camera, canvas.clientWidth, canvas.clientHeight, x, y);
  const onSide = viewer.epochs.seenAt(x);
  let best = 0, nearest = Infinity;
  const offer = (/** @type {Things} */ { building: buildings, epochs }, /** @type {number} */ number, /** @type {number} */ depth) => {
    const building = buildings[number];
    if (building && onSide(epochs[number]) && depth < nearest && !(look.only && look.chosen && building !== look.chosen)) [best, nearest] = [building, depth];
  };
  const shownTriangles = layers.models.shown, shownPoints = layers.points.shown, shownPrints = layers.prints.shown;
  for (let place = 0; place < shownTriangles.length; place += 3) {
    const depth = hitTriangle(triangles.xyz, 3 * shownTriangles[place], from, along);
    if (camera.flat || depth > 0) offer(triangles, shownTriangles[place] / 3, depth);
  }
  for (const point of shownPoints) {
    if (!points.building[point]) continue;
    const { aside, down, depth, ahead } = seen(points.xyz[3 * point], points.xyz[3 * point + 1], points.xyz[3 * point + 2]);
    if (ahead && Math.hypot(aside, down) < NEAR_ENOUGH) offer(points, point, depth);
  }
  for (let place = 0; place < shownPrints.length; place += 2) {
    const [one, two] = [0, 1].map(end => 3 * shownPrints[place + end]).map(at => seen(prints.xyz[at], prints.xyz[at + 1], prints.xyz[at + 2]));
    if (!one.ahead || !two.ahead) continue;
    const [x1, y1, x2, y2] = [one.aside, one.down, two.aside - one.aside, two.down - one.down];
    const share = Math.max(0, Math.min(1, -(x1 * x2 + y1 * y2) / (x2 * x2 + y2 * y2 || 1)));
    if (Math.hypot(x1 + share * x2, y1 + share * y2) < NEAR_ENOUGH) offer(prints, shownPrints[place] / 2, one.depth);
  }
  return best;
}
