// A map below and addresses, from servers that a person chooses: nothing is requested before, and never by what an address of the page says.
import { byId, element, field, frameOf, messageOf, page } from './page.js';
import { boxOf } from './scene.js';

/** @import { Viewer } from './viewer.js' */

export const TILE = 256, MOST_TILES = 144, WIDEST = 16, FINEST_ZOOM = 19;
export const OSM_CREDIT = '© OpenStreetMap contributors';

const lay = () => /** @type {number[][]} */ (page.world);

export class Network {
  /** @param {Viewer} viewer */
  constructor(viewer) {
    this.viewer = viewer;
    this.asked = 0;
    byId('network').hidden = !page.world;
    frameOf('tiles').hidden = !page.terrain.rows;
    for (const name of ['tiles', 'own-tiles', 'own-credit']) byId(name).addEventListener('change', () => this.chooseMap());
    byId('ask').addEventListener('click', () => this.findAddress(field('find').value.trim()));
  }

  // Offers to ask for an address, or no longer does.
  /** @param {string} wanted */
  offer(wanted) {
    byId('ask').hidden = !page.world || !wanted;
    byId('ask').textContent = `Ask ${field('geocoder').value.replace(/^https?:..([^/]+).*/, '$1')}`;
  }

  // A place about the origin on the square of web mercator, 0 to 1 from the west and from the north; and back.
  /** @param {number[]} place */
  static toWorld([x, y]) { return lay().map(([a, b, c, d, e, f]) => a + b * x + c * y + d * x * x + e * x * y + f * y * y); }

  /** @param {number[]} world */
  static fromWorld([u, v]) {
    const [[, a, b], [, c, d]] = lay();
    let place = [0, 0];
    for (let round = 0; round < 8; round++) {
      const [one, two] = Network.toWorld(place), [du, dv] = [u - one, v - two];
      place = [place[0] + (d * du - b * dv) / (a * d - b * c), place[1] + (a * dv - c * du) / (a * d - b * c)];
    }
    return place;
  }

  // What is shown, on that square: west, north, east, south.
  extent() {
    const { low, high } = boxOf(this.viewer.scene), corners = [low[0], high[0]].flatMap(x => [low[1], high[1]].map(y => Network.toWorld([x, y])));
    const [u, v] = [0, 1].map(axis => corners.map(corner => corner[axis]));
    return [Math.min(...u), Math.min(...v), Math.max(...u), Math.max(...v)];
  }

  async chooseMap() {
    const own = field('tiles').value === 'own', address = own ? field('own-tiles').value.trim() : field('tiles').value, ticket = ++this.asked;
    for (const name of ['own-tiles', 'own-credit']) frameOf(name).hidden = !own;
    this.viewer.painter.lay = null;
    frameOf('basemap').hidden = !page.basemap;
    byId('credit').textContent = '';
    byId('requests').textContent = 'Nothing is requested.';
    if (page.basemap) await this.viewer.addImage(page.basemap);
    this.viewer.refresh();
    if (!address) return;
    try {
      await this.drawMap(address, own ? field('own-credit').value.trim() : OSM_CREDIT, ticket);
    } catch (error) {
      byId('requests').textContent = `No map: ${messageOf(error)}.`;
    }
  }

