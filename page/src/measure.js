// Distances: places are picked on what is shown, joined to corners and points nearby, and drawn over the scene.
import { byId, page } from './page.js';
import { hitTriangle, sightOf } from './pick.js';

/** @import { Place } from './types.js' */
/** @import { Viewer } from './viewer.js' */

export const SNAP = 9, SVG = 'http://www.w3.org/2000/svg';

// The place [x, y, z] under the pointer: a corner of a model or a point nearby, else where the ray meets a surface.
/** @param {Viewer} viewer @param {number} x @param {number} y @returns {Place | null} */
export function pickPlace(viewer, x, y) {
  const { camera, canvas, layers, scene } = viewer, sight = sightOf(camera, canvas.clientWidth, canvas.clientHeight, x, y);
  const onSide = viewer.epochs.seenAt(x);
  let depth = Infinity;
  const meet = (/** @type {Float32Array} */ xyz, /** @type {Uint32Array} */ list, /** @type {(vertex: number) => number} */ epochOf) => {
    const corners = new Float64Array(9);
    for (let place = 0; place < list.length; place += 3) {
      if (!onSide(epochOf(list[place]))) continue;
      for (let k = 0; k < 9; k++) corners[k] = xyz[3 * list[place + Math.floor(k / 3)] + k % 3];
      const far = hitTriangle(corners, 0, sight.from, sight.along);
      if ((camera.flat || far > 0) && far < depth) depth = far;
    }
  };
  meet(scene.triangles.xyz, layers.models.shown, vertex => scene.triangles.epochs[vertex / 3]);
  scene.grounds.forEach(({ position, epoch }, place) => meet(position, layers.grounds[place].shown, () => epoch));
  let best = Number.isFinite(depth) ? sight.from.map((value, axis) => value + depth * sight.along[axis]) : null, nearest = SNAP;
  const limit = best ? sight.seen(best[0], best[1], best[2]).depth + 1 : Infinity;
  const offer = (/** @type {Place} */ place) => {
    const { aside, down, depth: far, ahead } = sight.seen(place[0], place[1], place[2]), away = Math.hypot(aside, down);
    if (ahead && far <= limit && away < nearest) [best, nearest] = [place, away];
  };
  for (const vertex of layers.edges.shown) if (onSide(scene.edges.epochs[vertex >> 1])) offer([...scene.edges.xyz.subarray(3 * vertex, 3 * vertex + 3)]);
  if (nearest === SNAP) for (const layer of [layers.points, layers.other]) for (const point of layer.shown) if (onSide(scene.points.epochs[point])) offer([...scene.points.xyz.subarray(3 * point, 3 * point + 3)]);
  return best;
}

export class Ruler {
  /** @param {Viewer} viewer */
  constructor(viewer) {
    this.viewer = viewer;
    /** @type {Place[]} */
    this.places = [];
    this.active = false;
    this.sheet = document.createElementNS(SVG, 'svg');
    this.sheet.id = 'ruler';
    viewer.canvas.after(this.sheet);
    byId('measure').addEventListener('click', () => this.toggle());
  }

  /** @param {boolean} [on] */
  toggle(on = !this.active) {
    this.active = on;
    if (on) this.viewer.tools.stop();
    if (!on) this.places = [];
    byId('measure').setAttribute('aria-pressed', String(on));
    byId('status').textContent = on ? 'measuring: click on places; Escape ends it' : 'measuring ended';
    this.viewer.canvas.style.cursor = on ? 'crosshair' : '';
    if (!on) this.viewer.profile.toggle(false);
    this.draw();
  }

  /** @param {number} x @param {number} y */
  take(x, y) {
    const place = pickPlace(this.viewer, x, y);
    if (place) this.places.push(place);
    this.draw();
    this.viewer.profile.draw();
  }

  // Metres along the ground, up, and straight, between two places.
  /** @param {Place} one @param {Place} two */
  static between(one, two) {
    const [east, north, up] = two.map((value, axis) => value - one[axis]);
    return { level: Math.hypot(east, north), up, straight: Math.hypot(east, north, up) };
  }

  draw() {
    const { camera, canvas } = this.viewer, { seen } = sightOf(camera, canvas.clientWidth, canvas.clientHeight, 0, 0);
    const spots = this.places.map(place => seen(place[0], place[1], place[2])), made = /** @type {SVGElement[]} */ ([]);
    const add = (/** @type {string} */ name, /** @type {Record<string, string | number>} */ attributes, /** @type {string} */ text = '') => {
      const one = document.createElementNS(SVG, name);
      for (const [key, value] of Object.entries(attributes)) one.setAttribute(key, String(value));
      if (text) one.textContent = text;
      made.push(one);
    };
    let whole = 0;
    for (let k = 1; k < spots.length; k++) {
      const [one, two] = [spots[k - 1], spots[k]], { level, up, straight } = Ruler.between(this.places[k - 1], this.places[k]);
      whole += straight;
      if (!one.ahead || !two.ahead) continue;
      add('line', { x1: one.aside, y1: one.down, x2: two.aside, y2: two.down });
      const steep = Math.abs(up) > 0.05 ? ` (level ${level.toFixed(2)}, up ${up.toFixed(2)}, ${(Math.atan2(up, level) * 180 / Math.PI).toFixed(1)}°)` : '';
      add('text', { x: (one.aside + two.aside) / 2, y: (one.down + two.down) / 2 - 7 }, `${straight.toFixed(2)} m${steep}`);
    }
    for (const { aside, down, ahead } of spots) if (ahead) add('circle', { cx: aside, cy: down, r: 4 });
    const last = spots[spots.length - 1];
    if (spots.length > 2 && last.ahead) add('text', { x: last.aside + 10, y: last.down + 18 }, `${whole.toFixed(2)} m in all`);
    this.sheet.replaceChildren(...made);
    const height = this.places.length ? this.places[this.places.length - 1][2] + page.base : null;
    if (this.active && height !== null) byId('status').textContent = `${whole.toFixed(2)} metres; last place at height ${height.toFixed(2)}`;
  }
}
