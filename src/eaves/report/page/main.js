// Everything together: decode, build the layers, handle events.
const byId = name => document.getElementById(name);
const page = JSON.parse(byId('data').textContent);

// A scene out of arrays: what the page embeds, or one square of a city. It brings along all that is computed once.
function readScene(arrays, terrain = page.terrain) {
  const order = shuffled(arrays.point_class.length), mixed = (values, width) => reordered(values, order, width);
  const epochsOf = (values, count) => values || new Uint8Array(count);
  const points = {
    xyz: metres(mixed(arrays.point_xyz, 3)), epochs: mixed(epochsOf(arrays.point_epoch, order.length), 1), classification: mixed(arrays.point_class, 1), building: mixed(arrays.point_building, 1),
    plane: mixed(arrays.point_plane, 1), distance: mixed(arrays.point_distance, 1), count: order.length, base: page.base,
  };
  const triangles = {
    xyz: metres(arrays.triangle_xyz), building: arrays.triangle_building, lod: arrays.triangle_lod,
    epochs: epochsOf(arrays.triangle_epoch, arrays.triangle_lod.length), kind: arrays.triangle_kind, error: arrays.triangle_error, count: arrays.triangle_lod.length,
  };
  Object.assign(triangles, slopes(triangles));
  const edges = { xyz: metres(arrays.edge_xyz), building: arrays.edge_building, lod: arrays.edge_lod, epochs: epochsOf(arrays.edge_epoch, arrays.edge_lod.length), count: arrays.edge_lod.length };
  const prints = { xyz: metres(arrays.outline_xyz), building: arrays.outline_building, epochs: epochsOf(arrays.outline_epoch, arrays.outline_building.length), count: arrays.outline_building.length };
  const grounds = readGrounds(arrays.terrain, terrain, triangles);
  points.over = pointsOverRoofs(points, triangles);
  return { points, triangles, edges, prints, grounds };
}

// The terrain of every epoch as a mesh, shaded by what stands on it.
function readGrounds(whole, terrain, triangles) {
  const heights = metres(whole), cells = terrain.rows * terrain.columns;
  return (page.epochs ? [1, 2] : [0]).map((epoch, place) => {
    const grid = { ...terrain, epoch, heights: heights.subarray(place * cells, (place + 1) * cells) };
    return { ...terrainMesh(grid), light: groundShade(grid, triangles) };
  });
}

// Several scenes as one: their arrays end to end.
function joined(scenes) {
  if (scenes.length === 1) return scenes[0];
  const join = parts => Object.fromEntries(Object.entries(parts[0]).map(([name, first]) => {
    if (name === 'count') return [name, parts.reduce((sum, part) => sum + part.count, 0)];
    if (!ArrayBuffer.isView(first)) return [name, first];
    const all = new first.constructor(parts.reduce((sum, part) => sum + part[name].length, 0));
    let place = 0;
    for (const part of parts) {
      all.set(part[name], place);
      place += part[name].length;
    }
    return [name, all];
  }));
  const [points, triangles, edges, prints] = ['points', 'triangles', 'edges', 'prints'].map(name => join(scenes.map(scene => scene[name])));
  return { points, triangles, edges, prints, grounds: scenes.flatMap(scene => scene.grounds) };
}

// The numbers below `count` in an order without a pattern, the same every time: the first of them are a fair sample.
function shuffled(count) {
  const order = Uint32Array.from({ length: count }, (_, place) => place);
  for (let place = count - 1, state = 1; place > 0; place--) {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    const other = Math.floor(state / 2 ** 32 * (place + 1)), kept = order[place];
    order[place] = order[other];
    order[other] = kept;
  }
  return order;
}

function reordered(values, order, width) {
  const out = new values.constructor(values.length);
  for (let place = 0; place < order.length; place++) for (let k = 0; k < width; k++) out[width * place + k] = values[width * order[place] + k];
  return out;
}

