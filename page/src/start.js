// Everything together: the scene first, then the table.
import { keepAddress, obeyAddress } from './address.js';
import { unpackAll, unpackRows } from './arrays.js';
import { drawCharts } from './charts.js';
import { City } from './city.js';
import { listenToCanvas, listenToControls } from './events.js';
import { byId, element, messageOf, page } from './page.js';
import { listenToPrint } from './print.js';
import { readScene } from './scene.js';
import { Table } from './table.js';
import { beginExtensions } from './tools.js';
import { Viewer } from './viewer.js';

/** @import { Row } from './types.js' */

// Ids that Find lists as one types; it knows all of them.
export const NAMES_OFFERED = 4000;

export async function start() {
  /** @type {Viewer | null} */
  let viewer = null;
  /** @type {City | null} */
  let city = null;
  /** @type {Row[]} */
  let all = [];
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
    listenToPrint(viewer);
    keepAddress(viewer);
    obeyAddress(viewer);
    window.eaves = viewer;
    addEventListener('hashchange', () => obeyAddress(window.eaves));
    await viewer.pace.first(); // the scene first, then the table
  } catch (error) { trouble(error); }
  const table = new Table(/** @type {HTMLTableElement} */ (byId('buildings')), page.columns, all, number => {
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
  beginExtensions(viewer.tools);
}

/** @param {unknown} error */
export function trouble(error) {
  byId('trouble').textContent = `No 3D view: ${messageOf(error)}.`;
  byId('trouble').hidden = false;
  document.documentElement.dataset.ready = 'no';
}
start();
