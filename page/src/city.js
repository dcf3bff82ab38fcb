// A city of any size: every building is a box, but in the squares near the eye, which are fetched as they come near.
import { metres, unpackAll, unpackRows } from './arrays.js';
import { QUALITIES } from './pace.js';
import { byId, messageOf, page } from './page.js';
import { joined, readGrounds, readScene } from './scene.js';

/** @import { Arrays, Parts, Place, Row, Scene } from './types.js' */
/** @import { Viewer } from './viewer.js' */

export const BOX = 255, NEAR = 1500, NEAR_BUILDINGS = 4000, SQUARES_KEPT = 40, SUNK = 4;
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
  }

  static async open() {
    if (location.protocol === 'file:') throw new Error('this page is one of a web server; eaves view OUT --serve is one');
    return new City(await unpackAll((await fetched('boxes')).arrays));
  }

  // The boxes of the buildings outside of the squares `near`, over the ground, which sinks under these.
  /** @param {number[]} near @returns {Parts} */
  boxes(near) {
    const { corners, heights, lods, square } = this, there = new Set(near), far = /** @type {number[]} */ ([]);
    for (let number = 0; number < square.length; number++) if (!there.has(square[number])) far.push(number);
    const count = 10 * far.length, xyz = new Float32Array(9 * count), building = new Uint32Array(count), lod = new Uint8Array(count), kind = new Uint8Array(count).fill(1), slope = new Float32Array(count).fill(90);
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
      building.fill(number + 1, face, face + 10);
      lod.fill(lods[number] ? BOX : 0, face, face + 10);
      kind.fill(2, face + 8, face + 10);
      slope.fill(0, face + 8, face + 10);
      face += 10;
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
  scene() { return { ...joined([this.boxes(this.near), ...this.near.map(number => /** @type {Parts} */ (this.scenes.get(number)))]), rows: this.rows }; }

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
