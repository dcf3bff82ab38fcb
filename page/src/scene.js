// A scene as typed arrays: points, triangles, lines and the ground, with all that is computed once.
import { metres } from './arrays.js';
import { page } from './page.js';
import { groundShade, pointsOverRoofs } from './shade.js';

/** @import { Arrays, Box, Grid, Ground, Numbers, Parts, Scene, Shapes, Terrain, Things, Triangles } from './types.js' */

// A scene out of arrays: what the page embeds, or one square of a city. It brings along all that is computed once.
/** @param {Arrays} arrays @param {Terrain} [terrain] @returns {Parts} */
export function readScene(arrays, terrain = page.terrain) {
  const order = shuffled(arrays.point_class.length), mixed = (/** @type {Numbers} */ values, /** @type {number} */ width) => /** @type {any} */ (reordered(values, order, width));
  const points = {
    xyz: metres(mixed(arrays.point_xyz, 3)), epochs: mixed(epochsOf(arrays.point_epoch, order.length), 1), classification: mixed(arrays.point_class, 1), building: mixed(arrays.point_building, 1),
    plane: mixed(arrays.point_plane, 1), distance: mixed(arrays.point_distance, 1), count: order.length, base: page.base,
  };
  const shapes = readShapes(arrays), grounds = readGrounds(arrays.terrain, terrain, shapes.triangles);
  return { ...shapes, points: { ...points, over: pointsOverRoofs(points, shapes.triangles) }, grounds };
}

// The models and outlines of arrays.
/** @param {Arrays} arrays @returns {Shapes} */
export function readShapes(arrays) {
  const triangles = {
    xyz: metres(arrays.triangle_xyz), building: arrays.triangle_building, lod: arrays.triangle_lod,
    epochs: epochsOf(arrays.triangle_epoch, arrays.triangle_lod.length), kind: arrays.triangle_kind, error: arrays.triangle_error, count: arrays.triangle_lod.length,
  };
  const edges = { xyz: metres(arrays.edge_xyz), building: arrays.edge_building, lod: arrays.edge_lod, epochs: epochsOf(arrays.edge_epoch, arrays.edge_lod.length), count: arrays.edge_lod.length };
  const prints = { xyz: metres(arrays.outline_xyz), building: arrays.outline_building, epochs: epochsOf(arrays.outline_epoch, arrays.outline_building.length), count: arrays.outline_building.length };
  return { triangles: { ...triangles, ...slopes(triangles) }, edges, prints };
}

/** @param {Uint8Array | undefined} values @param {number} count */
const epochsOf = (values, count) => values || new Uint8Array(count);

// The terrain of every epoch as a mesh, shaded by what stands on it.
/** @param {Int32Array} whole @param {Terrain} terrain @param {Pick<Triangles, "xyz" | "kind" | "epochs" | "count">} triangles @returns {Ground[]} */
export function readGrounds(whole, terrain, triangles) {
  const heights = metres(whole), cells = terrain.rows * terrain.columns;
  return (page.epochs ? [1, 2] : [0]).map((epoch, place) => {
    const grid = { ...terrain, epoch, heights: heights.subarray(place * cells, (place + 1) * cells) };
    return { ...terrainMesh(grid), light: groundShade(grid, triangles) };
  });
}

// Several scenes as one: their arrays end to end.
/** @param {Parts[]} scenes @returns {Parts} */
export function joined(scenes) {
  if (scenes.length === 1) return scenes[0];
  const join = (/** @type {'points' | 'triangles' | 'edges' | 'prints'} */ name) => joinThings(scenes.map(scene => scene[name]));
  return /** @type {Parts} */ ({ points: join('points'), triangles: join('triangles'), edges: join('edges'), prints: join('prints'), grounds: scenes.flatMap(scene => scene.grounds) });
}

// Things of one kind end to end.
/** @template {Things} T @param {T[]} parts @returns {T} */
export function joinThings(parts) {
  return /** @type {T} */ (Object.fromEntries(Object.entries(parts[0]).map(([name, first]) => {
    if (name === 'count') return [name, parts.reduce((sum, part) => sum + part.count, 0)];
    if (!ArrayBuffer.isView(first)) return [name, first];
    const all = new /** @type {any} */ (first).constructor(parts.reduce((sum, part) => sum + /** @type {any} */ (part)[name].length, 0));
    let place = 0;
    for (const part of parts) {
      all.set(/** @type {any} */ (part)[name], place);
      place += /** @type {any} */ (part)[name].length;
    }
    return [name, all];
  })));
}

// Things but those of a building.
/** @template {Things} T @param {T} things @param {number} building @returns {T} */
export function without(things, building) {
  const runs = /** @type {[number, number][]} */ ([]); // of what stays
  let count = 0;
  for (let number = 0, begun = 0; number <= things.count; number++) {
    if (number < things.count && things.building[number] !== building) continue;
    if (number > begun) runs.push([begun, number]);
    count += number - begun;
    begun = number + 1;
  }
  return /** @type {T} */ (Object.fromEntries(Object.entries(things).map(([name, values]) => {
    if (name === 'count') return [name, count];
    if (!ArrayBuffer.isView(values)) return [name, values];
    const all = /** @type {any} */ (values), width = all.length / Math.max(1, things.count), out = new all.constructor(width * count);
    let place = 0;
    for (const [from, to] of runs) {
      out.set(all.subarray(width * from, width * to), place);
      place += width * (to - from);
    }
    return [name, out];
  })));
}

