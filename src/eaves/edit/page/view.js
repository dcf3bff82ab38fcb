// The scene of the page as the tools see it: places under the pointer, a sheet of lines over it, buildings replaced.
// All that the tools know of the page's viewer is in this file.

/** @typedef {import('./geometry.js').Place} Place */

const SVG = 'http://www.w3.org/2000/svg', FIELD = 0.7;
const KINDS = { uint8: Uint8Array, int16: Int16Array, uint16: Uint16Array, int32: Int32Array, uint32: Uint32Array };

/** @param {string} name */
export const byId = name => /** @type {any} */ (document.getElementById(name));

/** The page's viewer, once it is there. */
export async function viewerOf() {
  while (document.documentElement.dataset.ready !== 'yes') {
    if (document.documentElement.dataset.ready === 'no') throw new Error('the page has no 3D scene');
    await new Promise(requestAnimationFrame);
  }
  return new View(/** @type {any} */ (window).eaves);
}

/** An array of the page out of its base64.
 * @param {{ type: string, data: string }} packed */
async function unpacked({ type, data }) {
  const bytes = Uint8Array.from(atob(data), letter => letter.charCodeAt(0));
  const planes = new Uint8Array(await new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'))).arrayBuffer());
  const kind = /** @type {any} */ (KINDS)[type], width = kind.BYTES_PER_ELEMENT, count = planes.length / width, whole = new Uint8Array(planes.length);
  for (let plane = 0; plane < width; plane++) for (let item = 0; item < count; item++) whole[item * width + plane] = planes[plane * count + item];
  return new kind(whole.buffer);
}

/** The items of some arrays, `width` numbers each, whose building is none of some, and others behind them. */
function spliced(/** @type {any} */ before, /** @type {any} */ more, /** @type {Set<number>} */ changed, /** @type {Record<string, number>} */ widths) {
  const kept = [], out = /** @type {any} */ ({ ...before });
  for (let item = 0; item < before.count; item++) if (!changed.has(before.building[item])) kept.push(item);
  for (const [name, width] of Object.entries(widths)) {
    const values = new before[name].constructor(width * (kept.length + more.count));
    kept.forEach((item, place) => { for (let k = 0; k < width; k++) values[width * place + k] = before[name][width * item + k]; });
    values.set(more[name], width * kept.length);
    out[name] = values;
  }
  out.count = kept.length + more.count;
  return out;
}

export class View {
  /** @param {any} viewer */
  constructor(viewer) {
    this.viewer = viewer;
    this.sheet = document.createElementNS(SVG, 'svg');
    this.sheet.id = 'sheet';
    viewer.canvas.after(this.sheet);
    /** @type {() => void} */
    this.draw = () => {};
    let last = '';
    const watch = () => {
      const { camera, canvas } = viewer, now = [camera.azimuth, camera.elevation, camera.distance, camera.flat, ...camera.target, canvas.clientWidth, canvas.clientHeight].join();
      if (now !== last) this.draw();
      last = now;
      requestAnimationFrame(watch);
    };
    watch();
  }

  get ids() { return this.viewer.scene.rows.map((/** @type {any} */ row) => row.id); }

  get chosen() { return this.viewer.look.chosen ? this.viewer.scene.rows[this.viewer.look.chosen - 1]?.id ?? '' : ''; }

  /** @param {string} id */
  row(id) { return this.viewer.scene.rows[this.ids.indexOf(id)]; }

  /** Chooses a building and flies there.
   * @param {string} id */
  choose(id, fly = true) { this.viewer.choose(this.ids.indexOf(id), fly); }

  /** Looks straight down, north up, from near a building. */
  above() {
    if (!this.viewer.camera.flat || this.viewer.camera.elevation < 1.5) this.viewer.view('above');
    this.viewer.ask();
  }

  /** The height about which places of a building are looked at: that of its eaves on the page.
   * @param {string} id */
  height(id) {
    const row = this.row(id), spot = this.viewer.spots[this.ids.indexOf(id)];
    if (Number.isFinite(row?.h_eaves)) return row.h_eaves - this.viewer.scene.points.base;
    return spot && Number.isFinite(spot.high[2]) ? spot.high[2] : this.viewer.camera.target[2];
  }

  get size() { return [this.viewer.canvas.clientWidth, this.viewer.canvas.clientHeight]; }

  /** Metres a pixel covers. */
  get step() { return this.viewer.camera.step(this.size[1]); }

  /** Where a place at a height is on the canvas; null behind the eye.
   * @param {Place} place
   * @param {number} z
   * @returns {[number, number] | null} */
  seen([x, y], z) {
    const { camera } = this.viewer, [wide, tall] = this.size, { right, up, back } = camera.axes(), eye = camera.eye();
    const dot = (/** @type {number[]} */ axis) => axis[0] * (x - eye[0]) + axis[1] * (y - eye[1]) + axis[2] * (z - eye[2]);
    const depth = -dot(back), step = 2 * (camera.flat ? camera.distance : depth) * Math.tan(FIELD / 2) / tall;
    return camera.flat || depth > 0 ? [dot(right) / step + wide / 2, tall / 2 - dot(up) / step] : null;
  }

  /** The place at a height that is under a pointer event; null where the eye looks along or away from it.
   * @param {{ clientX: number, clientY: number }} event
   * @param {number} z
   * @returns {Place | null} */
  under(event, z) {
    const { camera, canvas } = this.viewer, box = canvas.getBoundingClientRect(), [wide, tall] = this.size, { right, up, back } = camera.axes(), eye = camera.eye();
    const scale = 2 * Math.tan(FIELD / 2) / tall, across = (event.clientX - box.left - wide / 2) * scale, over = (tall / 2 - event.clientY + box.top) * scale;
    const bent = [0, 1, 2].map(axis => right[axis] * across + up[axis] * over);
    const from = camera.flat ? bent.map((value, axis) => eye[axis] + camera.distance * value) : eye, along = camera.flat ? back.map((/** @type {number} */ value) => -value) : bent.map((value, axis) => value - back[axis]);
    const far = (z - from[2]) / along[2];
    return Number.isFinite(far) && (camera.flat || far > 0) ? [from[0] + far * along[0], from[1] + far * along[1]] : null;
  }

  /** The points of the scene within a distance (m) of a place.
   * @param {Place} place
   * @param {number} reach
   * @returns {Place[]} */
  points([x, y], reach) {
    const { xyz, count } = this.viewer.scene.points, near = /** @type {Place[]} */ ([]);
    for (let at = 0; at < 3 * count; at += 3) if (Math.abs(xyz[at] - x) < reach && Math.abs(xyz[at + 1] - y) < reach) near.push([xyz[at], xyz[at + 1]]);
    return near;
  }

  /** Puts shapes on the sheet: rings and lines of places at a height, circles at places, words.
   * @param {{ line?: Place[], closed?: boolean, at?: Place, text?: string, z: number, kind: string, data?: Record<string, string | number> }[]} shapes */
  show(shapes) {
    this.sheet.replaceChildren(...shapes.flatMap(({ line, closed, at, text, z, kind, data }) => {
      const spots = (line || [/** @type {Place} */ (at)]).map(place => this.seen(place, z));
      if (spots.some(spot => !spot)) return [];
      const one = document.createElementNS(SVG, line ? closed ? 'polygon' : 'polyline' : text ? 'text' : 'circle'), [[x, y]] = /** @type {[number, number][]} */ (spots);
      const facts = line ? { points: spots.map(spot => /** @type {any} */ (spot).map((/** @type {number} */ value) => value.toFixed(1)).join()).join(' ') } : text ? { x: x + 10, y: y - 10 } : { cx: x, cy: y, r: 7 };
      for (const [name, value] of Object.entries({ ...facts, class: kind })) one.setAttribute(name, String(value));
      Object.assign(one.dataset, data);
      if (text) one.textContent = text;
      return [one];
    }));
  }

  /** Draws buildings in place of those before; those that went are no longer drawn.
   * @param {{ rows: any[], arrays: Record<string, any>, gone: string[] }} change */
  async replace({ rows, arrays, gone }) {
    const { viewer } = this, { scene } = viewer, keep = this.chosen;
    if (!rows.length && !gone.length) return;
    const numbers = rows.map(row => {
      let number = scene.rows.findIndex((/** @type {any} */ one) => one.id === row.id);
      if (number < 0) {
        number = scene.rows.length;
        scene.rows.push(row);
        if (viewer.all !== scene.rows) viewer.all.splice(number, 0, row);
        viewer.spots.push({ low: [], high: [] });
        viewer.table?.order.push(viewer.all.length - 1);
      }
      scene.rows[number] = viewer.all[number] = row;
      if (viewer.table) viewer.table.rows[number] = row;
      return number + 1;
    });
    const changed = new Set([...numbers, ...gone.map(id => this.ids.indexOf(id) + 1)]);
    const named = Object.fromEntries(await Promise.all(Object.entries(arrays).map(async ([name, packed]) => [name, await unpacked(packed)])));
    const part = (/** @type {string} */ name, /** @type {string[]} */ more) => {
      const building = named[`${name}_building`].map((/** @type {number} */ number) => numbers[number - 1]), out = /** @type {any} */ ({ building, count: building.length, epochs: new Uint8Array(building.length) });
      out.xyz = Float32Array.from(named[`${name}_xyz`], value => value / 1000);
      for (const key of more) out[key] = named[`${name}_${key}`];
      return out;
    };
    const triangles = part('triangle', ['lod', 'kind', 'error']);
    Object.assign(triangles, slopesOf(triangles));
    const next = { ...scene };
    next.triangles = spliced(scene.triangles, triangles, changed, { xyz: 9, building: 1, lod: 1, epochs: 1, kind: 1, error: 1, slope: 1, azimuth: 1 });
    next.edges = spliced(scene.edges, part('edge', ['lod']), changed, { xyz: 6, building: 1, lod: 1, epochs: 1 });
    next.prints = spliced(scene.prints, part('outline', []), changed, { xyz: 6, building: 1, epochs: 1 });
    for (const number of changed) viewer.spots[number - 1] = spotOf(next, number);
    viewer.load(next);
    if (viewer.table) {
      viewer.table.state = '';
      viewer.table.fill();
    }
    viewer.choose(gone.includes(keep) ? -1 : this.ids.indexOf(keep), false);
    this.draw();
  }
}

/** Slope and azimuth (degrees) of every triangle. */
function slopesOf(/** @type {{ xyz: Float32Array, count: number }} */ { xyz, count }) {
  const slope = new Float32Array(count), azimuth = new Float32Array(count);
  for (let number = 0, at = 0; number < count; number++, at += 9) {
    const [u, v] = [3, 6].map(other => [0, 1, 2].map(axis => xyz[at + other + axis] - xyz[at + axis]));
    const east = u[1] * v[2] - u[2] * v[1], north = u[2] * v[0] - u[0] * v[2], up = u[0] * v[1] - u[1] * v[0];
    slope[number] = Math.acos(Math.min(1, Math.abs(up) / (Math.hypot(east, north, up) || 1))) * 180 / Math.PI;
    azimuth[number] = (Math.atan2(east, north) * 180 / Math.PI + 360) % 360;
  }
  return { slope, azimuth };
}

/** The lowest and highest place of a building. */
function spotOf(/** @type {any} */ { triangles, prints }, /** @type {number} */ number) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (const [{ xyz, building, count }, width] of [[triangles, 9], [prints, 6]]) {
    for (let item = 0; item < count; item++) {
      if (building[item] !== number) continue;
      for (let k = 0; k < width; k++) [low[k % 3], high[k % 3]] = [Math.min(low[k % 3], xyz[width * item + k]), Math.max(high[k % 3], xyz[width * item + k])];
    }
  }
  return { low, high };
}
