// Heights along the measured line: the models and the ground cut upright, points beside the line, and a cursor.
import { CLASSES, NOTHING } from './colours.js';
import { SVG } from './measure.js';
import { byId, page } from './page.js';

/** @import { Place } from './types.js' */
/** @import { Viewer } from './viewer.js' */

export const BESIDE = 0.5, FRAME = { left: 46, right: 12, top: 18, bottom: 24 };

// Where triangles (three vertices each in `list`) are cut by the upright plane through a line: [s, z, s, z, name].
/** @param {Float32Array} xyz @param {Uint32Array} list @param {Place} one @param {Place} two @param {(place: number) => string} name */
export function cutUpright(xyz, list, one, two, name) {
  const long = Math.hypot(two[0] - one[0], two[1] - one[1]), [east, north] = [(two[0] - one[0]) / long, (two[1] - one[1]) / long], pieces = /** @type {[number, number, number, number, string][]} */ ([]);
  for (let place = 0; place < list.length; place += 3) {
    const ends = [];
    const corners = [0, 1, 2].map(k => {
      const at = 3 * list[place + k], [x, y] = [xyz[at] - one[0], xyz[at + 1] - one[1]];
      return [x * east + y * north, xyz[at + 2], y * east - x * north];
    });
    for (let k = 0; k < 3; k++) {
      const [a, b] = [corners[k], corners[(k + 1) % 3]];
      if (a[2] < 0 === b[2] < 0) continue;
      const share = a[2] / (a[2] - b[2]);
      ends.push([a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])]);
    }
    if (ends.length < 2) continue;
    const [[s1, z1], [s2, z2]] = ends[0][0] <= ends[1][0] ? ends : ends.reverse(), from = Math.max(0, s1), to = Math.min(long, s2);
    if (from > to) continue;
    const at = (/** @type {number} */ s) => s2 > s1 ? z1 + (z2 - z1) * (s - s1) / (s2 - s1) : null;
    pieces.push([from, at(from) ?? z1, to, at(to) ?? z2, name(place)]);
  }
  return pieces;
}

export class Profile {
  /** @param {Viewer} viewer */
  constructor(viewer) {
    this.viewer = viewer;
    this.on = false;
    /** @type {[number, number, number, number, string][]} */
    this.pieces = [];
    /** @type {[number, number, string][]} */
    this.dots = [];
    this.whole = 0;
    this.seen = FRAME.left;
    this.box = byId('profile');
    this.sheet = document.createElementNS(SVG, 'svg');
    /** @type {{ x(s: number): number, y(z: number): number, s(x: number): number } | null} */
    this.scale = null;
    byId('profiling').addEventListener('click', () => this.toggle());
    this.box.addEventListener('pointermove', event => this.point(event.clientX - this.box.getBoundingClientRect().left));
    this.box.addEventListener('keydown', event => {
      const step = { ArrowLeft: -8, ArrowRight: 8 }[event.key];
      if (step) this.point(this.seen + step);
      if (step) event.preventDefault();
    });
    new ResizeObserver(() => this.draw()).observe(this.box);
  }

  /** @param {boolean} [on] */
  toggle(on = !this.on) {
    this.on = on;
    byId('profiling').setAttribute('aria-pressed', String(on));
    if (on && !this.viewer.ruler.active) this.viewer.ruler.toggle(true);
    this.draw();
  }

  // The pieces of everything shown along all legs of the line, with the distance from its start.
  cut() {
    const { layers, ruler, scene } = this.viewer, kinds = ['underside', 'wall', 'roof', 'underside'];
    this.pieces = [];
    this.dots = [];
    this.whole = 0;
    for (let k = 1; k < ruler.places.length; k++) {
      const [one, two] = [ruler.places[k - 1], ruler.places[k]], long = Math.hypot(two[0] - one[0], two[1] - one[1]), start = this.whole;
      if (long < 0.01) continue;
      const older = (/** @type {number} */ epoch) => epoch === 1 ? ' old' : '', { epochs, kind, xyz } = scene.triangles;
      const grounds = scene.grounds.flatMap(({ position, details, epoch }) => cutUpright(position, details[0], one, two, () => `earth${older(epoch)}`));
      const models = cutUpright(xyz, layers.models.shown, one, two, place => kinds[kind[layers.models.shown[place] / 3]] + older(epochs[layers.models.shown[place] / 3]));
      for (const [s1, z1, s2, z2, name] of [...grounds, ...models]) this.pieces.push([s1 + start, z1, s2 + start, z2, name]);
      const [east, north] = [(two[0] - one[0]) / long, (two[1] - one[1]) / long];
      // points of buildings always, others where they are shown
      const roofs = Uint32Array.from(scene.points.building.keys()).filter(number => scene.points.building[number]), others = layers.points.shown.filter(number => !scene.points.building[number]);
      for (const numbers of [roofs, others, layers.other.shown]) {
        for (const number of numbers) {
          const [x, y] = [scene.points.xyz[3 * number] - one[0], scene.points.xyz[3 * number + 1] - one[1]], s = x * east + y * north;
          if (s >= 0 && s <= long && Math.abs(y * east - x * north) <= BESIDE) this.dots.push([s + start, scene.points.xyz[3 * number + 2], CLASSES[scene.points.classification[number]]?.[1] ?? NOTHING]);
        }
      }
      this.whole += long;
    }
  }

