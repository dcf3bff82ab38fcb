// Typed arrays out of the page: base64, deflate, bytes of one significance together (they compress best so).

export const KINDS = { uint8: Uint8Array, int16: Int16Array, uint16: Uint16Array, int32: Int32Array, uint32: Uint32Array };

export function inflate(data) {
  const packed = Uint8Array.from(atob(data), letter => letter.charCodeAt(0));
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream('deflate')));
}

export async function unpackArray({ type, data }) {
  const planes = new Uint8Array(await inflate(data).arrayBuffer());
  const width = KINDS[type].BYTES_PER_ELEMENT, count = planes.length / width, bytes = new Uint8Array(planes.length);
  for (let plane = 0; plane < width; plane++) {
    for (let item = 0, from = plane * count, to = plane; item < count; item++, from++, to += width) bytes[to] = planes[from];
  }
  return new KINDS[type](bytes.buffer);
}

export async function unpackAll(packed) {
  const names = Object.keys(packed), arrays = await Promise.all(names.map(name => unpackArray(packed[name])));
  return Object.fromEntries(names.map((name, place) => [name, arrays[place]]));
}

// Rows out of columns: the buildings that are not drawn, with their rows of the table.
export async function unpackRows({ names, data }) {
  const columns = await inflate(data).json();
  return (columns[0] || []).map((_, number) => Object.fromEntries(names.map((name, place) => [name, columns[place][number]])));
}

// Millimetres as metres.
export const metres = whole => Float32Array.from(whole, value => value / 1000);
