// Mouse, fingers, keys and the controls.
function listenToCanvas(viewer) {
  const { canvas, camera } = viewer, down = new Map();
  let moved = 0;
  canvas.addEventListener('pointerdown', event => {
    canvas.setPointerCapture(event.pointerId);
    down.set(event.pointerId, [event.clientX, event.clientY]);
    moved = 0;
  });
  canvas.addEventListener('pointermove', event => {
    if (!down.has(event.pointerId)) return;
    const [x, y] = down.get(event.pointerId), [right, lower] = [event.clientX - x, event.clientY - y];
    moved += Math.hypot(right, lower);
    if (down.size === 2) {
      const [other] = [...down].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
      camera.zoom(Math.hypot(x - other[0], y - other[1]) / Math.max(1, Math.hypot(event.clientX - other[0], event.clientY - other[1])));
      camera.pan(right / 2, lower / 2, canvas.clientHeight);
    } else if (event.buttons & 6 || event.shiftKey || event.ctrlKey) camera.pan(right, lower, canvas.clientHeight);
    else camera.turn(-right * 0.006, lower * 0.006);
    down.set(event.pointerId, [event.clientX, event.clientY]);
    viewer.ask();
  });
  const lift = event => {
    const box = canvas.getBoundingClientRect();
    if (down.delete(event.pointerId) && moved < 4 && event.type === 'pointerup' && event.button === 0) {
      const place = [event.clientX - box.left, event.clientY - box.top];
      if (viewer.ruler.active) viewer.ruler.take(...place);
      else viewer.choose(pickBuilding(viewer, ...place) - 1, false);
      viewer.ask();
    }
  };
  canvas.addEventListener('pointerup', lift);
  canvas.addEventListener('pointercancel', lift);
  canvas.addEventListener('dblclick', () => !viewer.ruler.active && viewer.look.chosen && viewer.choose(viewer.look.chosen - 1));
  canvas.addEventListener('contextmenu', event => event.preventDefault());
  canvas.addEventListener('wheel', event => {
    event.preventDefault();
    camera.zoom(Math.exp(Math.max(-0.4, Math.min(0.4, event.deltaY * (event.deltaMode ? 0.04 : 0.0015)))));
    viewer.ask();
  }, { passive: false });
  canvas.addEventListener('keydown', event => {
    const arrows = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key], count = viewer.scene.rows.length;
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (arrows && event.shiftKey) camera.pan(40 * arrows[0], 40 * arrows[1], canvas.clientHeight);
    else if (arrows) camera.turn(-0.1 * arrows[0], 0.1 * arrows[1]);
    else if ('+='.includes(event.key)) camera.zoom(0.85);
    else if ('-_'.includes(event.key)) camera.zoom(1 / 0.85);
    else if (event.key === 'Escape' && viewer.ruler.active) viewer.ruler.toggle(false);
    else if (event.key === 'Escape') viewer.choose(-1);
    else if (event.key === 'm') viewer.ruler.toggle();
    else if (event.key === 'l') viewer.profile.toggle();
    else if ('nNpP'.includes(event.key) && count) viewer.choose((viewer.look.chosen - 1 + ('nN'.includes(event.key) ? 1 : -1) + count + (viewer.look.chosen ? 0 : 'nN'.includes(event.key) ? 0 : 1)) % count);
    else if ({ h: 1, a: 1, s: 1, o: 1 }[event.key]) viewer.view({ h: 'home', a: 'above', s: 'side', o: 'oblique' }[event.key]);
    else if (event.key === '/') byId('find').focus();
    else return;
    event.preventDefault();
    viewer.ask();
  });
}

function listenToControls(viewer) {
  for (const control of document.querySelectorAll('#controls input:not([type=text]), #controls select')) control.addEventListener('input', () => viewer.refresh());
  for (const button of document.querySelectorAll('[data-view]')) button.addEventListener('click', () => viewer.view(button.dataset.view));
  const find = byId('find');
  find.addEventListener('change', () => {
    byId('answer').textContent = '';
    const wanted = find.value.trim(), { all } = viewer, place = wanted.match(/^(-?\d+(?:\.\d+)?)[,; ]+(-?\d+(?:\.\d+)?)$/);
    viewer.network.offer('');
    if (place) return viewer.fly(place.slice(1).map((value, axis) => value * page.unit - viewer.origin[axis]));
    let number = all.findIndex(row => row.id === wanted);
    if (number < 0 && wanted) number = all.findIndex(row => String(row.id).includes(wanted));
    if (number >= 0) viewer.choose(number);
    else if (wanted) byId('answer').textContent = `no building here has an id with ${wanted} in it`;
    viewer.network.offer(number < 0 ? wanted : '');
  });
  byId('theme').addEventListener('click', () => {
    const root = document.documentElement, dark = getComputedStyle(root).colorScheme === 'dark' || (getComputedStyle(root).colorScheme !== 'light' && matchMedia('(prefers-color-scheme: dark)').matches);
    root.dataset.theme = dark ? 'light' : 'dark';
    viewer.refresh();
  });
}

// Names in the address, and their controls.
const SETTINGS = [['lod', 'lod'], ['points', 'point-colour'], ['models', 'model-colour'], ['size', 'size'], ['swipe', 'swipe']];

