// 3D Tiles of a run of any size: only what is in sight is loaded. three.js draws, 3d-tiles-renderer chooses the tiles.
import {
  BufferAttribute, BufferGeometry, Color, DirectionalLight, DoubleSide, EdgesGeometry, GLTFExtensionsPlugin, HemisphereLight,
  LineBasicMaterial, LineSegments, MapControls, Matrix4, Mesh, MeshLambertMaterial, PerspectiveCamera, Raycaster, SRGBColorSpace, Scene,
  Sphere, TextureLoader, TilesRenderer, Vector2, Vector3, WebGLRenderer,
} from './three-tiles.js';

const byId = name => document.getElementById(name), root = document.documentElement, canvas = byId('scene');
const EARTH = { far: 5e6, flattened: (6378137 / 6356752.314245) ** 2 };
const ROOF_TYPES = ['flat', 'shed', 'gable', 'hip', 'pyramid', 'complex'], SHARPEST = 15, LEVELS = ['1.2', '1.3', '2.0', '2.2', '2.3'];
const SURFACES = { RoofSurface: 'roof', WallSurface: 'wall', OuterCeilingSurface: 'underside', GroundSurface: 'ground' };
const PLAIN = { roof: '#cf6a50', wall: '#d9d3c5', underside: '#b08968', ground: '#8a8fa3' };

// A colour in linear light, as the vertices hold it.
const linear = ([red, green, blue]) => new Color().setRGB(red / 255, green / 255, blue / 255, SRGBColorSpace);

// Way of colouring → function of a building's row, a kind of surface and the azimuth of a face, with its legend.
function wayOf(name) {
  const pale = bytes('#f4f1ea'), scaled = (scale, value) => ({ at: (row, kind) => kind === 'roof' ? scale.colour(value(row)) : pale, legend: scale.legend });
  if (name === 'azimuth') {
    const scale = scaleOf(CYCLE, 0, 360, '', ['N', 'E', 'S', 'W', 'N']);
    return { at: (row, kind, azimuth) => kind === 'roof' && Number.isFinite(azimuth) ? scale.colour(azimuth) : pale, legend: scale.legend };
  }
  if (name === 'height') return scaled(scaleOf(VIRIDIS, 0, 30, 'm over the ground'), row => row.h_ridge - row.h_ground);
  if (name === 'fit') return scaled(scaleOf(['#3f9b6a', '#e7d04a', '#d23b3b'], 0, 0.5, 'm RMSE'), row => row.rmse_m ?? NaN);
  if (name === 'type') return scaled(setOf(ROOF_TYPES), row => row.roof_type);
  if (name === 'lod') return scaled(setOf(LEVELS, LOD_COLOURS), row => row.lod);
  const scale = setOf(Object.keys(PLAIN), PLAIN);
  return { at: (row, kind) => scale.colour(kind), legend: scale.legend };
}

// From metres east, north and up of a place to the tileset's coordinates, which are Earth-centred or a plane's.
function frameAt(place) {
  if (place.length() < EARTH.far) return new Matrix4().setPosition(place);
  const up = new Vector3(place.x, place.y, place.z * EARTH.flattened).normalize(), east = new Vector3(-place.y, place.x, 0).normalize();
  return new Matrix4().makeBasis(east, up.clone().cross(east), up).setPosition(place);
}

class Viewer {
  constructor(about) {
    this.about = about;
    this.renderer = new WebGLRenderer({ canvas, antialias: true });
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(40, 1, 1, 1e5);
    this.camera.up.set(0, 0, 1);
    this.controls = new MapControls(this.camera, canvas);
    Object.assign(this.controls, { enableDamping: false, zoomToCursor: true, maxPolarAngle: 1.55, keyPanSpeed: 40 });
    this.controls.listenToKeyEvents(canvas);
    const sun = new DirectionalLight('#ffffff', 1.5);
    sun.position.set(-0.6, 0.5, 0.65);
    this.scene.add(sun, new HemisphereLight('#ffffff', '#cfc8ba', 2.1));
    this.models = new Map();
    this.chosen = '';
    this.lines = new LineBasicMaterial({ transparent: true, opacity: 0.55 });
    const tiles = this.tiles = new TilesRenderer('3dtiles/tileset.json');
    tiles.registerPlugin(new GLTFExtensionsPlugin({ metadata: true, rtc: false }));
    tiles.setCamera(this.camera);
    tiles.addEventListener('load-tileset', () => this.place());
    tiles.addEventListener('load-model', ({ scene }) => this.dress(scene));
    tiles.addEventListener('dispose-model', ({ scene }) => this.models.delete(scene));
    tiles.addEventListener('load-error', ({ error }) => this.complain(error));
    for (const name of ['needs-update', 'needs-render', 'tiles-load-end']) tiles.addEventListener(name, () => this.ask());
    this.controls.addEventListener('change', () => this.ask());
    this.controls.addEventListener('end', () => this.keepAddress());
    this.scene.add(tiles.group);
    this.ask();
  }