// The numbers below `count` in an order without a pattern, the same every time: the first of them are a fair sample.
/** @param {number} count */
export function shuffled(count) {
  const order = Uint32Array.from({ length: count }, (_, place) => place);
  for (let place = count - 1, state = 1; place > 0; place--) {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    const other = Math.floor(state / 2 ** 32 * (place + 1)), kept = order[place];
    order[place] = order[other];
    order[other] = kept;
  }
  return order;
}

/** @template {Numbers} T @param {T} values @param {Uint32Array} order @param {number} width @returns {T} */
export function reordered(values, order, width) {
  const out = new /** @type {any} */ (values).constructor(width * order.length);
  for (let place = 0; place < order.length; place++) for (let k = 0; k < width; k++) out[width * place + k] = values[width * order[place] + k];
  return out;
}

// Slope and azimuth (degrees, clockwise from north) of every triangle.
/** @param {Pick<Things, "xyz" | "count">} triangles */
export function slopes({ xyz, count }) {
  const slope = new Float32Array(count), azimuth = new Float32Array(count);
  for (let number = 0, at = 0; number < count; number++, at += 9) {
    const ux = xyz[at + 3] - xyz[at], uy = xyz[at + 4] - xyz[at + 1], uz = xyz[at + 5] - xyz[at + 2];
    const vx = xyz[at + 6] - xyz[at], vy = xyz[at + 7] - xyz[at + 1], vz = xyz[at + 8] - xyz[at + 2];
    const east = uy * vz - uz * vy, north = uz * vx - ux * vz, up = ux * vy - uy * vx;
    slope[number] = Math.acos(Math.min(1, Math.abs(up) / (Math.hypot(east, north, up) || 1))) * 180 / Math.PI;
    azimuth[number] = (Math.atan2(east, north) * 180 / Math.PI + 360) % 360;
  }
  return { slope, azimuth };
}

/** @param {Uint32Array} numbers @param {number} times */
export const repeated = (numbers, times) => {
  const out = new Uint32Array(numbers.length * times);
  for (let place = 0; place < out.length; place++) out[place] = numbers[Math.floor(place / times)];
  return out;
};

// A terrain's vertices, and its triangles over every cell, every second, fourth and eighth.
/** @param {Grid} grid */
export function terrainMesh({ rows, columns, cell, west, north, heights, epoch }) {
  const position = new Float32Array(3 * rows * columns), missing = (/** @type {number} */ place) => heights[place] > 1e6;
  for (let row = 0, place = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++, place++) position.set([west + (column + 0.5) * cell, north - (row + 0.5) * cell, missing(place) ? 0 : heights[place]], 3 * place);
  }
  const stops = (/** @type {number} */ count, /** @type {number} */ step) => [...new Set([...Array(Math.ceil(count / step)).keys()].map(k => k * step).concat(Math.max(0, count - 1)))];
  const details = [1, 2, 4, 8].map(step => {
    const indices = /** @type {number[]} */ ([]), down = stops(rows, step), along = stops(columns, step);
    for (let i = 0; i + 1 < down.length; i++) {
      for (let j = 0; j + 1 < along.length; j++) {
        const [a, b, c, d] = [down[i] * columns + along[j], down[i + 1] * columns + along[j], down[i] * columns + along[j + 1], down[i + 1] * columns + along[j + 1]];
        if (!missing(a) && !missing(b) && !missing(c) && !missing(d)) indices.push(a, b, c, c, b, d);
      }
    }
    return Uint32Array.from(indices);
  });
  return { position, details, epoch };
}

/** @param {Parts} scene @returns {Box} */
export function boxOf(scene) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  const grow = (/** @type {Float32Array} */ xyz) => { for (let place = 0; place < xyz.length; place++) { low[place % 3] = Math.min(low[place % 3], xyz[place]); high[place % 3] = Math.max(high[place % 3], xyz[place]); } };
  for (const ground of scene.grounds) grow(ground.position);
  grow(scene.triangles.xyz);
  if (!Number.isFinite(low[0])) grow(scene.points.xyz);
  return Number.isFinite(low[0]) ? { low, high } : { low: [-5, -5, -5], high: [5, 5, 5] };
}

// A number for each building in each epoch.
/** @param {Things} things @param {number} number */
export const modelOf = ({ building, epochs }, number) => 3 * building[number] + epochs[number];

// The lowest and the highest place of every building, of its outline and models.
/** @param {Pick<Scene, "prints" | "triangles" | "rows">} scene @returns {Box[]} */
export function spotsOf({ prints, triangles, rows }) {
  const spots = rows.map(() => ({ low: [Infinity, Infinity, Infinity], high: [-Infinity, -Infinity, -Infinity] }));
  const grow = (/** @type {Float32Array} */ xyz, /** @type {Uint32Array} */ building, /** @type {number} */ width) => {
    for (let place = 0; place < xyz.length; place++) {
      const spot = spots[building[Math.floor(place / width)] - 1], axis = place % 3;
      spot.low[axis] = Math.min(spot.low[axis], xyz[place]);
      spot.high[axis] = Math.max(spot.high[axis], xyz[place]);
    }
  };
  grow(prints.xyz, prints.building, 6);
  grow(triangles.xyz, triangles.building, 9);
  return spots;
}