  draw() {
    this.box.hidden = !this.on;
    if (!this.on) return;
    this.cut();
    const [width, height] = [this.box.clientWidth, this.box.clientHeight], heights = this.pieces.flatMap(piece => [piece[1], piece[3]]).concat(this.dots.map(dot => dot[1]));
    const sheet = this.sheet = document.createElementNS(SVG, 'svg');
    if (!heights.length) {
      this.scale = null;
      this.add(sheet, 'text', { x: 12, y: 24 }, 'Click on two places or more: heights along the line between them stand here.');
      this.box.replaceChildren(sheet);
      return;
    }
    const low = heights.reduce((one, two) => Math.min(one, two)), high = Math.max(low + 1, heights.reduce((one, two) => Math.max(one, two)));
    const across = (width - FRAME.left - FRAME.right) / this.whole, up = Math.min((height - FRAME.top - FRAME.bottom) / (high - low), 8 * across);
    const x = (/** @type {number} */ s) => FRAME.left + s * across, y = (/** @type {number} */ z) => height - FRAME.bottom - (z - low) * up;
    this.scale = { x, y, s: pixel => (pixel - FRAME.left) / across };
    const stepOf = (/** @type {number} */ rough) => [1, 2, 5, 10].map(times => times * 10 ** Math.floor(Math.log10(rough))).find(value => value >= rough) ?? rough;
    const wide = stepOf(70 / across), tall = stepOf(28 / up), base = page.base;
    for (let s = 0; s <= this.whole + 1e-9; s += wide) {
      this.add(sheet, 'line', { class: 'axis', x1: x(s), x2: x(s), y1: FRAME.top, y2: height - FRAME.bottom });
      this.add(sheet, 'text', { x: x(s), y: height - 8, 'text-anchor': 'middle' }, Number(s.toFixed(2)).toString());
    }
    for (let z = Math.ceil((low + base) / tall) * tall; z <= high + base; z += tall) {
      this.add(sheet, 'line', { class: 'axis', x1: FRAME.left, x2: width - FRAME.right, y1: y(z - base), y2: y(z - base) });
      this.add(sheet, 'text', { x: FRAME.left - 5, y: y(z - base) + 4, 'text-anchor': 'end' }, Number(z.toFixed(2)).toString());
    }
    for (const [s, z, colour] of this.dots) this.add(sheet, 'circle', { cx: x(s), cy: y(z), r: 1.6, fill: colour });
    for (const [s1, z1, s2, z2, name] of this.pieces) this.add(sheet, 'line', { class: name, x1: x(s1), y1: y(z1), x2: x(s2), y2: y(z2) });
    const times = up / across;
    this.add(sheet, 'text', { x: FRAME.left + 2, y: 12 }, `distance and height (m)${Math.abs(times - 1) > 0.05 ? `, heights × ${times.toFixed(1)}` : ''}; points within ${BESIDE} m`);
    this.box.replaceChildren(sheet);
  }

  /** @param {SVGElement} sheet @param {string} name @param {Record<string, string | number>} attributes @param {string} [text] */
  add(sheet, name, attributes, text) {
    const one = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) one.setAttribute(key, String(value));
    if (text) one.textContent = text;
    sheet.append(one);
    return one;
  }

  // The topmost surface and the ground (of the new epoch, where there are two) at a distance from the start; null where there is none.
  /** @param {number} s */
  at(s) {
    const over = (/** @type {boolean} */ earth) => this.pieces.filter(([s1, , s2, , name]) => !name.endsWith('old') && (name === 'earth') === earth && s >= s1 && s <= s2)
      .map(([s1, z1, s2, z2]) => s2 > s1 ? z1 + (z2 - z1) * (s - s1) / (s2 - s1) : Math.max(z1, z2)).reduce((/** @type {number | null} */ one, two) => Math.max(one ?? two, two), null);
    return { model: over(false), ground: over(true) };
  }

  /** @param {number} place */
  point(place) {
    const { scale } = this;
    if (!scale) return;
    this.seen = place;
    const s = Math.min(this.whole, Math.max(0, scale.s(place))), { model, ground } = this.at(s), top = model ?? ground;
    for (const old of this.sheet.querySelectorAll('.cursor')) old.remove();
    if (top === null) return;
    const words = `${s.toFixed(2)} m along, height ${(top + page.base).toFixed(2)}${model !== null && ground !== null ? `, ${(model - ground).toFixed(2)} over the ground` : ''}`;
    this.add(this.sheet, 'line', { class: 'cursor', x1: scale.x(s), x2: scale.x(s), y1: FRAME.top, y2: scale.y(top) });
    this.add(this.sheet, 'text', { class: 'cursor', x: this.box.clientWidth - 12, y: 12, 'text-anchor': 'end' }, words);
  }
}
