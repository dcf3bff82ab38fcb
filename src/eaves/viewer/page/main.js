// Everything together: decode, build the layers, listen.
const byId = name => document.getElementById(name);
const page = JSON.parse(byId('data').textContent);

function readData(arrays) {
  const points = {
    xyz: metres(arrays.point_xyz), classification: arrays.point_class, building: arrays.point_building,
    plane: arrays.point_plane, distance: arrays.point_distance, count: arrays.point_class.length, base: page.base,
  };
  const triangles = {
    xyz: metres(arrays.triangle_xyz), building: arrays.triangle_building, lod: arrays.triangle_lod,
    kind: arrays.triangle_kind, count: arrays.triangle_lod.length,
  };
  Object.assign(triangles, slopes(triangles));
  const edges = { xyz: metres(arrays.edge_xyz), building: arrays.edge_building, lod: arrays.edge_lod, count: arrays.edge_lod.length };
  const prints = { xyz: metres(arrays.outline_xyz), building: arrays.outline_building, count: arrays.outline_building.length };
  const terrain = { ...page.terrain, heights: metres(arrays.terrain) };
  return { points, triangles, edges, prints, terrain, rows: page.rows };
}

// Slope and azimuth (degrees, clockwise from north) of every triangle.
function slopes({ xyz, count }) {
  const slope = new Float32Array(count), azimuth = new Float32Array(count);
  for (let number = 0; number < count; number++) {
    const [a, b, c] = [0, 3, 6].map(corner => xyz.subarray(9 * number + corner, 9 * number + corner + 3));
    const one = b.map((value, axis) => value - a[axis]), two = c.map((value, axis) => value - a[axis]);
    const normal = [one[1] * two[2] - one[2] * two[1], one[2] * two[0] - one[0] * two[2], one[0] * two[1] - one[1] * two[0]];
    const up = Math.abs(normal[2]) / (Math.hypot(...normal) || 1);
    slope[number] = Math.acos(Math.min(1, up)) * 180 / Math.PI;
    azimuth[number] = (Math.atan2(normal[0], normal[1]) * 180 / Math.PI + 360) % 360;
  }
  return { slope, azimuth };
}

const repeated = (numbers, times) => {
  const out = new Uint32Array(numbers.length * times);
  for (let place = 0; place < out.length; place++) out[place] = numbers[Math.floor(place / times)];
  return out;
};

function terrainMesh({ rows, columns, cell, west, north, heights }) {
  const position = new Float32Array(3 * rows * columns), indices = [];
  const missing = place => heights[place] > 1e6;
  for (let row = 0, place = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++, place++) {
      position.set([west + (column + 0.5) * cell, north - (row + 0.5) * cell, missing(place) ? 0 : heights[place]], 3 * place);
      const corners = [place, place + columns, place + 1, place + columns + 1];
      if (row + 1 < rows && column + 1 < columns && !corners.some(missing)) indices.push(...[0, 1, 2, 2, 1, 3].map(corner => corners[corner]));
    }
  }
  return { position, indices: new Uint32Array(indices) };
}

function boxOf(scene) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  const grow = xyz => { for (let place = 0; place < xyz.length; place++) { low[place % 3] = Math.min(low[place % 3], xyz[place]); high[place % 3] = Math.max(high[place % 3], xyz[place]); } };
  grow(scene.ground.position);
  grow(scene.triangles.xyz);
  if (!Number.isFinite(low[0])) grow(scene.points.xyz);
  return Number.isFinite(low[0]) ? { low, high } : { low: [-5, -5, -5], high: [5, 5, 5] };
}

