// A city of any size: every building is a box, but in the squares near the eye, which are fetched as they come near.
import { metres, unpackAll, unpackRows } from './arrays.js';
import { QUALITIES } from './pace.js';
import { byId, messageOf, page } from './page.js';
import { joined, joinThings, readGrounds, readScene } from './scene.js';

/** @import { Arrays, Block, Layer, Parts, Place, Row, Scene, Things } from './types.js' */
/** @import { Viewer } from './viewer.js' */

export const BOX = 255, NEAR = 1500, NEAR_BUILDINGS = 4000, SQUARES_KEPT = 40, SUNK = 4;
// Sides (m) of the cells whose buildings are one roof while it moves far away; what a building measures there (m), and the least part of one.
export const CELLS = [30, 60, 120, 240], HOUSE = 15, PART = 3;
export const TRIANGLES_OF_BOX = 10, ROOF_OF_BOX = 8;
export const NO_TRIANGLES = { xyz: new Float32Array(0), kind: new Uint8Array(0), epochs: new Uint8Array(0), count: 0 };
const settings = () => /** @type {NonNullable<typeof page.city>} */ (page.city);

/** @param {string | number} name */
export const fetched = async name => {
  const answer = await fetch(`${settings().folder}/${name}.json`);
  if (!answer.ok) throw new Error(`${name}.json: the server answers with status ${answer.status}`);
  return answer.json();
};

export class City {
  /** @param {Arrays} boxes */
  constructor(boxes) {
    /** @type {Row[]} */
    this.rows = Array.from(boxes.box_lod, () => ({ id: '' }));
    this.squares = settings().squares;
    /** @type {Map<number, Parts>} */
    this.scenes = new Map();
    /** @type {number[]} */
    this.near = [];
    this.busy = false;
    /** @type {Viewer | null} */
    this.viewer = null;
    this.corners = metres(boxes.box_xy);
    this.heights = metres(boxes.box_z);
    /** @type {Uint8Array} */
    this.lods = boxes.box_lod;
    /** @type {Uint16Array} */
    this.square = boxes.box_square;
    this.grounds = readGrounds(boxes.terrain, page.terrain, NO_TRIANGLES);
    // Buildings square by square, and those among them that are boxes now.
    this.order = this.rows.map((_, number) => number).sort((one, two) => this.square[one] - this.square[two] || one - two);
    this.boxed = this.order;
    this.levels = CELLS.map(side => this.roofs(side));
    /** @type {Things} */
    this.far = joinThings(this.levels);
  }

  // One roof for all buildings of a cell in a square: as large as theirs together, in the shape of the largest; and the first triangle of each square.
  /** @param {number} side @returns {Things & { first: number[] }} */
  roofs(side) {
    const { corners, heights, square, squares, order } = this, first = [0], cells = /** @type {{ x: number, y: number, z: number, area: number, most: number, building: number }[]} */ ([]);
    for (let number = 0, at = 0; number < squares.length; number++) {
      const [west, south] = squares[number], there = new Map();
      for (; at < order.length && square[order[at]] === number; at++) {
        const building = order[at], from = 8 * building, [x, y] = [0, 1].map(axis => (corners[from + axis] + corners[from + 4 + axis]) / 2);
        const area = Math.max(1, Math.abs((corners[from + 2] - corners[from]) * (corners[from + 7] - corners[from + 1]) - (corners[from + 3] - corners[from + 1]) * (corners[from + 6] - corners[from])));
        const key = Math.floor((x - west) / side) + 1000 * Math.floor((y - south) / side), cell = there.get(key) ?? { x: 0, y: 0, z: 0, area: 0, most: 0, building };
        if (area > cell.most) Object.assign(cell, { most: area, building });
        for (const [name, value] of /** @type {const} */ ([['x', x], ['y', y], ['z', heights[2 * building + 1]]])) cell[name] += area * value;
        cell.area += area;
        there.set(key, cell);
      }
      cells.push(...there.values());
      first.push(2 * cells.length);
    }
    const count = 2 * cells.length, xyz = new Float32Array(9 * count), building = new Uint32Array(count);
    cells.forEach((cell, place) => {
      const from = 8 * cell.building, middle = [0, 1].map(axis => (corners[from + axis] + corners[from + 4 + axis]) / 2), grown = Math.sqrt(cell.area / cell.most);
      [0, 1, 2, 0, 2, 3].forEach((corner, vertex) => {
        const [x, y] = [0, 1].map(axis => grown * (corners[from + 2 * corner + axis] - middle[axis]));
        xyz.set([cell.x / cell.area + x, cell.y / cell.area + y, cell.z / cell.area], 18 * place + 3 * vertex);
      });
      building.fill(cell.building + 1, 2 * place, 2 * place + 2);
    });
    return { xyz, building, epochs: new Uint8Array(count), count, first };
  }