// The settings of the address behind '#': building=… (or id=…; building=worst is the one to look at first)&view=above&theme=dark&lod=1.2&points=distance&models=fit&off=ground,walls
function obeyAddress(viewer, hash = location.hash) {
  const given = new URLSearchParams(hash.slice(1));
  if (given.has('theme')) document.documentElement.dataset.theme = given.get('theme');
  for (const [name, control] of SETTINGS) if (given.has(name)) byId(control).value = given.get(name);
  for (const [name, on] of [['on', true], ['off', false]]) for (const box of (given.get(name) || '').split(',')) if (byId(box)) byId(box).checked = on;
  viewer.refresh();
  const wanted = given.get('building') ?? given.get('id');
  if (wanted === 'worst') viewer.choose(worstFirst(viewer.all)[0] ?? -1);
  else if (wanted !== null) viewer.choose(viewer.all.findIndex(row => row.id === wanted));
  for (const view of (given.get('view') || '').split(',')) if (view) viewer.view(view);
  const measured = (given.get('measure') || '').split(',').map(Number);
  if (measured.length > 2 && measured.length % 3 === 0 && measured.every(Number.isFinite)) {
    viewer.ruler.toggle(true);
    for (let place = 0; place < measured.length; place += 3) viewer.ruler.places.push(measured.slice(place, place + 3));
    viewer.profile.toggle(given.has('profile'));
  }
  const eye = (given.get('eye') || '').split(',').map(Number);
  if (eye.length === 7 && eye.every(Number.isFinite)) {
    const [azimuth, elevation, distance, flat, ...target] = eye;
    Object.assign(viewer.camera, { azimuth, elevation, distance, flat: flat === 1, target });
    viewer.ask();
  }
}

// The address of what is seen now: whoever opens it sees the same.
function addressOf(viewer) {
  const { camera, look, all } = viewer, settings = new URLSearchParams(), theme = document.documentElement.dataset.theme;
  if (theme) settings.set('theme', theme);
  for (const [name, control] of SETTINGS) if (byId(control).value !== initial[control]) settings.set(name, byId(control).value);
  const boxes = [...document.querySelectorAll('#controls input[type=checkbox]')].filter(box => box.checked !== box.defaultChecked);
  for (const [name, on] of [['on', true], ['off', false]]) {
    const ids = boxes.filter(box => box.checked === on).map(box => box.id);
    if (ids.length) settings.set(name, ids.join());
  }
  if (look.chosen) settings.set('id', all[look.chosen - 1].id);
  if (viewer.ruler.places.length) settings.set('measure', viewer.ruler.places.flat().map(value => value.toFixed(3)).join());
  if (viewer.profile.on) settings.set('profile', '1');
  const numbers = [camera.azimuth, camera.elevation, camera.distance, camera.flat ? 1 : 0, ...camera.target];
  settings.set('eye', numbers.map((value, place) => Number(value.toFixed(place < 2 ? 4 : 2))).join());
  return `#${settings.toString().replaceAll('%2C', ',')}`;
}

const initial = {};
// Ids that Find lists as one types; it knows all of them.
const NAMES_OFFERED = 4000;

// Keeps the address up to date once a person has touched the page; not while it moves.
function keepAddress(viewer) {
  for (const [, control] of SETTINGS) initial[control] = byId(control).value;
  if (location.protocol === 'about:') return; // within another page, which has the address
  let waiting = 0;
  const later = () => {
    clearTimeout(waiting);
    waiting = setTimeout(() => history.replaceState(null, '', addressOf(viewer)), 400);
  };
  for (const name of ['pointerup', 'wheel', 'keyup', 'input']) byId('stage').addEventListener(name, later, { passive: true });
  byId('buildings').addEventListener('click', later);
  byId('theme').addEventListener('click', later);
}

async function start() {
  let viewer = null, city = null, all = [];
  try {
    city = page.city ? await City.open() : null;
    all = city ? city.rows : page.rows.concat(await unpackRows(page.others));
  } catch (error) { return trouble(error); }
  const rows = city ? all : page.rows;
  try {
    viewer = new Viewer(city ? city.scene() : { ...readScene(await unpackAll(page.arrays)), rows }, all);
    if (page.basemap) await viewer.addImage(page.basemap);
    if (city) await city.follow(viewer);
    listenToCanvas(viewer);
    listenToControls(viewer);
    keepAddress(viewer);
    obeyAddress(viewer);
    addEventListener('hashchange', () => obeyAddress(viewer));
    window.eaves = viewer;
    await viewer.pace.first(); // the scene first, then the table
  } catch (error) { trouble(error); }
  const table = new Table(byId('buildings'), page.columns, all, number => {
    if (!viewer) return;
    viewer.choose(number);
    byId('scene').scrollIntoView({ block: 'nearest' });
  });
  drawCharts(byId('charts'), all);
  byId('ids').append(...rows.slice(0, NAMES_OFFERED).map(row => element('option', { value: row.id })));
  if (!document.documentElement.dataset.ready) document.documentElement.dataset.ready = 'yes';
  if (!viewer) return;
  viewer.table = table;
  table.mark(viewer.look.chosen - 1);
}

function trouble(error) {
  byId('trouble').textContent = `No 3D view: ${error.message}.`;
  byId('trouble').hidden = false;
  document.documentElement.dataset.ready = 'no';
}
start();
