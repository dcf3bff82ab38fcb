// The scene on the canvas: layers, colours, what is chosen and where the eye is.
import { addressOf, obeyAddress } from './address.js';
import { Camera } from './camera.js';
import { describe } from './charts.js';
import { BOX } from './city.js';
import { LOD_COLOURS, bytes, legend, modelColours, pointColours } from './colours.js';
import { Painter } from './draw.js';
import { Epochs } from './epochs.js';
import { Ruler } from './measure.js';
import { Network } from './network.js';
import { Pace, QUALITIES } from './pace.js';
import { byId, field, frameOf, page } from './page.js';
import { Profile } from './profile.js';
import { boxOf, joinThings, modelOf, repeated, spotsOf, without } from './scene.js';
import { wallShade } from './shade.js';
import { Tools } from './tools.js';
import { Verdicts } from './verdicts.js';

/** @import { Colour, Edges, Layer, Look, Place, Row, Scene, Shapes, Things } from './types.js' */
/** @import { City } from './city.js' */
/** @import { Table } from './table.js' */

// What is neither ground nor building, mostly trees, lets what stands behind it through.
export const OTHER_OPACITY = 0.45;

// The finest level of detail of every building in every epoch.
/** @param {Pick<Scene, "triangles" | "rows">} scene @param {Uint8Array} [known] of the others */
function finestOf({ triangles, rows }, known) {
  const finest = new Uint8Array(3 * (rows.length + 1));
  if (known) finest.set(known);
  for (let number = 0; number < triangles.count; number++) {
    const model = modelOf(triangles, number);
    finest[model] = Math.max(finest[model], triangles.lod[number]);
  }
  return finest;
}

// A colour of the page's style.
const shade = (/** @type {string} */ name) => bytes(getComputedStyle(document.documentElement).getPropertyValue(name).trim());

