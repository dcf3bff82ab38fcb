// Typed arrays out of the page: base64, deflate, bytes of one significance together (they compress best so).

/** @import { Arrays, Numbers, Packed, Row } from './types.js' */

export const KINDS = { uint8: Uint8Array, int16: Int16Array, uint16: Uint16Array, int32: Int32Array, uint32: Uint32Array };

/** @param {string} data base64 */
export function inflate(data) {
  const packed = Uint8Array.from(atob(data), letter => letter.charCodeAt(0));
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream('deflate')));
}

/** @param {Packed} packed @returns {Promise<Numbers>} */
export async function unpackArray({ type, data }) {
  const planes = new Uint8Array(await inflate(data).arrayBuffer());
  const width = KINDS[type].BYTES_PER_ELEMENT, count = planes.length / width, bytes = new Uint8Array(planes.length);
  for (let plane = 0; plane < width; plane++) {
    for (let item = 0, from = plane * count, to = plane; item < count; item++, from++, to += width) bytes[to] = planes[from];
  }
  return new KINDS[type](bytes.buffer);
}

/** @param {Record<string, Packed>} packed @returns {Promise<Arrays>} */
export async function unpackAll(packed) {
  const names = Object.keys(packed), arrays = await Promise.all(names.map(name => unpackArray(packed[name])));
  return Object.fromEntries(names.map((name, place) => [name, arrays[place]]));
}

// Rows out of columns: the buildings that are not drawn, with their rows of the table.
/** @param {{ names: string[], data: string }} packed @returns {Promise<Row[]>} */
export async function unpackRows({ names, data }) {
  const columns = await inflate(data).json();
  return (columns[0] || []).map((/** @type {unknown} */ _, /** @type {number} */ number) => Object.fromEntries(names.map((name, place) => [name, columns[place][number]])));
}

// Millimetres as metres.
/** @param {Int32Array} whole */
export const metres = whole => Float32Array.from(whole, value => value / 1000);