// Slope and azimuth (degrees, clockwise from north) of every triangle.
function slopes({ xyz, count }) {
  const slope = new Float32Array(count), azimuth = new Float32Array(count);
  for (let number = 0, at = 0; number < count; number++, at += 9) {
    const ux = xyz[at + 3] - xyz[at], uy = xyz[at + 4] - xyz[at + 1], uz = xyz[at + 5] - xyz[at + 2];
    const vx = xyz[at + 6] - xyz[at], vy = xyz[at + 7] - xyz[at + 1], vz = xyz[at + 8] - xyz[at + 2];
    const east = uy * vz - uz * vy, north = uz * vx - ux * vz, up = ux * vy - uy * vx;
    slope[number] = Math.acos(Math.min(1, Math.abs(up) / (Math.hypot(east, north, up) || 1))) * 180 / Math.PI;
    azimuth[number] = (Math.atan2(east, north) * 180 / Math.PI + 360) % 360;
  }
  return { slope, azimuth };
}

const repeated = (numbers, times) => {
  const out = new Uint32Array(numbers.length * times);
  for (let place = 0; place < out.length; place++) out[place] = numbers[Math.floor(place / times)];
  return out;
};

// A terrain's vertices, and its triangles over every cell, every second, fourth and eighth.
function terrainMesh({ rows, columns, cell, west, north, heights, epoch }) {
  const position = new Float32Array(3 * rows * columns), missing = place => heights[place] > 1e6;
  for (let row = 0, place = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++, place++) position.set([west + (column + 0.5) * cell, north - (row + 0.5) * cell, missing(place) ? 0 : heights[place]], 3 * place);
  }
  const stops = (count, step) => [...new Set([...Array(Math.ceil(count / step)).keys()].map(k => k * step).concat(Math.max(0, count - 1)))];
  const details = [1, 2, 4, 8].map(step => {
    const indices = [], down = stops(rows, step), along = stops(columns, step);
    for (let i = 0; i + 1 < down.length; i++) {
      for (let j = 0; j + 1 < along.length; j++) {
        const [a, b, c, d] = [down[i] * columns + along[j], down[i + 1] * columns + along[j], down[i] * columns + along[j + 1], down[i + 1] * columns + along[j + 1]];
        if (!missing(a) && !missing(b) && !missing(c) && !missing(d)) indices.push(a, b, c, c, b, d);
      }
    }
    return Uint32Array.from(indices);
  });
  return { position, details, epoch };
}

function boxOf(scene) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  const grow = xyz => { for (let place = 0; place < xyz.length; place++) { low[place % 3] = Math.min(low[place % 3], xyz[place]); high[place % 3] = Math.max(high[place % 3], xyz[place]); } };
  for (const ground of scene.grounds) grow(ground.position);
  grow(scene.triangles.xyz);
  if (!Number.isFinite(low[0])) grow(scene.points.xyz);
  return Number.isFinite(low[0]) ? { low, high } : { low: [-5, -5, -5], high: [5, 5, 5] };
}

// A number for each building in each epoch.
const modelOf = ({ building, epochs }, number) => 3 * building[number] + epochs[number];

// The lowest and the highest place of every building, of its outline and models.
function spotsOf({ prints, triangles, rows }) {
  const spots = rows.map(() => ({ low: [Infinity, Infinity, Infinity], high: [-Infinity, -Infinity, -Infinity] }));
  const grow = (xyz, building, width) => {
    for (let place = 0; place < xyz.length; place++) {
      const spot = spots[building[Math.floor(place / width)] - 1], axis = place % 3;
      spot.low[axis] = Math.min(spot.low[axis], xyz[place]);
      spot.high[axis] = Math.max(spot.high[axis], xyz[place]);
    }
  };
  grow(prints.xyz, prints.building, 6);
  grow(triangles.xyz, triangles.building, 9);
  return spots;
}

// What is neither ground nor building, mostly trees, lets what stands behind it through.
const OTHER_OPACITY = 0.45;

