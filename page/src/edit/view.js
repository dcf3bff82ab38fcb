// The scene of the page as the tools see it: places under the pointer, a sheet of lines over it, buildings replaced.
// All that the tools know of the page's viewer is in this file.

/** @typedef {import('./geometry.js').Place} Place */
/** @typedef {import('../tools.js').Tools} Tools */
/** @typedef {import('../types.js').Row} Row */
/** @typedef {import('../types.js').Packed} Packed */

const SVG = 'http://www.w3.org/2000/svg';
/** @param {string} name */
export const byId = name => /** @type {any} */ (document.getElementById(name));

/** The view of the page, once its scene is there.
 * @returns {Promise<View>} */
export const viewOf = () => new Promise(done => {
  const { window } = globalThis;
  (window.eavesExtensions ??= []).push(tools => done(new View(tools)));
});

export class View {
  /** @param {Tools} page */
  constructor(page) {
    this.page = page;
    this.viewer = /** @type {any} */ (page.viewer);
    this.canvas = /** @type {HTMLCanvasElement} */ (byId('scene'));
    this.sheet = document.createElementNS(SVG, 'svg');
    this.sheet.id = 'table-sheet';
    this.canvas.after(this.sheet);
    /** @type {() => void} */
    this.draw = () => {};
    let last = '';
    const watch = () => {
      const { canvas, viewer: { camera } } = this, now = [camera.azimuth, camera.elevation, camera.distance, camera.flat, ...camera.target, canvas.clientWidth, canvas.clientHeight].join();
      if (now !== last) this.draw();
      last = now;
      requestAnimationFrame(watch);
    };
    watch();
  }

  get chosen() { return this.page.rows[this.page.chosen]?.id ?? ''; }

  /** @param {string} id */
  number(id) { return this.page.rows.findIndex((/** @type {Row} */ row) => row.id === id); }

  /** @param {string} id */
  row(id) { return this.page.rows[this.number(id)]; }

  /** Chooses a building and flies there.
   * @param {string} id */
  choose(id) { this.page.choose(this.number(id)); }

  /** Looks straight down, north up, from near a building. */
  above() {
    if (!this.viewer.camera.flat || this.viewer.camera.elevation < 1.5) this.viewer.view('above');
    this.viewer.ask();
  }

  /** The height about which places of a building are looked at: that of its eaves on the page.
   * @param {string} id */
  height(id) {
    const row = this.row(id), spot = this.viewer.spots[this.number(id)];
    if (Number.isFinite(row?.h_eaves)) return row.h_eaves - this.viewer.scene.points.base;
    return spot && Number.isFinite(spot.high[2]) ? spot.high[2] : this.viewer.camera.target[2];
  }

  /** Metres a pixel covers. */
  get step() { return this.viewer.camera.step(this.canvas.clientHeight); }

  /** Where a place at a height is on the canvas; null behind the eye.
   * @param {Place} place
   * @param {number} z
   * @returns {[number, number] | null} */
  seen(place, z) {
    const { x, y, ahead } = this.page.seen([...place, z]);
    return ahead ? [x, y] : null;
  }

  /** The place at a height that is under a pointer event.
   * @param {{ clientX: number, clientY: number }} event
   * @param {number} z
   * @returns {Place | null} */
  under(event, z) {
    const box = this.canvas.getBoundingClientRect(), [x, y] = this.page.at(event.clientX - box.left, event.clientY - box.top).level(z);
    return Number.isFinite(x + y) ? [x, y] : null;
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

  /** The ends [x, y, z] of the edges of a building's finest model.
   * @param {string} id
   * @returns {[number, number, number][][]} */
  edges(id) {
    const { xyz, building, lod, count } = this.viewer.scene.edges, number = this.number(id) + 1, own = /** @type {number[]} */ ([]);
    for (let edge = 0; edge < count; edge++) if (building[edge] === number) own.push(edge);
    const finest = Math.max(...own.map(edge => lod[edge]));
    return own.filter(edge => lod[edge] === finest).map(edge => [0, 3].map(end => /** @type {[number, number, number]} */ ([0, 1, 2].map(axis => xyz[6 * edge + end + axis]))));
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
   * @param {{ changed: { row: Row, arrays: Record<string, Packed> }[], gone: string[] }} change */
  async replace({ changed, gone }) {
    for (const id of gone) if (this.number(id) >= 0) await this.page.replace(this.number(id), null);
    for (const { row, arrays } of changed) await this.page.replace(this.number(row.id), arrays, row);
    this.draw();
  }
}