  // The triangle of the drawn scene that is the roof of a building's box, by the building's number.
  roofOf() {
    const roof = new Uint32Array(this.rows.length);
    this.boxed.forEach((number, place) => { roof[number] = TRIANGLES_OF_BOX * place + ROOF_OF_BOX; });
    return roof;
  }

  // What is drawn of the squares, each from fine to coarse: boxes, their roofs, roofs of cells; and models, of which all is drawn.
  /** @param {Layer} models @param {Layer} far @param {boolean} roofs @returns {Block[]} */
  blocks(models, far, roofs) {
    const { boxed, square, squares, corners, heights, levels } = this, boxes = 3 * TRIANGLES_OF_BOX * boxed.length, blocks = /** @type {Block[]} */ ([]);
    const starts = models.drawn.map(list => {
      const start = new Uint32Array(squares.length + 2);
      for (let place = 0; place < list.numbers.length; place += 3) start[1 + (list.numbers[place] < boxes ? square[boxed[Math.floor(list.numbers[place] / (3 * TRIANGLES_OF_BOX))]] : squares.length)] += 3;
      for (let number = 1; number < start.length; number++) start[number] += start[number - 1];
      return start;
    });
    const rangeOf = (/** @type {number} */ which, /** @type {number} */ number) => ({ layer: models, list: models.drawn[which], first: starts[which][number], count: starts[which][number + 1] - starts[which][number] });
    for (let at = 0; at < boxed.length;) {
      const number = square[boxed[at]], low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
      for (; at < boxed.length && square[boxed[at]] === number; at++) {
        for (let corner = 0; corner < 4; corner++) for (const level of [0, 1]) [corners[8 * boxed[at] + 2 * corner], corners[8 * boxed[at] + 2 * corner + 1], heights[2 * boxed[at] + level]].forEach((value, axis) => { low[axis] = Math.min(low[axis], value); high[axis] = Math.max(high[axis], value); });
      }
      const ways = [{ ...rangeOf(0, number), size: PART }, { ...rangeOf(1, number), size: HOUSE }];
      let before = 0;
      for (const [level, { first, count }] of levels.entries()) {
        if (roofs) ways.push({ layer: far, list: far.drawn[0], first: 3 * (before + first[number]), count: 3 * (first[number + 1] - first[number]), size: CELLS[level] });
        before += count;
      }
      blocks.push({ low, high, ways });
    }
    return [...blocks, { low: [], high: [], ways: [{ ...rangeOf(0, squares.length), size: Infinity }] }];
  }

  static async open() {
    if (location.protocol === 'file:') throw new Error('this page is one of a web server; eaves view OUT --serve is one');
    return new City(await unpackAll((await fetched('boxes')).arrays));
  }

