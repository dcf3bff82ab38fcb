// The address of the page behind '#': what is seen, so that whoever opens it sees the same.
import { byId, field } from './page.js';
import { worstFirst } from './table.js';

/** @import { Viewer } from './viewer.js' */

// Names in the address, and their controls.
const SETTINGS = [['lod', 'lod'], ['points', 'point-colour'], ['models', 'model-colour'], ['size', 'size'], ['swipe', 'swipe']];

// The settings of the address behind '#': building=… (or id=…; building=worst is the one to look at first)&view=above&theme=dark&lod=1.2&points=distance&models=fit&off=ground,walls
/** @param {Viewer} viewer @param {string} [hash] */
export function obeyAddress(viewer, hash = location.hash) {
  const given = new URLSearchParams(hash.slice(1));
  const theme = given.get('theme');
  if (theme) document.documentElement.dataset.theme = theme;
  for (const [name, control] of SETTINGS) if (given.has(name)) field(control).value = given.get(name) ?? '';
  for (const [name, on] of /** @type {const} */ ([['on', true], ['off', false]])) for (const box of (given.get(name) || '').split(',')) if (byId(box)) field(box).checked = on;
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
/** @param {Viewer} viewer */
export function addressOf(viewer) {
  const { camera, look, all } = viewer, settings = new URLSearchParams(), theme = document.documentElement.dataset.theme;
  if (theme) settings.set('theme', theme);
  for (const [name, control] of SETTINGS) if (field(control).value !== initial[control]) settings.set(name, field(control).value);
  const boxes = [.../** @type {NodeListOf<HTMLInputElement>} */ (document.querySelectorAll('#controls input[type=checkbox]'))].filter(box => box.checked !== box.defaultChecked);
  for (const [name, on] of /** @type {const} */ ([['on', true], ['off', false]])) {
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

/** @type {Record<string, string>} */
const initial = {};

// Keeps the address up to date once a person has touched the page; not while it moves.
/** @param {Viewer} viewer */
export function keepAddress(viewer) {
  for (const [, control] of SETTINGS) initial[control] = field(control).value;
  if (location.protocol === 'about:') return; // within another page, which has the address
  /** @type {ReturnType<typeof setTimeout>} */
  let waiting;
  const later = () => {
    clearTimeout(waiting);
    waiting = setTimeout(() => history.replaceState(null, '', addressOf(viewer)), 400);
  };
  for (const name of ['pointerup', 'wheel', 'keyup', 'input']) byId('stage').addEventListener(name, later, { passive: true });
  byId('buildings').addEventListener('click', later);
  byId('theme').addEventListener('click', later);
}
