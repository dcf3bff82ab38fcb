// A sheet of A4 at 1:500 on paper: what is chosen or looked at from above, north up, in the colours of the scene. The browser's own Print makes it.
import { byId, element, figure, page } from './page.js';
import { QUALITIES } from './pace.js';
import { FIELD } from './camera.js';

/** @import { Viewer } from './viewer.js' */

// Millimetres on paper, and how many of the ground's stand for one; the picture's pixels for a millimetre.
const WIDE = 186, TALL = 232, SCALE = 500, FINE = 8;

/** @param {Viewer} viewer */
export function listenToPrint(viewer) {
  addEventListener('beforeprint', () => byId('sheet').replaceChildren(...drawSheet(viewer)));
  addEventListener('afterprint', () => byId('sheet').replaceChildren());
  byId('print').addEventListener('click', () => print());
}

/** @param {Viewer} viewer */
function drawSheet(viewer) {
  const { camera, painter, look } = viewer, spot = viewer.spots[look.chosen - 1], root = document.documentElement, { theme } = root.dataset;
  const kept = { azimuth: camera.azimuth, elevation: camera.elevation, distance: camera.distance, flat: camera.flat, target: camera.target };
  if (spot && Number.isFinite(spot.low[0])) camera.target = spot.low.map((value, axis) => (value + spot.high[axis]) / 2);
  const middle = camera.target;
  camera.above(false);
  camera.distance = TALL * SCALE / 1000 / (2 * Math.tan(FIELD / 2));
  root.dataset.theme = 'light';
  viewer.refresh();
  const size = /** @type {[number, number]} */ ([WIDE * FINE, TALL * FINE]), [before] = viewer.before();
  painter.begin(before, { ...look, background: [1, 1, 1], split: 0 }, QUALITIES[0], size);
  for (const piece of painter.pieces(QUALITIES[0])) painter.draw(piece);
  painter.present();
  const picture = element('canvas', { width: size[0], height: size[1], role: 'img', 'aria-label': 'The buildings from above' });
  picture.getContext('2d')?.drawImage(viewer.canvas, 0, 0);
  Object.assign(camera, kept);
  if (theme) root.dataset.theme = theme;
  else delete root.dataset.theme;
  const legend = /** @type {HTMLElement} */ (byId('model-legend').cloneNode(true));
  legend.removeAttribute('id');
  viewer.refresh();
  const row = viewer.all[look.chosen - 1], shown = ['trust', 'review_reason', 'area_m2', 'measuredHeight', 'lod', 'roof_type'].filter(name => row?.[name] !== null && row?.[name] !== undefined);
  const [east, north] = middle.map((value, axis) => ((value + viewer.origin[axis]) / (axis < 2 ? page.unit : 1)).toFixed(1));
  return [
    element('h1', {}, row ? `Building ${row.id}` : document.title),
    element('div', { class: 'plan', style: `width:${WIDE}mm;height:${TALL}mm` }, picture, ...labels(viewer, middle), element('span', { class: 'north' }, '▲', element('br'), 'N')),
    element('div', { class: 'foot' },
      element('div', {}, element('span', { class: 'bar', style: `width:${20000 / SCALE}mm` }, '20 m'), ` 1 : ${SCALE} on A4 at 100 %; middle ${east}, ${north}`),
      element('div', {}, shown.map(name => `${page.meanings[name]?.[0] ?? name}: ${figure(row[name], name)}`).join('; ')), legend, element('div', {}, byId('credit').textContent ?? '')),
  ];
}

// The ids of the buildings that have room for them.
/** @param {Viewer} viewer @param {number[]} middle */
function labels(viewer, middle) {
  const places = viewer.spots.map(({ low, high }, number) => ({ id: viewer.all[number].id, wide: (high[0] - low[0]) * 1000 / SCALE, x: ((low[0] + high[0]) / 2 - middle[0]) * 1000 / SCALE + WIDE / 2, y: (middle[1] - (low[1] + high[1]) / 2) * 1000 / SCALE + TALL / 2 }));
  const inside = places.filter(({ id, wide, x, y }) => wide > 1.4 * String(id).length && x > 8 && x < WIDE - 8 && y > 4 && y < TALL - 4);
  const apart = inside.filter(({ id, x, y }, place) => !inside.slice(0, place).some(other => Math.abs(other.x - x) < 0.7 * (String(other.id).length + String(id).length) && Math.abs(other.y - y) < 3));
  return apart.map(({ id, x, y }) => element('span', { class: 'id', style: `left:${x.toFixed(2)}mm;top:${y.toFixed(2)}mm` }, id));
}
