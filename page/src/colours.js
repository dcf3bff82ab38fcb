// The meaning of colours: for points and models a way from values to colours, with its legend.
import { CHANGES } from './epochs.js';
import { element, page } from './page.js';

/** @import { Colour, Legend, Row, Scene } from './types.js' */

/** @type {Record<number, [string, string]>} */
export const CLASSES = {
  0: ['not used', '#a7adb3'], 1: ['other', '#8d9b6f'], 2: ['ground', '#b59a74'], 3: ['low vegetation', '#a6c36f'], 4: ['medium vegetation', '#6ba14f'],
  5: ['high vegetation', '#3f7f3f'], 6: ['building', '#8e1b2e'], 7: ['low noise', '#e03fd8'], 9: ['water', '#4f8fd0'], 14: ['wire', '#d98c3f'], 15: ['tower', '#8a5a2b'], 17: ['bridge', '#9a7bb0'], 18: ['high noise', '#e03fd8'],
};
export const SET = ['#4e79a7', '#f28e2b', '#59a14f', '#b07aa1', '#76b7b2', '#edc948', '#9c755f', '#ff9da7', '#8cd17d', '#86bcb6'];
/** @type {Record<string, string>} */
export const LOD_COLOURS = { '2.3': '#2f7f8f', '2.2': '#4c9f70', '2.0': '#9fc24d', '1.3': '#e0b040', '1.2': '#e07b39', '0': '#8a8fa3', none: '#d23b3b' };
/** @type {Record<string, string>} */
export const TRUST_COLOURS = { high: '#5b8c85', medium: '#f2c14e', low: '#c8102e', manual: '#6a51a3', none: '#8b8b8b' };
export const VIRIDIS = ['#440154', '#3b528b', '#21918c', '#5ec962', '#fde725'];
export const DIVERGING = ['#2f6fd6', '#7fb0d8', '#a9b5a4', '#e39a6b', '#d0302f'];
export const CYCLE = ['#e0524d', '#d9c23f', '#4dab5b', '#3f7fd0', '#e0524d'];
export const NOTHING = '#8b8b8b';

/** @param {string} colour @returns {Colour} */
export const bytes = colour => [1, 3, 5].map(place => parseInt(colour.slice(place, place + 2), 16));

/** @param {string[]} colours @returns {(share: number) => Colour} */
export function ramp(colours) {
  const stops = colours.map(bytes), last = stops.length - 1;
  return share => {
    const place = Math.min(last - 1e-6, Math.max(0, share * last)), low = Math.floor(place), part = place - low;
    return stops[low].map((value, channel) => Math.round(value + part * (stops[low + 1][channel] - value)));
  };
}

// Answers a colour for a number; NaN is grey.
/** @param {string[]} colours @param {number} low @param {number} high @param {string} unit @param {string[]} [names] @returns {{ colour: (value: number) => Colour, legend: Legend }} */
export function scaleOf(colours, low, high, unit, names) {
  const at = ramp(colours), grey = bytes(NOTHING), span = high > low ? high - low : 1;
  return { colour: value => Number.isFinite(value) ? at((value - low) / span) : grey, legend: { colours, low, high, unit, names } };
}

// Answers a colour for a word.
/** @param {string[]} words @param {Record<string, string>} [known] @returns {{ colour: (word: string) => Colour, legend: Legend }} */
export function setOf(words, known = {}) {
  const table = new Map(words.map((word, place) => [word, known[word] || SET[place % SET.length]]));
  return { colour: word => bytes(table.get(word) || NOTHING), legend: { words: [...table] } };
}

/** @param {Float32Array} values @param {number} [lowest] @param {number} [highest] */
export function spread(values, lowest = 0.02, highest = 0.98) {
  const finite = Float64Array.from(values).filter(Number.isFinite).sort();
  return finite.length ? [finite[Math.floor(lowest * (finite.length - 1))], finite[Math.floor(highest * (finite.length - 1))]] : [0, 1];
}

/** @param {Row[]} rows @param {string} name */
export const column = (rows, name) => rows.map(row => row[name] === null || row[name] === undefined ? NaN : Number(row[name]));
/** @param {Row[]} rows @param {string} name @param {string} missing @returns {string[]} */
export const words = (rows, name, missing) => rows.map(row => row[name] || missing);
/** @template T @param {Iterable<T>} list */
export const distinct = list => [...new Set(list)].sort();