  complain(error) {
    byId('trouble').textContent = `A part of the scene cannot be shown: ${error.message}.`;
    byId('trouble').hidden = false;
  }

  // Once the tileset is there: its middle becomes the origin, east, north and up the axes.
  place() {
    const sphere = new Sphere();
    if (this.frame || !this.tiles.getBoundingSphere(sphere)) return;
    this.radius = Math.max(30, sphere.radius);
    this.frame = frameAt(sphere.center);
    this.inverse = this.frame.clone().invert();
    const { position, quaternion, scale } = this.tiles.group;
    this.inverse.decompose(position, quaternion, scale);
    this.tiles.group.updateMatrixWorld(true);
    this.home();
    this.obeyAddress();
    this.refresh();
    root.dataset.ready = 'yes';
    this.addGround().catch(error => this.complain(error));
  }

  // The terrain, a mesh over the cells of a grid, with the aerial image where there is one.
  async addGround() {
    const answer = await fetch('ground.json');
    if (!answer.ok) return;
    const { rows, columns, centre, xyz, image } = await answer.json(), whole = await unpackArray(xyz), position = new Float32Array(whole.length);
    const start = new Vector3(...centre).applyMatrix4(this.inverse), turn = new Matrix4().extractRotation(this.inverse), at = new Vector3();
    for (let place = 0; place < whole.length; place += 3) {
      at.set(whole[place] / 1000, whole[place + 1] / 1000, whole[place + 2] / 1000).applyMatrix4(turn).add(start).toArray(position, place);
    }
    const indices = [], uv = new Float32Array(2 * rows * columns), known = place => whole[3 * place] < 2e9;
    for (let row = 0; row < rows; row++) {
      for (let column = 0; column < columns; column++) {
        const a = row * columns + column, [b, c, d] = [a + columns, a + 1, a + columns + 1];
        uv.set([(column + 0.5) / columns, 1 - (row + 0.5) / rows], 2 * a);
        if (row + 1 < rows && column + 1 < columns && [a, b, c, d].every(known)) indices.push(a, b, c, c, b, d);
      }
    }
    const geometry = new BufferGeometry();
    for (const [name, values, size] of [['position', position, 3], ['uv', uv, 2]]) geometry.setAttribute(name, new BufferAttribute(values, size));
    geometry.setIndex(new BufferAttribute(Uint32Array.from(indices), 1));
    geometry.computeVertexNormals();
    this.ground = new Mesh(geometry, new MeshLambertMaterial({ side: DoubleSide, polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 4 }));
    if (image) {
      this.image = await new TextureLoader().loadAsync(image);
      this.image.colorSpace = SRGBColorSpace;
      byId('basemap').parentElement.hidden = false;
    }
    this.scene.add(this.ground);
    this.refresh();
  }