class Viewer {
  constructor(scene, all) {
    Object.assign(this, { all, table: null, city: null, origin: page.origin });
    const canvas = this.canvas = byId('scene');
    this.camera = new Camera(boxOf(scene), canvas.clientWidth / Math.max(1, canvas.clientHeight));
    this.painter = new Painter(canvas);
    this.pace = new Pace(this.painter, () => this.before(), quality => this.after(quality));
    this.look = { background: [1, 1, 1], mark: [1, 0.6, 0], chosen: 0, only: false, pointSize: 0.35 };
    this.spots = spotsOf(scene);
    this.load(scene);
    this.ruler = new Ruler(this);
    this.profile = new Profile(this);
    this.verdicts = new Verdicts();
    this.epochs = new Epochs(this);
    this.network = new Network(this);
    new ResizeObserver(() => this.ask()).observe(canvas);
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.refresh());
  }

  // Draws a scene in place of the one before.
  load(scene) {
    const { painter } = this, { points, triangles, edges, prints, grounds } = scene;
    this.scene = scene;
    painter.clear();
    this.layers = {
      grounds: grounds.map(({ position }) => painter.add('triangles', position, new Uint32Array(position.length / 3), { shaded: true })),
      models: painter.add('triangles', triangles.xyz, repeated(triangles.building, 3), { shaded: true, strength: 0.25 }),
      edges: painter.add('lines', edges.xyz, repeated(edges.building, 2), { strength: 1, minor: true, fades: true }),
      prints: painter.add('lines', prints.xyz, repeated(prints.building, 2), { strength: 1, minor: true }),
      points: painter.add('points', points.xyz, Uint32Array.from(points.building)),
      other: painter.add('points', points.xyz, new Uint32Array(points.count), { opacity: OTHER_OPACITY }),
    };
    this.finest = new Uint8Array(3 * (scene.rows.length + 1));
    for (let number = 0; number < triangles.count; number++) {
      const model = modelOf(triangles, number);
      this.finest[model] = Math.max(this.finest[model], triangles.lod[number]);
    }
  }

  // The aerial image of the page over the terrain.
  async addImage(address) {
    const image = new Image(), { rows, columns, cell, west, north } = page.terrain, [wide, tall] = [columns * cell, rows * cell];
    image.src = address;
    await image.decode();
    this.painter.picture(image, [-west / wide, 1 / wide, 0, 0, 0, 0, north / tall, 0, -1 / tall, 0, 0, 0]);
    byId('basemap').parentElement.hidden = false;
  }

  checked(name) { return byId(name).checked; }

  // Colours and visibility from the controls; what has no colour is not drawn.
  refresh() {
    const { scene, painter, layers } = this, { points, triangles, edges, prints, grounds } = scene;
    const style = getComputedStyle(document.documentElement), shade = name => bytes(style.getPropertyValue(name).trim());
    this.look.background = shade('--sky').map(value => value / 255);
    this.look.mark = shade('--mark').map(value => value / 255);
    this.look.only = this.checked('only');
    const size = Number(byId('size').value);
    this.look.pointSize = 0.35 * size;

    // Colours the `count` things of a layer, `width` vertices each, and draws those that get a colour.
    const dress = (layer, { epochs, count }, width, colour, bright = null) => {
      const colours = new Uint8Array(4 * count * width), list = new Uint32Array(count * width);
      let end = 0;
      for (let number = 0; number < count; number++) {
        const answer = colour(number);
        if (!answer) continue;
        for (let vertex = number * width; vertex < (number + 1) * width; vertex++) {
          const light = bright ? bright(vertex, number) : 1;
          for (let band = 0; band < 3; band++) colours[4 * vertex + band] = light * answer[band];
          colours[4 * vertex + 3] = epochs[number];
          list[end++] = vertex;
        }
      }
      painter.recolour(layer, colours);
      painter.show(layer, list.slice(0, end));
    };
    const earth = shade('--earth'), line = shade('--line'), outline = shade('--outline');
    layers.grounds.forEach((layer, place) => {
      const { position, light, details, epoch } = grounds[place], count = position.length / 3;
      layer.pictured = !!painter.lay && this.checked('basemap');
      dress(layer, { epochs: new Uint8Array(count).fill(epoch), count }, 1, () => layer.pictured ? [255, 255, 255] : earth, vertex => this.look.only ? 1 : light[vertex]); // no shade of hidden buildings
      painter.show(layer, ...(this.checked('ground') ? details : [new Uint32Array(0)]));
    });

    const pointWay = pointColours(byId('point-colour').value, scene), [on, under, other] = ['points-building', 'points-ground', 'points-other'].map(name => this.checked(name));
    const foreign = number => !points.building[number] && points.classification[number] !== 2;
    dress(layers.points, points, 1, number => !foreign(number) && (points.building[number] ? on || points.building[number] === this.look.chosen : under) ? pointWay.at(number) : null);
    dress(layers.other, points, 1, number => foreign(number) && other && !this.look.only && !points.over[number] ? pointWay.at(number) : null);

    const wantedLod = page.lods.indexOf(byId('lod').value), shown = (things, number) => things.lod[number] === BOX || things.lod[number] === (wantedLod < 0 ? this.finest[modelOf(things, number)] : wantedLod);
    const modelWay = modelColours(byId('model-colour').value, scene), [roofs, walls] = [this.checked('roofs'), this.checked('walls')];
    const red = bytes(LOD_COLOURS.none);
    dress(layers.models, triangles, 3, number => {
      const row = triangles.building[number], kind = triangles.kind[number];
      if (!shown(triangles, number) || !(kind === 2 ? roofs : walls)) return null;
      return triangles.lod[number] === 0 && wantedLod < 0 && page.modelled ? red : modelWay.at(number, row - 1);
    }, (vertex, number) => triangles.kind[number] === 1 ? wallShade(triangles.xyz[3 * vertex + 2] - this.spots[triangles.building[number] - 1].low[2]) : 1);
    if (this.city) painter.show(layers.models, layers.models.shown, layers.models.shown, layers.models.shown.filter(vertex => triangles.lod[Math.floor(vertex / 3)] !== BOX || triangles.kind[Math.floor(vertex / 3)] === 2));
    dress(layers.edges, edges, 2, number => (this.checked('edges') && edges.lod[number] > 0 && shown(edges, number) ? line : null));
    dress(layers.prints, prints, 2, () => this.checked('prints') ? outline : null);
    legend(byId('point-legend'), layers.points.shown.length + layers.other.shown.length ? pointWay.legend : { text: 'no points are shown' });
    legend(byId('model-legend'), modelWay.legend);
    this.ask();
  }

  ask() { this.pace.ask(); }

  // Where the eye is and what is wanted, for the picture that is drawn next.
  before() {
    this.camera.aspect = this.canvas.clientWidth / Math.max(1, this.canvas.clientHeight);
    this.look.split = this.epochs.share();
    return [this.camera, this.look];
  }

  // Says what the picture leaves out.
  after(quality) {
    const counts = [this.layers.points, this.layers.other].map(layer => layer.shown.length), sum = (one, two) => one + two;
    const here = counts.reduce(sum), drawn = counts.map(count => Math.min(count, QUALITIES[quality].points)).reduce(sum);
    byId('moving').hidden = !quality;
    if (quality) byId('moving').textContent = `While it moves: ${drawn < here ? `${drawn.toLocaleString('en')} of ${here.toLocaleString('en')} points, ` : ''}coarser ground${QUALITIES[quality].lines ? '' : ', no lines'}, lower resolution`;
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
    byId('needle').style.transform = `rotate(${this.camera.azimuth}rad)`;
  }

  // A place [x, y] about the origin, when it lies over the terrain.
  fly(place) {
    const { low, high } = boxOf(this.scene), there = place.every((value, axis) => value >= low[axis] && value <= high[axis]);
    byId('answer').textContent = there ? 'at these coordinates' : 'these coordinates lie outside of what is shown';
    if (!there) return;
    this.camera.flyTo([...place, this.camera.target[2]], 15);
    this.refresh();
  }

  describe(number) { describe(byId('building'), this.all[number], number, this.scene); }

  // The building of a number among all; those that are not drawn come after those that are.
  choose(number, fly = true) {
    const row = this.all[number], spot = this.spots[number];
    this.look.chosen = spot ? number + 1 : 0;
    byId('building').hidden = !row;
    byId('hint').hidden = !!row;
    this.verdicts.choose(row);
    byId('find').value = row ? row.id : '';
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
    this.refresh(); // the points of the chosen building are shown
  }

  view(name) {
    const { camera, look } = this;
    if (name === 'above') camera.above(!look.chosen);
    else if (name === 'side') camera.side(this.quarter = ((this.quarter ?? -1) + 1) % 4);
    else if (name === 'north') camera.azimuth = 0;
    else if (name === 'oblique') Object.assign(camera, { flat: false, elevation: 0.75 });
    else { camera.reset(); this.quarter = -1; }
    if (name === 'side' && look.chosen) this.choose(look.chosen - 1);
    this.ask();
  }
}