// Way of colouring points → function of a point's number giving its colour, and a legend.
/** @param {string} way @param {Scene} scene @returns {{ at: (number: number) => Colour, legend: Legend }} */
export function pointColours(way, { points, rows }) {
  if (way === 'height') {
    const heights = spread(points.xyz.filter((_, place) => place % 3 === 2)), scale = scaleOf(VIRIDIS, heights[0], heights[1], 'm');
    scale.legend.shift = points.base;
    return { at: number => scale.colour(points.xyz[3 * number + 2]), legend: scale.legend };
  }
  if (way === 'building') return { at: number => points.building[number] ? bytes(SET[points.building[number] * 7 % SET.length]) : bytes(NOTHING), legend: { text: `${rows.length} buildings, a colour each; grey: none` } };
  if (way === 'plane') return { at: number => points.plane[number] ? bytes(SET[points.plane[number] * 3 % SET.length]) : bytes(NOTHING), legend: { text: 'neighbouring roof planes differ; grey: on no plane' } };
  if (way === 'distance') {
    const scale = scaleOf(DIVERGING, -0.3, 0.3, 'm over the model’s roof');
    return { at: number => scale.colour(points.distance[number] === 32767 ? NaN : points.distance[number] / 1000), legend: scale.legend };
  }
  const there = distinct(points.classification), table = there.map(code => CLASSES[code] || /** @type {[string, string]} */ ([`class ${code}`, NOTHING]));
  const colours = new Map(there.map((code, place) => [code, bytes(table[place][1])]));
  return { at: number => colours.get(points.classification[number]) ?? bytes(NOTHING), legend: { words: table } };
}

// Way of colouring models → function of (triangle's number, row's number) giving its colour, and a legend.
/** @param {string} way @param {Scene} scene @returns {{ at: (number: number, row: number) => Colour, legend: Legend }} */
export function modelColours(way, { triangles, rows }) {
  if (way === 'surface') {
    const scale = setOf(['roof', 'wall', 'underside', 'ground'], { roof: '#cf6a50', wall: '#d9d3c5', underside: '#b08968', ground: '#8a8fa3' });
    return { at: number => scale.colour(['ground', 'wall', 'roof', 'underside'][triangles.kind[number]]), legend: scale.legend };
  }
  if (way === 'slope') {
    const scale = scaleOf(VIRIDIS, 0, 60, '° of slope');
    return { at: number => triangles.kind[number] === 2 ? scale.colour(triangles.slope[number]) : bytes('#f4f1ea'), legend: scale.legend };
  }
  if (way === 'azimuth') {
    const scale = scaleOf(CYCLE, 0, 360, '', ['N', 'E', 'S', 'W', 'N']);
    return { at: number => triangles.kind[number] === 2 && triangles.slope[number] >= 2 ? scale.colour(triangles.azimuth[number]) : bytes('#f4f1ea'), legend: scale.legend };
  }
  if (way === 'fit') {
    const scale = scaleOf(['#3f9b6a', '#e7d04a', '#d23b3b'], 0, 0.5, 'm RMSE of each roof face; grey: no points'), side = bytes('#f4f1ea');
    return { at: number => triangles.kind[number] === 2 ? scale.colour(triangles.error[number] === 65535 ? NaN : triangles.error[number] / 1000) : side, legend: scale.legend };
  }
  const name = { change: 'change', lod: 'lod', type: 'roof_type', failure: 'failure_code', trust: 'trust' }[way] ?? way;
  const values = words(rows, name, way === 'failure' ? 'as asked for' : 'none');
  /** @type {Record<string, string>} */
  const known = { 'as asked for': '#7fa98f', none: LOD_COLOURS.none };
  for (const { lod, failure_code: code } of rows) if (way === 'failure' && code && (!lod || lod === '0')) known[code] = LOD_COLOURS.none; // as its footprint is drawn
  const inOrder = way === 'trust' ? Object.keys(TRUST_COLOURS).filter(word => values.includes(word)) : way === 'lod' ? [...page.lods].reverse().concat('none').filter(word => values.includes(word)) : distinct(values);
  const scale = setOf(inOrder, { change: CHANGES, lod: LOD_COLOURS, trust: TRUST_COLOURS }[way] || known);
  return { at: (_, row) => scale.colour(values[row]), legend: scale.legend };
}

// The legend of a way of colouring.
/** @param {HTMLElement} box @param {Legend} legend */
export function legend(box, { words, colours, low = 0, high = 0, unit, text, names, shift = 0 }) {
  box.replaceChildren();
  if (text) box.append(text);
  for (const [word, colour] of words || []) box.append(element('span', { class: 'key' }, element('i', { style: `background:${colour}` }), word));
  if (colours) {
    const ends = names || [low, high].map(value => (value + shift).toFixed(Math.abs(high - low) < 2 ? 1 : 0).replace(/^-(0(\.0)?)$/, '$1'));
    box.append(element('span', { class: 'ramp', style: `background:linear-gradient(90deg,${colours})` }), element('span', { class: 'ends' }, ...ends.map(end => element('span', {}, end))), unit || '');
  }
}
