// Soft shade, once for a scene: ground near what rises is darker, and walls are towards their foot.
/** @import { Grid, Things, Triangles } from './types.js' */

export const DARKEST_GROUND = 0.5, FOOT = 0.74, FOOT_HEIGHT = 6, PLAN_CELLS = 4e6;

// Heights of an epoch's upward faces over the cells of the terrain; −Infinity where there are none.
/** @param {Omit<Grid, "heights">} grid @param {Pick<Triangles, "xyz" | "kind" | "epochs" | "count">} triangles */
export function roofHeights({ rows, columns, cell, west, north, epoch }, { xyz, kind, epochs, count }) {
  const heights = new Float32Array(rows * columns).fill(-Infinity);
  for (let number = 0, at = 0; number < count; number++, at += 9) {
    if (kind[number] === 1 || epochs[number] !== epoch) continue;
    const [x, y, z] = [0, 1, 2].map(axis => [xyz[at + axis], xyz[at + 3 + axis], xyz[at + 6 + axis]]);
    const across = x.map(value => (value - west) / cell - 0.5), down = y.map(value => (north - value) / cell - 0.5), top = Math.max(...z);
    const size = (across[1] - across[0]) * (down[2] - down[0]) - (across[2] - across[0]) * (down[1] - down[0]);
    if (!size) continue;
    for (let row = Math.max(0, Math.ceil(Math.min(...down))); row <= Math.min(rows - 1, Math.max(...down)); row++) {
      for (let column = Math.max(0, Math.ceil(Math.min(...across))); column <= Math.min(columns - 1, Math.max(...across)); column++) {
        const one = ((column - across[0]) * (down[2] - down[0]) - (across[2] - across[0]) * (row - down[0])) / size;
        const two = ((across[1] - across[0]) * (row - down[0]) - (column - across[0]) * (down[1] - down[0])) / size;
        const place = row * columns + column;
        if (one >= 0 && two >= 0 && one + two <= 1 && top > heights[place]) heights[place] = top;
      }
    }
  }
  return heights;
}

// How bright (0 to 1) every vertex of the ground is: the mean over eight directions of the sky that is left.
/** @param {Grid} terrain @param {Pick<Triangles, "xyz" | "kind" | "epochs" | "count">} triangles */
export function groundShade(terrain, triangles) {
  const { rows, columns, cell, heights } = terrain, tops = roofHeights(terrain, triangles), bright = new Float32Array(rows * columns).fill(1);
  const ways = [[0, 1], [1, 1], [1, 0], [1, -1], [0, -1], [-1, -1], [-1, 0], [-1, 1]], steps = [1, 2, 3, 5, 8];
  for (let row = 0, place = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++, place++) {
      let sky = 0;
      for (const [down, across] of ways) {
        let steepest = 0;
        for (const step of steps) {
          const i = row + step * down, j = column + step * across;
          if (i < 0 || j < 0 || i >= rows || j >= columns) break;
          const rise = Math.max(tops[i * columns + j], heights[i * columns + j] < 1e6 ? heights[i * columns + j] : -Infinity) - heights[place];
          steepest = Math.max(steepest, rise / (step * cell * Math.hypot(down, across)));
        }
        sky += 1 / (1 + steepest * steepest); // the square of the cosine of the horizon's elevation
      }
      bright[place] = DARKEST_GROUND + (1 - DARKEST_GROUND) * sky / ways.length;
    }
  }
  return bright;
}

// Which points (1 or 0) lie in the plan of a roof: of what is no building, they would hide it.
/** @param {Pick<Things, "xyz" | "epochs" | "count">} points @param {Pick<Triangles, "xyz" | "kind" | "epochs" | "count">} triangles */
export function pointsOverRoofs({ xyz, epochs, count }, triangles) {
  const low = [Infinity, Infinity], high = [-Infinity, -Infinity], over = new Uint8Array(count);
  for (let place = 0; place < triangles.xyz.length; place += 3) {
    for (const axis of [0, 1]) {
      low[axis] = Math.min(low[axis], triangles.xyz[place + axis]);
      high[axis] = Math.max(high[axis], triangles.xyz[place + axis]);
    }
  }
  if (!(high[0] > low[0] && high[1] > low[1])) return over;
  const cell = Math.max(0.5, Math.sqrt((high[0] - low[0]) * (high[1] - low[1]) / PLAN_CELLS)), [west, north] = [low[0], high[1]];
  const columns = Math.ceil((high[0] - low[0]) / cell), rows = Math.ceil((high[1] - low[1]) / cell);
  const tops = new Map([...new Set(epochs)].map(epoch => [epoch, roofHeights({ rows, columns, cell, west, north, epoch }, triangles)]));
  for (let number = 0; number < count; number++) {
    const column = Math.floor((xyz[3 * number] - west) / cell), row = Math.floor((north - xyz[3 * number + 1]) / cell);
    over[number] = column >= 0 && row >= 0 && column < columns && row < rows && (tops.get(epochs[number]) ?? [])[row * columns + column] > -Infinity ? 1 : 0;
  }
  return over;
}

// How bright a corner of a wall is, by its height over the building's lowest place.
/** @param {number} over */
export const wallShade = over => FOOT + (1 - FOOT) * Math.min(1, Math.max(0, over / FOOT_HEIGHT));
