// What extensions do with the page: tools with a button and a key, what is under the pointer, geometry replaced in place, overlays, the camera.
// An extension is a function that is given the Tools of the page once the scene is there; it registers, before or after this script, by
//   (window.eavesExtensions ??= []).push(tools => { tools.add({ id: 'split', name: 'Split', key: 'x', does: 'Split by a line', start() {}, stop() {} }); });
// Places are [x, y, z] in metres about `tools.origin`; buildings are numbers from 0 among `tools.rows`.
import { unpackAll } from './arrays.js';
import { pickPlace } from './measure.js';
import { byId, element } from './page.js';
import { pickBuilding, sightOf } from './pick.js';
import { readShapes } from './scene.js';

/** @import { Drawing, Extension, Packed, Place, Row, Spot, Tool } from './types.js' */
/** @import { Viewer } from './viewer.js' */

const SVG = 'http://www.w3.org/2000/svg';

export class Tools {
  /** @param {Viewer} viewer */
  constructor(viewer) {
    this.viewer = viewer;
    /** @type {Map<string, Tool>} */
    this.all = new Map();
    /** The tool that is switched on: it is offered the pointer and the keys before the scene. @type {Tool | null} */
    this.active = null;
    /** @type {Map<string, Drawing>} */
    this.drawings = new Map();
    /** @type {((number: number, row: Row | undefined) => void)[]} */
    this.choosers = [];
    this.sheet = document.createElementNS(SVG, 'svg');
    this.sheet.id = 'overlay';
    viewer.canvas.after(this.sheet);
  }

  get origin() { return this.viewer.origin; }

  get rows() { return this.viewer.all; }

  /** The number of the chosen building; −1 when none is. */
  get chosen() { return this.viewer.look.chosen - 1; }

  /** A button in the toolbar, and its key in the scene. `press` is done once; a tool with `start` and `stop` is switched on and off, one at a time.
   * @param {Tool} tool */
  add(tool) {
    const keys = tool.key.split(' ').map(key => element('kbd', {}, key)), button = element('button', { type: 'button', id: `tool-${tool.id}`, title: tool.does, 'aria-keyshortcuts': tool.key }, tool.name, ' ', ...keys);
    button.addEventListener('click', () => this.press(tool));
    if (tool.start) button.setAttribute('aria-pressed', 'false');
    byId('views').append(button);
    this.all.set(tool.id, tool);
    return button;
  }

  /** @param {Tool} tool */
  press(tool) {
    if (tool.press) return tool.press();
    const on = this.active !== tool;
    this.stop();
    if (!on) return;
    this.viewer.ruler.toggle(false);
    this.active = tool;
    byId(`tool-${tool.id}`).setAttribute('aria-pressed', 'true');
    tool.start?.();
  }

  /** Switches the active tool off. */
  stop() {
    const tool = this.active;
    if (!tool) return;
    this.active = null;
    byId(`tool-${tool.id}`).setAttribute('aria-pressed', 'false');
    tool.stop?.();
  }

  /** Takes a tool and its button away. @param {string} id */
  remove(id) {
    if (this.active?.id === id) this.stop();
    this.all.delete(id);
    document.getElementById(`tool-${id}`)?.remove();
  }

  /** What is at a pixel of the canvas. @param {number} x @param {number} y @returns {Spot} */
  at(x, y) {
    const { viewer } = this;
    return {
      x, y,
      building: () => pickBuilding(viewer, x, y) - 1,
      place: () => pickPlace(viewer, x, y),
      level: z => {
        const { from, along } = sightOf(viewer.camera, viewer.canvas.clientWidth, viewer.canvas.clientHeight, x, y), far = (z - from[2]) / along[2];
        return [from[0] + far * along[0], from[1] + far * along[1], z];
      },
    };
  }

  /** Where a place is seen: its pixel of the canvas, and whether it lies before the eye. @param {Place} place */
  seen([x, y, z]) {
    const { camera, canvas } = this.viewer, { aside, down, ahead } = sightOf(camera, canvas.clientWidth, canvas.clientHeight, 0, 0).seen(x, y, z);
    return { x: aside, y: down, ahead };
  }