  // All tiles under the ground, of the finest zoom that has few enough.
  /** @param {string} address @param {string} credit @param {number} ticket */
  async drawMap(address, credit, ticket) {
    const [west, north, east, south] = this.extent(), range = (/** @type {number} */ zoom) => [west, north, east, south].map(side => Math.floor(side * 2 ** zoom));
    let zoom = FINEST_ZOOM, wide = 0, tall = 0, left = 0, top = 0;
    for (; zoom >= 0; zoom--) {
      const [a, b, c, d] = range(zoom);
      [left, top, wide, tall] = [a, b, c - a + 1, d - b + 1];
      if (wide * tall <= MOST_TILES && Math.max(wide, tall) <= WIDEST) break;
    }
    const fill = (/** @type {number} */ x, /** @type {number} */ y) => {
      /** @type {Record<string, string | number>} */
      const words = { s: 'a', z: zoom, tilematrix: zoom, x, tilecol: x, y, tilerow: y, '-y': 2 ** zoom - 1 - y };
      return address.replace(/\{([\w-]+)\}/g, (whole, name) => String(words[name.toLowerCase()] ?? whole));
    };
    if (fill(0, 0) === fill(0, 1) || fill(0, 0) === fill(1, 0)) throw new Error('the address lacks one of {z}, {x} and {y}');
    const { host } = new URL(fill(left, top)), sheet = element('canvas', { width: wide * TILE, height: tall * TILE }), pen = /** @type {CanvasRenderingContext2D} */ (sheet.getContext('2d'));
    pen.fillStyle = '#ffffff';
    pen.fillRect(0, 0, sheet.width, sheet.height);
    byId('requests').textContent = `Asks ${host} for ${wide * tall} tiles …`;
    const missing = /** @type {string[]} */ ([]), load = async (/** @type {number} */ x, /** @type {number} */ y) => {
      try {
        const answer = await fetch(fill(left + x, top + y), { credentials: 'omit' });
        if (!answer.ok) throw new Error(`status ${answer.status}`);
        pen.drawImage(await createImageBitmap(await answer.blob()), x * TILE, y * TILE, TILE, TILE);
      } catch (error) { missing.push(messageOf(error)); }
    };
    await Promise.all(Array.from({ length: wide * tall }, (_, place) => load(place % wide, Math.floor(place / wide))));
    if (ticket !== this.asked) return; // another map was chosen meanwhile
    const hint = location.protocol === 'file:' ? '; some servers answer no page opened from disk, only one of a web server (eaves view OUT --serve)' : '';
    if (missing.length === wide * tall) throw new Error(`${host} gave no tile: ${missing[0]}${hint}`);
    const grown = 2 ** zoom;
    this.viewer.painter.picture(sheet, lay().flatMap((terms, axis) => terms.map((value, term) => (value * grown - (term ? 0 : [left, top][axis])) / [wide, tall][axis])));
    byId('requests').textContent = `${wide * tall - missing.length} of ${wide * tall} tiles came from ${host} (zoom ${zoom}).`;
    byId('credit').textContent = `map: ${credit || host}`;
    frameOf('basemap').hidden = false;
    this.viewer.refresh();
  }

  // Asks the chosen server for an address within what is shown, once for each press of the button.
  /** @param {string} wanted */
  async findAddress(wanted) {
    const say = (/** @type {string} */ text) => { byId('answer').textContent = text; };
    this.offer('');
    try {
      const address = new URL(field('geocoder').value), [west, north, east, south] = this.extent(), degrees = (/** @type {number} */ v) => Math.atan(Math.sinh(Math.PI * (1 - 2 * v))) * 180 / Math.PI;
      const box = [360 * west - 180, degrees(north), 360 * east - 180, degrees(south)];
      for (const [name, value] of Object.entries({ q: wanted, format: 'jsonv2', limit: '1', bounded: '1', viewbox: box.map(side => side.toFixed(6)).join() })) address.searchParams.set(name, value);
      say(`Asks ${address.host} …`);
      const answer = await fetch(address, { credentials: 'omit' });
      if (!answer.ok) throw new Error(`${address.host} answers with status ${answer.status}`);
      const [found] = await answer.json();
      if (!found) return say(`${address.host} knows no such address in what is shown.`);
      const sine = Math.sin(found.lat * Math.PI / 180);
      this.viewer.fly(Network.fromWorld([(Number(found.lon) + 180) / 360, 0.5 - Math.atanh(sine) / (2 * Math.PI)]));
      say(`${found.display_name} (${found.licence || address.host})`);
    } catch (error) { say(`No answer of ${field('geocoder').value}: ${messageOf(error)}.`); }
  }
}