export class Viewer {
  /** @param {Scene} scene @param {Row[]} all */
  constructor(scene, all) {
    this.all = all;
    /** @type {Table | null} */
    this.table = null;
    /** @type {City | null} */
    this.city = null;
    this.origin = page.origin;
    this.quarter = -1;
    const canvas = this.canvas = /** @type {HTMLCanvasElement} */ (byId('scene'));
    this.camera = new Camera(boxOf(scene), canvas.clientWidth / Math.max(1, canvas.clientHeight));
    this.painter = new Painter(canvas);
    this.pace = new Pace(this.painter, () => this.before(), quality => this.after(quality));
    /** @type {Look} */
    this.look = { background: [1, 1, 1], mark: [1, 0.6, 0], chosen: 0, only: false, pointSize: 0.35, split: 0 };
    this.spots = spotsOf(scene);
    this.scene = scene;
    this.layers = this.layersOf(scene);
    this.finest = finestOf(scene);
    this.scale = '';
    this.ruler = new Ruler(this);
    this.profile = new Profile(this);
    this.verdicts = new Verdicts();
    this.epochs = new Epochs(this);
    this.network = new Network(this);
    this.tools = new Tools(this);
    new ResizeObserver(() => this.ask()).observe(canvas);
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.refresh());
  }

  // Draws a scene in place of the one before.
  /** @param {Scene} scene */
  load(scene) {
    this.painter.clear();
    this.scene = scene;
    this.layers = this.layersOf(scene);
    this.finest = finestOf(scene);
  }

  // Draws a building in place of the one of a number, or none; all others stay as they are drawn.
  /** @param {number} number @param {Shapes | null} fresh */
  exchange(number, fresh) {
    const { scene, layers, painter } = this, first = { triangles: 0, edges: 0, prints: 0 };
    for (const [name, layer, width] of /** @type {const} */ ([['triangles', layers.models, 3], ['edges', layers.edges, 2], ['prints', layers.prints, 2]])) {
      const others = without(scene[name], number + 1), own = fresh?.[name];
      own?.building.fill(number + 1);
      /** @type {any} */ (scene)[name] = own ? joinThings([others, { ...own, dressed: new Uint8Array(4 * width * own.count), seen: new Uint8Array(own.count) }]) : others;
      first[name] = others.count;
      painter.refill(layer, scene[name].xyz, repeated(scene[name].building, width));
    }
    const { rows } = scene, none = { xyz: new Float32Array(0), building: new Uint32Array(0), count: 0 };
    const alone = /** @type {any} */ ({ rows, prints: fresh?.prints ?? none, triangles: fresh?.triangles ?? none });
    this.spots[number] = spotsOf(alone)[number];
    this.finest.fill(0, 3 * (number + 1), 3 * (number + 2));
    this.finest = finestOf(alone, this.finest);
    this.dressShapes(first);
    this.ask();
  }

  /** @param {Scene} scene */
  layersOf({ points, triangles, edges, prints, grounds, far = { xyz: new Float32Array(0), building: new Uint32Array(0), epochs: new Uint8Array(0), count: 0 } }) {
    const { painter } = this;
    return {
      grounds: grounds.map(({ position }) => painter.add('triangles', position, new Uint32Array(position.length / 3), { shaded: true })),
      models: painter.add('triangles', triangles.xyz, repeated(triangles.building, 3), { shaded: true, strength: 0.25 }),
      far: painter.add('triangles', far.xyz, repeated(far.building, 3), { shaded: true, strength: 0.25 }),
      edges: painter.add('lines', edges.xyz, repeated(edges.building, 2), { strength: 1, minor: true, fades: true }),
      prints: painter.add('lines', prints.xyz, repeated(prints.building, 2), { strength: 1, minor: true }),
      points: painter.add('points', points.xyz, Uint32Array.from(points.building)),
      other: painter.add('points', points.xyz, new Uint32Array(points.count), { opacity: OTHER_OPACITY }),
    };
  }

  // The aerial image of the page over the terrain.
  /** @param {string} address */
  async addImage(address) {
    const image = new Image(), { rows, columns, cell, west, north } = page.terrain, [wide, tall] = [columns * cell, rows * cell];
    image.src = address;
    await image.decode();
    this.painter.picture(image, [-west / wide, 1 / wide, 0, 0, 0, 0, north / tall, 0, -1 / tall, 0, 0, 0]);
    frameOf('basemap').hidden = false;
  }

  /** @param {string} name */
  checked(name) { return field(name).checked; }

  // Colours and visibility from the controls; what has no colour is not drawn.
  refresh() {
    const { scene, painter, layers } = this, { points, grounds } = scene;
    this.look.background = shade('--sky').map(value => value / 255);
    this.look.mark = shade('--mark').map(value => value / 255);
    this.look.only = this.checked('only');
    const size = Number(field('size').value);
    this.look.pointSize = 0.35 * size;

    const earth = shade('--earth');
    layers.grounds.forEach((layer, place) => {
      const { position, light, details, epoch } = grounds[place], count = position.length / 3;
      layer.pictured = !!painter.lay && this.checked('basemap');
      this.dress(layer, { epochs: new Uint8Array(count).fill(epoch), count }, 1, () => layer.pictured ? [255, 255, 255] : earth, vertex => this.look.only ? 1 : light[vertex]); // no shade of hidden buildings
      painter.show(layer, ...(this.checked('ground') ? details : [new Uint32Array(0)]));
    });

    const pointWay = pointColours(field('point-colour').value, scene), [on, under, other] = ['points-building', 'points-ground', 'points-other'].map(name => this.checked(name));
    const foreign = (/** @type {number} */ number) => !points.building[number] && points.classification[number] !== 2;
    const { epochs, count } = points;
    this.dress(layers.points, { epochs, count }, 1, number => !foreign(number) && (points.building[number] ? on || points.building[number] === this.look.chosen : under) ? pointWay.at(number) : null);
    this.dress(layers.other, { epochs, count }, 1, number => foreign(number) && other && !this.look.only && !points.over[number] ? pointWay.at(number) : null);

    this.dressShapes();
    legend(byId('point-legend'), layers.points.shown.length + layers.other.shown.length ? pointWay.legend : { text: 'no points are shown' });
    this.ask();
  }

  // Colours models, edges and outlines, from the first of each that has no colour yet; all of them where the colours of the others are no longer theirs.
  dressShapes(first = { triangles: 0, edges: 0, prints: 0 }) {
    const { scene, painter, layers } = this, { triangles, edges, prints } = scene, line = shade('--line'), outline = shade('--outline');
    const wantedLod = page.lods.indexOf(field('lod').value), shown = (/** @type {Edges} */ things, /** @type {number} */ number) => things.lod[number] === BOX || things.lod[number] === (wantedLod < 0 ? this.finest[modelOf(things, number)] : wantedLod);
    const modelWay = modelColours(field('model-colour').value, scene), scale = JSON.stringify(modelWay.legend);
    if (scale !== this.scale) Object.assign(first, { triangles: 0 });
    this.scale = scale;
    const [roofs, walls] = [this.checked('roofs'), this.checked('walls')];
    const red = bytes(LOD_COLOURS.none);
    this.dress(layers.models, triangles, 3, number => {
      const row = triangles.building[number], kind = triangles.kind[number];
      if (!shown(triangles, number) || !(kind === 2 ? roofs : walls)) return null;
      return triangles.lod[number] === 0 && wantedLod < 0 && page.modelled ? red : modelWay.at(number, row - 1);
    }, (vertex, number) => triangles.kind[number] === 1 ? wallShade(triangles.xyz[3 * vertex + 2] - this.spots[triangles.building[number] - 1].low[2]) : 1, first.triangles);
    if (this.city && scene.far) {
      const all = layers.models.shown, { building } = scene.far, roofOf = this.city.roofOf();
      painter.show(layers.models, all, all.filter(vertex => triangles.lod[Math.floor(vertex / 3)] !== BOX || triangles.kind[Math.floor(vertex / 3)] === 2));
      this.dress(layers.far, scene.far, 3, number => modelWay.at(roofOf[building[number] - 1], building[number] - 1));
      layers.far.blocks = [];
      layers.models.blocks = this.city.blocks(layers.models, layers.far, roofs);
    }
    this.dress(layers.edges, edges, 2, number => (this.checked('edges') && edges.lod[number] > 0 && shown(edges, number) ? line : null), null, first.edges);
    this.dress(layers.prints, prints, 2, () => this.checked('prints') ? outline : null, null, first.prints);
    legend(byId('model-legend'), modelWay.legend);
  }

  // Colours the `count` things of a layer from a `first` on, `width` vertices each, and draws all those that have a colour.
  /** @param {Layer} layer @param {Pick<Things, "epochs" | "count" | "dressed" | "seen">} things @param {number} width @param {(number: number) => Colour | null} colour @param {((vertex: number, number: number) => number) | null} [bright] */
  dress(layer, things, width, colour, bright = null, first = 0) {
    const { epochs, count } = things;
    if (!first) Object.assign(things, { dressed: new Uint8Array(4 * count * width), seen: new Uint8Array(count) });
    const dressed = /** @type {Uint8Array} */ (things.dressed), seen = /** @type {Uint8Array} */ (things.seen), list = new Uint32Array(count * width);
    let end = 0;
    for (let number = 0; number < count; number++) {
      const answer = number >= first ? colour(number) : null;
      if (answer) {
        seen[number] = 1;
        for (let vertex = number * width; vertex < (number + 1) * width; vertex++) {
          const light = bright ? bright(vertex, number) : 1;
          for (let band = 0; band < 3; band++) dressed[4 * vertex + band] = light * answer[band];
          dressed[4 * vertex + 3] = epochs[number];
        }
      }
      if (seen[number]) for (let vertex = number * width; vertex < (number + 1) * width; vertex++) list[end++] = vertex;
    }
    this.painter.recolour(layer, dressed);
    this.painter.show(layer, list.slice(0, end));
  }

  ask() { this.pace.ask(); }

  address() { return addressOf(this); }

  /** @param {string} hash */
  obeyAddress(hash) { obeyAddress(this, hash); }

  // Where the eye is and what is wanted, for the picture that is drawn next.
  /** @returns {[Camera, Look]} */
  before() {
    this.camera.aspect = this.canvas.clientWidth / Math.max(1, this.canvas.clientHeight);
    this.look.split = this.epochs.share();
    return [this.camera, this.look];
  }

  // Says what the picture leaves out.
  /** @param {number} quality */
  after(quality) {
    const counts = [this.layers.points, this.layers.other].map(layer => layer.shown.length), sum = (/** @type {number} */ one, /** @type {number} */ two) => one + two;
    const here = counts.reduce(sum), drawn = counts.map(count => Math.min(count, QUALITIES[quality].points)).reduce(sum);
    byId('moving').hidden = !quality;
    if (quality) byId('moving').textContent = `While it moves: ${drawn < here ? `${drawn.toLocaleString('en')} of ${here.toLocaleString('en')} points, ` : ''}${this.city ? 'buildings far away as one, ' : ''}coarser ground${QUALITIES[quality].lines ? '' : ', no lines'}, lower resolution`;
    this.measure();
    if (!quality && this.city) this.city.look();
  }

  // Scale bar and north arrow.
  measure() {
    const step = this.camera.step(this.canvas.clientHeight), rough = 120 * step, power = 10 ** Math.floor(Math.log10(rough));
    const length = [5, 2, 1].map(times => times * power).find(value => value <= rough) || power;
    byId('scale').style.width = `${length / step}px`;
    byId('scale').textContent = `${length < 1 ? length.toFixed(1) : length} m`;
    this.ruler.draw();
    this.tools.draw();
    byId('needle').style.transform = `rotate(${this.camera.azimuth}rad)`;
  }

  // A place [x, y] about the origin, when it lies over the terrain.
  /** @param {Place} place */
  fly(place) {
    const { low, high } = boxOf(this.scene), there = place.every((value, axis) => value >= low[axis] && value <= high[axis]);
    byId('answer').textContent = there ? 'at these coordinates' : 'these coordinates lie outside of what is shown';
    if (!there) return;
    this.camera.flyTo([...place, this.camera.target[2]], 15);
    this.refresh();
  }

  /** @param {number} number */
  describe(number) { describe(byId('building'), this.all[number], number, this.scene); }

  // The building of a number among all; those that are not drawn come after those that are.
  /** @param {number} number @param {boolean} [fly] */
  choose(number, fly = true) {
    this.tell(number, fly);
    this.refresh(); // the points of the chosen building are shown
  }

  // Says in all places what is chosen.
  /** @param {number} number @param {boolean} fly */
  tell(number, fly) {
    const row = this.all[number], spot = this.spots[number];
    this.look.chosen = spot ? number + 1 : 0;
    byId('building').hidden = !row;
    byId('hint').hidden = !!row;
    this.verdicts.choose(row);
    field('find').value = row ? row.id : '';
    document.documentElement.dataset.chosen = row ? row.id : '';
    if (row) {
      this.describe(number);
      const side = byId('controls'), top = byId('building').offsetTop - side.offsetTop;
      if (top > side.scrollTop + side.clientHeight - 200) side.scrollTop = top - 8;
      byId('status').textContent = `building ${row.id} chosen${spot ? '' : ', which is not drawn'}`;
      if (fly && spot && Number.isFinite(spot.low[0])) {
        const { low, high } = spot;
        this.camera.flyTo(low.map((value, axis) => (value + high[axis]) / 2), Math.hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]) / 2);
      }
    }
    this.table?.mark(row ? number : -1);
    for (const done of this.tools?.choosers ?? []) done(row ? number : -1, row);
  }

  /** @param {string} name */
  view(name) {
    const { camera, look } = this;
    if (name === 'above') camera.above(!look.chosen);
    else if (name === 'side') camera.side(this.quarter = (this.quarter + 1) % 4);
    else if (name === 'north') camera.azimuth = 0;
    else if (name === 'oblique') Object.assign(camera, { flat: false, elevation: 0.75 });
    else { camera.reset(); this.quarter = -1; }
    if (name === 'side' && look.chosen) this.choose(look.chosen - 1);
    this.ask();
  }
}