  // The boxes of the buildings outside of the squares `near`, over the ground, which sinks under these.
  /** @param {number[]} near @returns {Parts} */
  boxes(near) {
    const { corners, heights, lods, square } = this, there = new Set(near), far = this.boxed = this.order.filter(number => !there.has(square[number]));
    const count = TRIANGLES_OF_BOX * far.length, xyz = new Float32Array(9 * count), building = new Uint32Array(count), lod = new Uint8Array(count), kind = new Uint8Array(count).fill(1), slope = new Float32Array(count).fill(90);
    let at = 0, face = 0;
    for (const number of far) {
      const [low, high] = [heights[2 * number], heights[2 * number + 1]], put = (/** @type {number} */ corner, /** @type {number} */ z) => {
        xyz[at++] = corners[8 * number + 2 * corner];
        xyz[at++] = corners[8 * number + 2 * corner + 1];
        xyz[at++] = z;
      };
      for (let one = 0; one < 4; one++) {
        const two = (one + 1) % 4;
        put(one, low); put(two, low); put(two, high);
        put(one, low); put(two, high); put(one, high);
      }
      put(0, high); put(1, high); put(2, high);
      put(0, high); put(2, high); put(3, high);
      building.fill(number + 1, face, face + TRIANGLES_OF_BOX);
      lod.fill(lods[number] ? BOX : 0, face, face + TRIANGLES_OF_BOX);
      kind.fill(2, face + ROOF_OF_BOX, face + TRIANGLES_OF_BOX);
      slope.fill(0, face + ROOF_OF_BOX, face + TRIANGLES_OF_BOX);
      face += TRIANGLES_OF_BOX;
    }
    const bare = () => ({ xyz: new Float32Array(0), building: new Uint32Array(0), epochs: new Uint8Array(0), count: 0 });
    const points = { ...bare(), classification: new Uint8Array(0), plane: new Uint8Array(0), distance: new Int16Array(0), over: new Uint8Array(0), base: page.base };
    const triangles = { xyz, building, lod, kind, slope, azimuth: new Float32Array(count), epochs: new Uint8Array(count), error: new Uint16Array(count).fill(65535), count };
    return { points, triangles, edges: { ...bare(), lod: new Uint8Array(0) }, prints: bare(), grounds: this.grounds.map(ground => ({ ...ground, position: this.sunk(ground.position, near) })) };
  }

  /** @param {Float32Array} position @param {number[]} near */
  sunk(position, near) {
    const lower = position.slice();
    for (const number of near) {
      const [west, south, east, north] = this.squares[number];
      for (let at = 0; at < lower.length; at += 3) if (lower[at] > west && lower[at] < east && lower[at + 1] > south && lower[at + 1] < north) lower[at + 2] -= SUNK;
    }
    return lower;
  }

  /** @returns {Scene} */
  scene() { return { ...joined([this.boxes(this.near), ...this.near.map(number => /** @type {Parts} */ (this.scenes.get(number)))]), rows: this.rows, far: this.far }; }

  // The squares nearest to what is looked at, as many as are drawn with ease; none from far away.
  /** @param {{ distance: number, target: Place }} eye @returns {number[]} */
  wanted({ distance, target: [x, y] }) {
    if (distance > NEAR) return [];
    const away = (/** @type {number[]} */ [west, south, east, north]) => Math.hypot(Math.max(west - x, 0, x - east), Math.max(south - y, 0, y - north));
    const order = this.squares.map((square, number) => [away(square), number, square[4]]).filter(([far]) => far < Math.max(200, 0.8 * distance)).sort((one, two) => one[0] - two[0]);
    let count = 0;
    return order.filter(([, , buildings], place) => (count += buildings) <= NEAR_BUILDINGS || !place).map(([, number]) => number).sort((one, two) => one - two);
  }

  // The first picture, coarse until the machine is known, and then the rows of the table.
  /** @param {Viewer} viewer */
  async follow(viewer) {
    this.viewer = viewer;
    viewer.city = this;
    viewer.pace.quality = QUALITIES.length - 2;
    viewer.refresh();
    await viewer.pace.first();
    (await unpackRows(await fetched('rows'))).forEach((row, number) => { this.rows[number] = row; });
  }

  // Once the picture rests: draws what has come near, and drops what has gone far.
  async look() {
    const { viewer } = this;
    if (!viewer) return;
    const near = this.wanted(viewer.camera);
    if (this.busy || near.join() === this.near.join()) return;
    this.busy = true;
    document.documentElement.dataset.near = 'no';
    try {
      await Promise.all(near.filter(number => !this.scenes.has(number)).map(async number => {
        const { terrain, arrays } = await fetched(number);
        this.scenes.set(number, readScene(await unpackAll(arrays), terrain));
      }));
      this.near = near;
      for (const number of this.scenes.keys()) if (this.scenes.size > SQUARES_KEPT && !near.includes(number)) this.scenes.delete(number);
      viewer.load(this.scene());
      viewer.refresh();
      viewer.profile.draw();
      if (viewer.look.chosen) viewer.describe(viewer.look.chosen - 1);
    } catch (error) { byId('answer').textContent = `Not all is here: ${messageOf(error)}.`; }
    this.busy = false;
    document.documentElement.dataset.near = 'yes';
  }
}