class Viewer {
  constructor(scene) {
    this.scene = scene;
    scene.ground = terrainMesh(scene.terrain);
    const canvas = this.canvas = byId('scene');
    this.camera = new Camera(boxOf(scene), canvas.clientWidth / Math.max(1, canvas.clientHeight));
    const painter = this.painter = new Painter(canvas);
    const { points, triangles, edges, prints, ground } = scene;
    this.layers = {
      ground: painter.add('triangles', ground.position, new Uint32Array(ground.position.length / 3), { shaded: true, indices: ground.indices, pickable: false }),
      models: painter.add('triangles', triangles.xyz, repeated(triangles.building, 3), { shaded: true, strength: 0.25 }),
      edges: painter.add('lines', edges.xyz, repeated(edges.building, 2), { pickable: false, strength: 1 }),
      prints: painter.add('lines', prints.xyz, repeated(prints.building, 2), { strength: 1 }),
      points: painter.add('points', points.xyz, Uint32Array.from(points.building)),
    };
    this.look = { background: [1, 1, 1], mark: [1, 0.6, 0], chosen: 0, only: false, pointSize: 0.35 };
    this.finest = new Map();
    for (let number = 0; number < triangles.count; number++) {
      const row = triangles.building[number];
      this.finest.set(row, Math.max(this.finest.get(row) || 0, triangles.lod[number]));
    }
    this.measureBuildings();
    new ResizeObserver(() => this.ask()).observe(canvas);
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.refresh());
  }

  // The middle and half the size of every building, from its outline.
  measureBuildings() {
    const { prints, triangles, rows } = this.scene;
    this.spots = rows.map(() => ({ low: [Infinity, Infinity, Infinity], high: [-Infinity, -Infinity, -Infinity] }));
    const grow = (xyz, building, width) => {
      for (let place = 0; place < xyz.length; place++) {
        const spot = this.spots[building[Math.floor(place / width)] - 1], axis = place % 3;
        spot.low[axis] = Math.min(spot.low[axis], xyz[place]);
        spot.high[axis] = Math.max(spot.high[axis], xyz[place]);
      }
    };
    grow(prints.xyz, prints.building, 6);
    grow(triangles.xyz, triangles.building, 9);
  }

  checked(name) { return byId(name).checked; }

  // Colours and visibility from the controls; a colour without opacity is not drawn.
  refresh() {
    const { scene, painter, layers } = this, { points, triangles, edges, prints, ground } = scene;
    const style = getComputedStyle(document.documentElement), shade = name => bytes(style.getPropertyValue(name).trim());
    this.look.background = shade('--sky').map(value => value / 255);
    this.look.mark = shade('--mark').map(value => value / 255);
    this.look.only = this.checked('only');
    const size = Number(byId('size').value);
    this.look.pointSize = 0.35 * size;

    const fill = (count, times, colour) => {
      const out = new Uint8Array(4 * count * times);
      for (let number = 0; number < count; number++) {
        const answer = colour(number);
        if (!answer) continue;
        for (let copy = 0, place = 4 * number * times; copy < times; copy++, place += 4) {
          out[place] = answer[0]; out[place + 1] = answer[1]; out[place + 2] = answer[2]; out[place + 3] = 255;
        }
      }
      return out;
    };
    const earth = shade('--earth'), line = shade('--line'), outline = shade('--outline');
    painter.recolour(layers.ground, fill(ground.position.length / 3, 1, () => this.checked('ground') ? earth : null));

    const pointWay = pointColours(byId('point-colour').value, scene), [on, under, other] = ['points-building', 'points-ground', 'points-other'].map(name => this.checked(name));
    painter.recolour(layers.points, fill(points.count, 1, number => {
      const wanted = points.building[number] ? on : points.classification[number] === 2 ? under : other;
      return wanted ? pointWay.at(number) : null;
    }));

    const wantedLod = page.lods.indexOf(byId('lod').value), shown = (lod, row) => wantedLod < 0 ? lod === this.finest.get(row) : lod === wantedLod;
    const modelWay = modelColours(byId('model-colour').value, scene), [roofs, walls] = [this.checked('roofs'), this.checked('walls')];
    const red = bytes(LOD_COLOURS.none);
    painter.recolour(layers.models, fill(triangles.count, 3, number => {
      const row = triangles.building[number], kind = triangles.kind[number];
      if (!shown(triangles.lod[number], row) || !(kind === 1 ? walls : roofs)) return null;
      return this.finest.get(row) === 0 && wantedLod < 0 && page.modelled ? red : modelWay.at(number, row - 1);
    }));
    painter.recolour(layers.edges, fill(edges.count, 2, number => (this.checked('edges') && edges.lod[number] > 0 && shown(edges.lod[number], edges.building[number]) ? line : null)));
    painter.recolour(layers.prints, fill(prints.count, 2, () => this.checked('prints') ? outline : null));
    legend(byId('point-legend'), pointWay.legend);
    legend(byId('model-legend'), modelWay.legend);
    this.ask();
  }

  ask() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      this.painter.resize();
      this.camera.aspect = this.canvas.clientWidth / Math.max(1, this.canvas.clientHeight);
      this.painter.paint(this.camera, this.look);
      this.measure();
    });
  }

  // Scale bar and north arrow.
  measure() {
    const step = this.camera.step(this.canvas.clientHeight), rough = 120 * step, power = 10 ** Math.floor(Math.log10(rough));
    const length = [5, 2, 1].map(times => times * power).find(value => value <= rough) || power;
    byId('scale').style.width = `${length / step}px`;
    byId('scale').textContent = `${length < 1 ? length.toFixed(1) : length} m`;
    byId('needle').style.transform = `rotate(${this.camera.azimuth}rad)`;
  }

  choose(number, fly = true) {
    const row = this.scene.rows[number];
    this.look.chosen = row ? number + 1 : 0;
    byId('building').hidden = !row;
    byId('find').value = row ? row.id : '';
    document.documentElement.dataset.chosen = row ? row.id : '';
    if (row) {
      describe(byId('building'), row, number, this.scene);
      byId('said').textContent = `building ${row.id} chosen`;
      if (fly) {
        const { low, high } = this.spots[number];
        if (Number.isFinite(low[0])) this.camera.flyTo(low.map((value, axis) => (value + high[axis]) / 2), Math.hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]) / 2);
      }
    }
    this.table.mark(number);
    this.ask();
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

function legend(box, { words, colours, low, high, unit, text, names, shift = 0 }) {
  box.replaceChildren();
  if (text) box.append(text);
  for (const [word, colour] of words || []) box.append(element('span', { class: 'key' }, element('i', { style: `background:${colour}` }), word));
  if (colours) {
    const ends = names || [low, high].map(value => (value + shift).toFixed(Math.abs(high - low) < 2 ? 1 : 0));
    box.append(element('span', { class: 'ramp', style: `background:linear-gradient(90deg,${colours})` }), element('span', { class: 'ends' }, ...ends.map(end => element('span', {}, end))), unit || '');
  }
}
