// The nouns of the page: lengths in metres about the origin, numbers of buildings from 1 in arrays (0 is none) and from 0 in lists of rows.
import type { Tools } from './tools.js';
import type { Viewer } from './viewer.js';

/** East, north, up. */
export type Place = number[];
/** A building's attributes by the names of its columns. */
export type Row = { id: string; [name: string]: any };
/** Red, green and blue, 0 to 255. */
export type Colour = number[];
export type Numbers = Int8Array | Uint8Array | Int16Array | Uint16Array | Int32Array | Uint32Array | Float32Array | Float64Array;
/** A typed array as the page embeds it. */
export interface Packed { type: 'uint8' | 'int16' | 'uint16' | 'int32' | 'uint32'; data: string }
export type Arrays = Record<string, any>;

/** Things with a building and an epoch each; `xyz` has 3 numbers a point, 6 a line, 9 a triangle. Once they were drawn, `dressed` has the colours of their
 * vertices and `seen` is 0 for those that are not drawn. */
export interface Things { xyz: Float32Array; building: Uint32Array; epochs: Uint8Array; count: number; dressed?: Uint8Array; seen?: Uint8Array }
export interface Points extends Things { classification: Uint8Array; plane: Uint8Array; distance: Int16Array; over: Uint8Array; base: number }
export interface Edges extends Things { lod: Uint8Array }
export interface Triangles extends Edges { kind: Uint8Array; error: Uint16Array; slope: Float32Array; azimuth: Float32Array }
export interface Shapes { triangles: Triangles; edges: Edges; prints: Things }
export interface Terrain { rows: number; columns: number; cell: number; west: number; north: number }
export interface Grid extends Terrain { heights: Float32Array; epoch: number }
export interface Ground { position: Float32Array; details: Uint32Array[]; epoch: number; light: Float32Array }
export interface Parts extends Shapes { points: Points; grounds: Ground[] }
/** `far` are roofs of many buildings each, of a city that is drawn by squares. */
export interface Scene extends Parts { rows: Row[]; far?: Things }
export interface Box { low: number[]; high: number[] }

export interface Legend { words?: [string, string][]; colours?: string[]; low?: number; high?: number; unit?: string; text?: string; names?: string[]; shift?: number }
export interface Look { background: number[]; mark: number[]; chosen: number; only: boolean; pointSize: number; split: number }
export interface Quality { scale: number; smooth: boolean; points: number; ground: number; lines: boolean; detail: number }
export interface List { buffer: WebGLBuffer; count: number; numbers: Uint32Array }
/** A run of a layer's vertices; what is drawn with it measures `size` (m). */
export interface Way { layer: Layer; list: List; first: number; count: number; size: number }
/** What lies in a box, which is empty where it is not known, drawn in one of several ways, from fine to coarse. */
export interface Block { low: Place; high: Place; ways: Way[] }
export interface Layer {
  kind: 'points' | 'triangles' | 'lines'; mode: number; vao: WebGLVertexArrayObject; buffers: WebGLBuffer[]; colour: WebGLBuffer;
  shaded: boolean; strength: number; minor: boolean; fades: boolean; opacity: number; pictured: boolean; drawn: List[]; shown: Uint32Array;
  /** Drawn block by block; with none only within the blocks of another layer. */
  blocks?: Block[];
}
export interface Piece { layer: Layer; list: List; first: number; count: number; grown: number }
export interface Frame { frame: WebGLFramebuffer; buffers: WebGLRenderbuffer[]; width: number; height: number }
export interface Column { name: string; title: string; number: boolean }

/** What the page embeds besides its arrays. */
export interface Page {
  rows: Row[]; others: { names: string[]; data: string }; columns: Column[]; meanings: Record<string, [string, string]>; lods: string[]; base: number; modelled: boolean;
  origin: Place; unit: number; basemap: string | null; world: number[][] | null; terrain: Terrain; arrays: Record<string, Packed>; epochs?: string[]; city?: { folder: string; squares: number[][] };
}

/** What is at a pixel of the canvas, looked for when asked. */
export interface Spot {
  x: number; y: number;
  /** The number of the building there; −1 for none. */
  building(): number;
  /** A corner of a model or a point nearby, else where the ray meets a surface. */
  place(): Place | null;
  /** Where the ray is at a height. */
  level(z: number): Place;
}
/** A tool: `press` once, or `start` and `stop`, and what it does with the pointer and keys meanwhile; both answer whether they take it. */
export interface Tool {
  id: string; name: string; key: string; does: string;
  press?(): void; start?(): void; stop?(): void;
  pointer?(kind: 'down' | 'move' | 'up' | 'tap', spot: Spot, event: PointerEvent): boolean | void;
  keydown?(event: KeyboardEvent): boolean | void;
}
export interface Drawing { lines?: Place[][]; points?: Place[]; words?: [Place, string][] }
export type Extension = (tools: Tools) => void;

declare global {
  interface Window { eaves: Viewer; eavesExtensions?: Extension[] | { push(extension: Extension): void } }
}