  // A loaded tile: its meshes get a material that takes the vertices' colours, and their sharp edges.
  dress(scene) {
    const table = scene.userData.structuralMetadata, rows = [], meshes = [];
    scene.traverse(mesh => mesh.isMesh && meshes.push(mesh));
    for (const mesh of meshes) {
      mesh.userData.kind = SURFACES[mesh.material.name] || 'wall';
      mesh.material.dispose();
      mesh.material = new MeshLambertMaterial({ vertexColors: true, side: DoubleSide, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
      mesh.add(new LineSegments(new EdgesGeometry(mesh.geometry, SHARPEST), this.lines));
      const numbers = mesh.geometry.attributes._feature_id_0;
      for (let vertex = 0; vertex < numbers.count; vertex++) {
        const number = numbers.getX(vertex);
        rows[number] ??= table.getPropertyTableData([0], [number])[0];
      }
    }
    this.models.set(scene, { rows, meshes });
    this.paint(scene);
    if (this.wanted && rows.some(row => row?.id === this.wanted)) this.choose(this.wanted);
    this.ask();
  }

  paint(scene) {
    const { rows, meshes } = this.models.get(scene), way = this.way ||= wayOf(byId('colour').value), cache = new Map();
    const shade = colour => {
      const key = colour.join();
      if (!cache.has(key)) cache.set(key, linear(colour));
      return cache.get(key);
    };
    const mark = linear(this.shade('--mark'));
    for (const mesh of meshes) {
      const { normal, position, _feature_id_0: numbers } = mesh.geometry.attributes, colours = new Float32Array(3 * position.count);
      for (let vertex = 0; vertex < position.count; vertex++) {
        const row = rows[numbers.getX(vertex)], [east, up, south] = [normal.getX(vertex), normal.getY(vertex), normal.getZ(vertex)];
        const azimuth = up < 0.9994 ? (Math.atan2(east, -south) * 180 / Math.PI + 360) % 360 : NaN;
        const colour = row.id === this.chosen && this.chosen ? mark : shade(way.at(row, mesh.userData.kind, azimuth));
        colour.toArray(colours, 3 * vertex);
      }
      mesh.geometry.setAttribute('color', new BufferAttribute(colours, 3));
    }
  }

  shade(name) { return bytes(getComputedStyle(root).getPropertyValue(name).trim()); }

  refresh() {
    this.scene.background = linear(this.shade('--sky'));
    this.lines.color = linear(this.shade('--line'));
    this.lines.visible = byId('edges').checked;
    this.tiles.group.visible = byId('buildings').checked;
    if (this.ground) {
      const { material } = this.ground, pictured = this.image && byId('basemap').checked;
      this.ground.visible = byId('ground').checked;
      if (!!material.map !== !!pictured) Object.assign(material, { map: pictured ? this.image : null, needsUpdate: true });
      material.color = pictured ? new Color('#ffffff') : linear(this.shade('--earth'));
    }
    this.way = wayOf(byId('colour').value);
    legend(byId('legend'), this.way.legend);
    for (const scene of this.models.keys()) this.paint(scene);
    this.ask();
  }

  ask() {
    root.dataset.still = 'no';
    this.asked ??= requestAnimationFrame(() => this.draw());
  }

  draw() {
    this.asked = null;
    const { camera, controls, renderer, tiles } = this, [width, height] = [canvas.parentElement.clientWidth, canvas.parentElement.clientHeight];
    const away = camera.position.distanceTo(controls.target), size = renderer.getSize(new Vector2()), ratio = Math.min(2, devicePixelRatio);
    if (size.x !== width || size.y !== height || renderer.getPixelRatio() !== ratio) {
      renderer.setPixelRatio(ratio);
      renderer.setSize(width, height, false);
    }
    Object.assign(camera, { aspect: width / Math.max(1, height), near: Math.max(0.5, away / 500), far: away + 6 * (this.radius || 1e5) });
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
    tiles.setResolutionFromRenderer(camera, renderer);
    tiles.update();
    renderer.render(this.scene, camera);
    const { downloading = 0, parsing = 0, queued = 0 } = tiles.stats;
    if (this.frame && !downloading && !parsing && !queued && !this.asked) {
      const rows = [...tiles.visibleTiles].reduce((sum, tile) => sum + (this.models.get(tile.engineData?.scene ?? tile.cached?.scene)?.rows.length || 0), 0);
      byId('shown').textContent = `${rows.toLocaleString('en')} of ${this.about.buildings.toLocaleString('en')} buildings in sight`;
      root.dataset.still = 'yes';
    }
  }

  look(eye, target) {
    this.camera.position.fromArray(eye);
    this.controls.target.fromArray(target);
    this.controls.update();
    this.camera.updateMatrixWorld();
    this.ask();
  }

  home() { this.look([-0.35 * this.radius, -1.2 * this.radius, 1.05 * this.radius], [0, -0.08 * this.radius, 0]); }

  view(name) {
    const { x, y, z } = this.controls.target, away = this.camera.position.distanceTo(this.controls.target);
    if (name === 'above') this.look([x, y - 0.001 * away, z + away], [x, y, z]);
    else if (name === 'north') this.look([x, y - 0.65 * away, z + 0.76 * away], [x, y, z]);
    else this.home();
    this.keepAddress();
  }

  // The building under a place of the canvas; its id, or nothing.
  pick(x, y) {
    const ray = new Raycaster();
    ray.firstHitOnly = true;
    ray.setFromCamera(new Vector2(2 * x / canvas.clientWidth - 1, 1 - 2 * y / canvas.clientHeight), this.camera);
    const hit = ray.intersectObject(this.tiles.group, true).find(({ object }) => object.isMesh);
    if (!hit) return '';
    for (const { rows, meshes } of this.models.values()) {
      if (meshes.includes(hit.object)) return rows[hit.object.geometry.attributes._feature_id_0.getX(hit.face.a)].id;
    }
    return '';
  }

  choose(id) {
    this.chosen = this.wanted = id;
    root.dataset.chosen = id;
    byId('find').value = id;
    const box = byId('building'), row = [...this.models.values()].flatMap(({ rows }) => rows).find(one => one?.id === id);
    box.hidden = !row;
    if (row) {
      const list = element('dl');
      for (const [name, value] of Object.entries(row)) {
        if (value === null || value === undefined || value === '' || name === 'id') continue;
        const [label, meaning] = this.about.columns[name] || [name, ''];
        list.append(element('dt', { title: meaning }, label), element('dd', {}, figure(value)));
      }
      box.replaceChildren(element('h2', {}, id), list);
    }
    byId('status').textContent = row ? `building ${id} chosen` : id ? `no building in sight has the id ${id}` : '';
    for (const scene of this.models.keys()) this.paint(scene);
    this.ask();
  }

  // Behind '#': eye=…&colour=type&off=edges&id=…&theme=dark
  keepAddress() {
    const settings = new URLSearchParams(), off = [...document.querySelectorAll('#controls input[type=checkbox]')].filter(box => !box.checked);
    if (root.dataset.theme) settings.set('theme', root.dataset.theme);
    if (byId('colour').value !== 'surface') settings.set('colour', byId('colour').value);
    if (off.length) settings.set('off', off.map(box => box.id).join());
    if (this.chosen) settings.set('id', this.chosen);
    settings.set('eye', [...this.camera.position.toArray(), ...this.controls.target.toArray()].map(value => Number(value.toFixed(2))).join());
    history.replaceState(null, '', `#${settings.toString().replaceAll('%2C', ',')}`);
  }

  obeyAddress() {
    const given = new URLSearchParams(location.hash.slice(1)), eye = (given.get('eye') || '').split(',').map(Number);
    if (given.has('theme')) root.dataset.theme = given.get('theme');
    if (given.has('colour')) byId('colour').value = given.get('colour');
    const off = (given.get('off') || '').split(',');
    for (const box of document.querySelectorAll('#controls input[type=checkbox]')) box.checked = !off.includes(box.id);
    if (eye.length === 6 && eye.every(Number.isFinite)) this.look(eye.slice(0, 3), eye.slice(3));
    this.choose(given.get('id') || '');
  }
}

function listen(viewer) {
  let down = [0, 0];
  canvas.addEventListener('pointerdown', event => { down = [event.clientX, event.clientY]; });
  canvas.addEventListener('pointerup', event => {
    const box = canvas.getBoundingClientRect();
    if (event.button === 0 && Math.hypot(event.clientX - down[0], event.clientY - down[1]) < 4) {
      viewer.choose(viewer.pick(event.clientX - box.left, event.clientY - box.top));
      viewer.keepAddress();
    }
  });
  canvas.addEventListener('keydown', event => event.key === 'Escape' && viewer.choose(''));
  const changed = () => { viewer.refresh(); viewer.keepAddress(); };
  for (const control of document.querySelectorAll('#controls input[type=checkbox], #controls select')) control.addEventListener('input', changed);
  for (const button of document.querySelectorAll('[data-view]')) button.addEventListener('click', () => viewer.view(button.dataset.view));
  byId('find').addEventListener('change', () => { viewer.choose(byId('find').value.trim()); viewer.keepAddress(); });
  byId('theme').addEventListener('click', () => {
    const dark = root.dataset.theme ? root.dataset.theme === 'dark' : matchMedia('(prefers-color-scheme: dark)').matches;
    root.dataset.theme = dark ? 'light' : 'dark';
    changed();
  });
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => viewer.refresh());
  new ResizeObserver(() => viewer.ask()).observe(canvas.parentElement);
  addEventListener('hashchange', () => { viewer.obeyAddress(); viewer.refresh(); });
}

try {
  const about = await (await fetch('about.json')).json();
  document.title = byId('title').textContent = about.title;
  byId('headline').textContent = about.headline;
  if (about.page) byId('links').append(element('a', { href: about.page }, 'Report'));
  const viewer = window.eaves = new Viewer(about);
  listen(viewer);
} catch (error) {
  byId('trouble').textContent = `No 3D view: ${error.message}.`;
  byId('trouble').hidden = false;
  root.dataset.ready = 'no';
}
