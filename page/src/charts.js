// Histograms, and the figures of one building.
import { column, words } from './colours.js';
import { element, figure, page } from './page.js';

/** @import { Row, Scene } from './types.js' */

// Bars upright, with their counts; entries are [label, count].
/** @param {string} title @param {[string, number][]} entries @param {string} [note] */
export function bars(title, entries, note = '') {
  const most = Math.max(1, ...entries.map(([, count]) => count));
  const list = element('ol', { class: 'bars' });
  for (const [label, count] of entries) {
    const bar = element('span', { class: 'bar', style: `height:${count ? Math.max(2, 110 * count / most) : 0}px` });
    list.append(element('li', { title: `${label}: ${count}` }, element('span', { class: 'count' }, count ? String(count) : ''), bar, element('span', { class: 'label' }, label)));
  }
  return element('figure', {}, element('figcaption', {}, title, ' ', element('small', {}, note)), list);
}

/** @param {string} title @param {number[]} values @param {number} width @param {number} top @param {string} unit @param {string} [note] */
export function histogram(title, values, width, top, unit, note = '') {
  const known = values.filter(Number.isFinite), count = Math.round(top / width), bins = new Array(count + 1).fill(0);
  for (const value of known) bins[Math.min(count, Math.floor(value / width + 1e-9))]++;
  const digits = width < 0.1 ? 2 : 1;
  const label = (/** @type {number} */ place) => place === count ? `${top}+` : (place * width).toFixed(digits);
  return bars(title, bins.map((number, place) => [label(place), number]), `${unit}${note}`);
}

/** @param {string} title @param {string[]} words */
export function tally(title, words) {
  const counts = new Map();
  for (const word of words) counts.set(word, (counts.get(word) || 0) + 1);
  return bars(title, [...counts].sort((one, two) => two[1] - one[1]));
}

/** @param {HTMLElement} box @param {Row[]} rows */
export function drawCharts(box, rows) {
  if (page.epochs) return box.append(tally('Changes', words(rows, 'change', '')), tally('Certainty', words(rows, 'certainty', 'none')));
  box.append(histogram('Fit of the models', column(rows, 'rmse_m'), 0.05, 0.5, 'RMSE, m'));
  if (rows.some(row => row.rmse95_m !== undefined)) box.append(histogram('Fit without the worst 5 %', column(rows, 'rmse95_m'), 0.05, 0.5, 'RMSE, m'));
  box.append(tally('Level of detail reached', words(rows, 'lod', 'no model')));
  box.append(tally('Roof types', words(rows, 'roof_type', 'none')));
  const failed = rows.filter(row => row.failure_code);
  box.append(tally(`Failures and coarser models: ${failed.length || 'none'}`, words(failed, 'failure_code', '')));
}

// The attributes and distances of one building.
/** @param {HTMLElement} box @param {Row} row @param {number} number @param {Scene} scene */
export function describe(box, row, number, { points, rows }) {
  const list = element('dl');
  const { id, change, certainty, reason, trust, trust_score, review_reason, ...others } = row;
  for (const [name, value] of Object.entries({ id, change, certainty, reason, trust, trust_score, review_reason, ...others })) {
    if (value !== undefined && value !== null && name !== 'number') list.append(element('dt', { title: page.meanings[name]?.[1] || '' }, page.meanings[name]?.[0] || name), element('dd', {}, figure(value, name)));
  }
  if (number >= rows.length) {
    box.replaceChildren(element('h2', {}, row.id), list, element('p', {}, `Not drawn: the page shows ${rows.length.toLocaleString('en')} buildings. `, ...(page.epochs ? [] : [element('code', {}, `eaves view OUT --around ${row.id}`), ' makes a page around this one.'])));
    return;
  }
  const distances = [];
  let mine = 0;
  for (let place = 0; place < points.count; place++) {
    if (points.building[place] !== number + 1) continue;
    mine++;
    if (points.distance[place] !== 32767) distances.push(Math.abs(points.distance[place]) / 1000);
  }
  distances.sort((one, two) => one - two);
  /** @type {HTMLElement[]} */
  const parts = [element('h2', {}, row.id), list, element('p', {}, `${mine.toLocaleString('en')} of its points are drawn, ${distances.length.toLocaleString('en')} over its roof`
    + (distances.length ? `; median distance ${distances[Math.floor(distances.length / 2)].toFixed(3)} m` : ''))];
  if (distances.length) parts.push(histogram('Distances to the roof', distances, 0.05, 0.5, 'm'));
  box.replaceChildren(...parts);
}