  /** Offers the pointer to the active tool; whether it takes it. @param {'down' | 'move' | 'up' | 'tap'} kind @param {PointerEvent} event */
  pointer(kind, event) {
    if (!this.active?.pointer) return false;
    const box = this.viewer.canvas.getBoundingClientRect();
    return this.active.pointer(kind, this.at(event.clientX - box.left, event.clientY - box.top), event) === true;
  }

  /** Draws lines, points and words over the scene, under a name; null takes them away. @param {string} name @param {Drawing | null} drawing */
  overlay(name, drawing) {
    if (drawing) this.drawings.set(name, drawing);
    else this.drawings.delete(name);
    this.draw();
  }

  draw() {
    const sheet = [...this.drawings].map(([name, { lines = [], points = [], words = [] }]) => {
      const group = made('g', { class: name });
      for (const line of lines) {
        const ends = line.map(place => this.seen(place));
        if (ends.every(end => end.ahead)) group.append(made('polyline', { points: ends.map(({ x, y }) => `${x},${y}`).join(' ') }));
      }
      for (const place of points) {
        const { x, y, ahead } = this.seen(place);
        if (ahead) group.append(made('circle', { cx: x, cy: y, r: 5 }));
      }
      for (const [place, text] of words) {
        const { x, y, ahead } = this.seen(place);
        if (ahead) group.append(made('text', { x, y: y - 9 }, text));
      }
      return group;
    });
    this.sheet.replaceChildren(...sheet);
  }

  /** Looks at a place from where the eye is. @param {Place} place @param {number} [radius] metres around it that are in sight */
  fly(place, radius = 15) {
    this.viewer.camera.flyTo(place, radius);
    this.viewer.ask();
  }

  /** Chooses a building and flies there; −1 lets go. @param {number} number @param {boolean} [fly] */
  choose(number, fly = true) { this.viewer.choose(number, fly); }

  /** Calls back with the number and the row whenever a building is chosen or let go. @param {(number: number, row: Row | undefined) => void} done */
  onChoose(done) { this.choosers.push(done); }

  /** What is said over the scene and to screen readers. @param {string} text */
  say(text) {
    byId('note').textContent = text;
    byId('note').hidden = !text;
  }

  /** A place beside the scene, above the others. @param {string} id @param {string} title */
  panel(id, title) {
    const box = element('fieldset', { id }, element('legend', {}, title));
    byId('controls').prepend(box);
    return box;
  }

  /** Draws a building in place of the one of a number, with its row of the table. `packed` are the arrays of `eaves.report.page_file.iter_arrays` for it
   * alone (those of triangles, edges and outlines); null takes it off the scene and the table. A `number` of none is a new building.
   * @param {number} number @param {Record<string, Packed> | null} packed @param {Row} [row] @returns {Promise<number>} its number */
  async replace(number, packed, row) {
    const { viewer } = this, { scene, table } = viewer, fresh = packed ? readShapes(await unpackAll(packed)) : null;
    if (viewer.city) throw new Error('a page that is loaded by squares changes no geometry');
    if (number < 0) {
      number = scene.rows.length;
      scene.rows.push({ id: '' });
      viewer.all.splice(number, 0, { id: '' });
      table?.add(number);
    }
    if (number >= scene.rows.length) throw new Error('this building is not drawn');
    if (row) scene.rows[number] = viewer.all[number] = row;
    viewer.exchange(number, fresh);
    if (!packed) table?.remove(number);
    else if (table && !table.order.includes(number)) table.order.push(number); // it was taken away before
    if (viewer.look.chosen === number + 1 && packed) viewer.tell(number, false);
    else if (viewer.look.chosen === number + 1) viewer.choose(-1, false);
    table?.update();
    return number;
  }
}

/** @param {string} name @param {Record<string, string | number>} attributes @param {string} [text] */
function made(name, attributes, text) {
  const one = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) one.setAttribute(key, String(value));
  if (text) one.textContent = text;
  return one;
}

/** Begins the extensions that are there, and those that come. @param {Tools} tools */
export function beginExtensions(tools) {
  /** @param {Extension} extension */
  const begin = extension => extension(tools);
  const waiting = globalThis.window.eavesExtensions ?? [];
  window.eavesExtensions = { push: begin };
  for (const extension of /** @type {Extension[]} */ (waiting)) begin(extension);
}
