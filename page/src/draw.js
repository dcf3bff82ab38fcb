// WebGL2: points, triangles and lines, each with a colour and a building; what is not shown is not drawn.

/** @import { Block, Frame, Layer, Look, Piece, Place, Quality } from './types.js' */
/** @import { Camera } from './camera.js' */

export const VERTEX = `#version 300 es
precision highp float;
in vec3 position; in vec4 colour; in float building;
uniform mat4 view; uniform float chosen, only, points, strength, fade; uniform vec3 mark, eye;
out vec3 place; out vec4 tint; out float epoch;
void main() {
  place = position;
  vec3 nearer = points != 0.0 ? place + 0.15 * normalize(eye - place) : place;
  gl_Position = view * vec4(nearer, 1.0);
  gl_PointSize = points > 0.0 ? clamp(points / gl_Position.w, 1.5, 11.0) : -points;
  bool mine = chosen > 0.0 && abs(building - chosen) < 0.5;
  if (only > 0.5 && !mine && building > 0.5) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  epoch = 255.0 * colour.a;
  tint = mine ? vec4(mix(colour.rgb, mark, strength), 1.0) : vec4(colour.rgb, fade);
}`;
export const FRAGMENT = `#version 300 es
precision highp float;
in vec3 place; in vec4 tint; in float epoch;
uniform float shaded, points, pictured, split; uniform vec3 eye, lay[4]; uniform sampler2D image;
out vec4 result;
void main() {
  if (epoch > 0.5 && (gl_FragCoord.x < split) != (epoch < 1.5)) discard;
  float light = 1.0;
  if (shaded > 0.5) {
    vec3 normal = normalize(cross(dFdx(place), dFdy(place)));
    if (dot(normal, eye - place) < 0.0) normal = -normal;
    light = 0.62 + 0.3 * max(0.0, dot(normal, normalize(vec3(-0.6, 0.5, 0.65)))) + 0.14 * max(0.0, normal.z);
  } else if (points != 0.0 && distance(gl_PointCoord, vec2(0.5)) > 0.5) discard;
  vec3 own = tint.rgb;
  if (pictured > 0.5) {
    vec3 first = vec3(1.0, place.xy), second = vec3(place.x * place.xy, place.y * place.y);
    own *= texture(image, vec2(dot(lay[0], first) + dot(lay[1], second), dot(lay[2], first) + dot(lay[3], second))).rgb;
    light = mix(light, 1.0, 0.6);
  }
  result = vec4(own * light, tint.a);
}`;
export const UNIFORMS = ['view', 'chosen', 'only', 'points', 'strength', 'fade', 'mark', 'shaded', 'eye', 'pictured', 'lay', 'split'];
// Vertices drawn in one call when a picture may be given up half-way.
export const PIECE = 90000;

export class Painter {
  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    const gl = canvas.getContext('webgl2', { antialias: false, alpha: false, depth: false });
    if (!gl) throw new Error('this browser gives no WebGL2; the table and the figures below work without it');
    this.gl = gl;
    this.canvas = canvas;
    /** @type {Layer[]} */
    this.layers = [];
    /** @type {Map<number, Frame>} */
    this.targets = new Map();
    this.spot = this.fade = this.far = 1;
    /** @type {WebGLTexture | null} */
    this.texture = null;
    /** The picture's place; null without one. @type {Float32Array | null} */
    this.lay = null;
    /** @type {Frame | null} */
    this.target = null;
    /** @type {{ matrix: Float32Array, eye: Place, step: number, distance: number, flat: boolean }} */
    this.sight = { matrix: new Float32Array(16), eye: [0, 0, 0], step: 1, distance: 1, flat: false };
    const program = this.program = gl.createProgram();
    for (const [kind, source] of /** @type {const} */ ([[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]])) {
      const shader = /** @type {WebGLShader} */ (gl.createShader(kind));
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader) ?? '');
      gl.attachShader(program, shader);
    }
    ['position', 'colour', 'building'].forEach((name, place) => gl.bindAttribLocation(program, place, name));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) ?? '');
    this.uniform = Object.fromEntries(UNIFORMS.map(name => [name, gl.getUniformLocation(program, name)]));
    this.samples = Math.min(4, gl.getParameter(gl.MAX_SAMPLES));
  }

  // kind: 'points', 'triangles' or 'lines'; building holds a number for each vertex, 0 for none. A colour's fourth byte is the epoch: 0 both, 1 left of the slider, 2 right of it.
  /** @param {Layer["kind"]} kind @param {Float32Array} position @param {Uint32Array} building @param {Partial<Pick<Layer, "shaded" | "strength" | "minor" | "fades" | "opacity">>} [way] @returns {Layer} */
  add(kind, position, building, { shaded = false, strength = 0, minor = false, fades = false, opacity = 1 } = {}) {
    const gl = this.gl, vao = gl.createVertexArray();
    gl.bindVertexArray(vao);
    /** @type {WebGLBuffer[]} */
    const buffers = [];
    const fill = (/** @type {number} */ place, /** @type {AllowSharedBufferSource} */ data, /** @type {number} */ size, /** @type {number} */ type, /** @type {boolean} */ normalised) => {
      const buffer = gl.createBuffer();
      buffers.push(buffer);
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, size, type, normalised, 0, 0);
      return buffer;
    };
    fill(0, position, 3, gl.FLOAT, false);
    const colour = fill(1, new Uint8Array(4 * position.length / 3), 4, gl.UNSIGNED_BYTE, true);
    fill(2, building, 1, gl.UNSIGNED_INT, false);
    gl.bindVertexArray(null);
    const mode = { points: gl.POINTS, triangles: gl.TRIANGLES, lines: gl.LINES }[kind];
    const layer = { kind, mode, vao, buffers, colour, shaded, strength, minor, fades, opacity, pictured: false, drawn: [], shown: new Uint32Array(0) };
    this.layers.push(layer);
    return layer;
  }

  // Other vertices in a layer's place; they are to be coloured and shown.
  /** @param {Layer} layer @param {Float32Array} position @param {Uint32Array} building */
  refill({ buffers }, position, building) {
    const gl = this.gl;
    for (const [buffer, data] of /** @type {const} */ ([[buffers[0], position], [buffers[2], building]])) {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
    }
  }

  clear() {
    for (const { vao, buffers, drawn } of this.layers) {
      this.gl.deleteVertexArray(vao);
      for (const buffer of [...buffers, ...drawn.map(list => list.buffer)]) this.gl.deleteBuffer(buffer);
    }
    this.layers = [];
  }

  // An image on the ground; `lay` are the coefficients of 1, x, y, x², xy, y² of its columns and rows, both from 0 to 1. Layers that are `pictured` are drawn with it.
  /** @param {TexImageSource} image @param {number[]} lay */
  picture(image, lay) {
    const gl = this.gl;
    gl.deleteTexture(this.texture);
    gl.bindTexture(gl.TEXTURE_2D, this.texture = gl.createTexture());
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, gl.RGB, gl.UNSIGNED_BYTE, image);
    gl.generateMipmap(gl.TEXTURE_2D);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    const slanted = gl.getExtension('EXT_texture_filter_anisotropic'); // keeps the words of a map readable from the side
    if (slanted) gl.texParameteri(gl.TEXTURE_2D, slanted.TEXTURE_MAX_ANISOTROPY_EXT, 8);
    this.lay = new Float32Array(lay);
  }

  /** @param {Layer} layer @param {Uint8Array} colours */
  recolour(layer, colours) {
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, layer.colour);
    this.gl.bufferData(this.gl.ARRAY_BUFFER, colours, this.gl.DYNAMIC_DRAW);
  }

  // The numbers of the vertices to draw: one list, or several from fine to coarse.
  /** @param {Layer} layer @param {Uint32Array[]} lists */
  show(layer, ...lists) {
    const gl = this.gl;
    for (const { buffer } of layer.drawn) gl.deleteBuffer(buffer);
    gl.bindVertexArray(null);
    layer.drawn = lists.map(list => {
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, list, gl.STATIC_DRAW);
      return { buffer, count: list.length, numbers: list };
    });
    layer.shown = lists[0];
  }

  // What a picture of a quality is drawn with: lists of vertices in pieces that a slow machine can stop between.
  /** @param {Quality} quality */
  pieces({ points, ground, lines, detail }) {
    /** @type {Piece[]} */
    const pieces = [];
    for (const layer of this.layers) {
      if (layer.blocks) pieces.push(...this.piecesOf(layer.blocks, detail));
      if (layer.blocks) continue;
      const list = layer.drawn[Math.min(ground, layer.drawn.length - 1)];
      if (!list || (layer.minor && !lines)) continue;
      const count = layer.kind === 'points' ? Math.min(points, list.count) : list.count;
      const grown = layer.kind === 'points' ? Math.min(2.2, Math.sqrt(list.count / Math.max(1, count))) : 1;
      for (let first = 0; first < count; first += PIECE) pieces.push({ layer, list, first, count: Math.min(PIECE, count - first), grown });
    }
    return pieces;
  }

  // Those of the blocks in sight, each in the finest way in which its parts take so many pixels; neighbours of one way are drawn together.
  /** @param {Block[]} blocks @param {number} detail */
  piecesOf(blocks, detail) {
    /** @type {Piece[]} */
    const pieces = [];
    for (const { low, high, ways } of blocks) {
      const step = low.length ? detail * this.stepAt(low, high) : 0;
      if (Number.isNaN(step)) continue;
      const { layer, list, first, count } = ways.find(way => way.size >= step) ?? ways[ways.length - 1], last = pieces[pieces.length - 1];
      if (last && last.list === list && last.first + last.count === first && last.count + count <= PIECE) last.count += count;
      else for (let from = first; from < first + count; from += PIECE) pieces.push({ layer, list, first: from, count: Math.min(PIECE, first + count - from), grown: 1 });
    }
    return pieces;
  }

  // Metres that a pixel covers where a box is nearest; NaN where none of it is in sight.
  /** @param {Place} low @param {Place} high */
  stepAt(low, high) {
    const { matrix, eye, step, distance, flat } = this.sight, outside = [0, 0, 0, 0];
    for (let corner = 0; corner < 8; corner++) {
      const place = [...low.map((value, axis) => corner >> axis & 1 ? high[axis] : value), 1], [x, y, , w] = [0, 1, 2, 3].map(row => place.reduce((sum, value, column) => sum + value * matrix[4 * column + row], 0));
      [x < -w, x > w, y < -w, y > w].forEach((beyond, side) => { outside[side] += beyond ? 1 : 0; });
    }
    if (outside.includes(8)) return NaN;
    return flat ? step : step * Math.hypot(...eye.map((value, axis) => Math.max(low[axis] - value, 0, value - high[axis]))) / distance;
  }

  /** @param {Camera} camera @param {Look} look @param {Quality} quality @param {[number, number]} [size] pixels, in place of the canvas's */
  begin(camera, look, { scale, smooth }, size) {
    const gl = this.gl, uniform = this.uniform, ratio = scale * Math.min(2, window.devicePixelRatio || 1);
    const [width, height] = size ?? [this.canvas.clientWidth, this.canvas.clientHeight].map(side => Math.max(1, Math.round(side * ratio)));
    this.target = this.targetOf(width, height, smooth ? this.samples : 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target.frame);
    gl.viewport(0, 0, width, height);
    gl.depthMask(true);
    const [red, green, blue] = look.background;
    gl.clearColor(red, green, blue, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    gl.useProgram(this.program);
    const matrix = camera.matrix(width / height), eye = camera.eye();
    this.sight = { matrix, eye, step: camera.step(height), distance: camera.distance, flat: camera.flat };
    gl.uniformMatrix4fv(uniform.view, false, matrix);
    gl.uniform3fv(uniform.eye, eye);
    gl.uniform1f(uniform.chosen, look.chosen);
    gl.uniform1f(uniform.only, look.only ? 1 : 0);
    gl.uniform1f(uniform.split, look.split * width);
    gl.uniform3fv(uniform.mark, look.mark);
    this.spot = look.pointSize / camera.step(height);
    this.fade = Math.min(1, Math.max(0.2, 0.16 / camera.step(this.canvas.clientHeight)));
    this.far = camera.flat ? 0 : camera.distance;
  }

  /** @param {Piece} piece */
  draw({ layer, list, first, count, grown }) {
    const gl = this.gl, uniform = this.uniform, spot = this.spot * grown;
    const points = layer.kind !== 'points' ? 0 : this.far ? spot * this.far : -Math.min(11, Math.max(1.5, spot));
    gl.uniform1f(uniform.points, points);
    gl.uniform1f(uniform.shaded, layer.shaded ? 1 : 0);
    gl.uniform1f(uniform.strength, layer.strength);
    gl.uniform1f(uniform.fade, layer.fades ? this.fade : layer.opacity);
    gl.uniform1f(uniform.pictured, layer.pictured ? 1 : 0);
    if (layer.pictured && this.lay) gl.uniform3fv(uniform.lay, this.lay);
    gl.depthMask(layer.opacity === 1);
    if (layer.fades || layer.opacity < 1) {
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    } else gl.disable(gl.BLEND);
    if (layer.kind === 'triangles') {
      gl.enable(gl.POLYGON_OFFSET_FILL);
      gl.polygonOffset(1.5, 2);
    } else gl.disable(gl.POLYGON_OFFSET_FILL);
    gl.bindVertexArray(layer.vao);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, list.buffer);
    gl.drawElements(layer.mode, count, gl.UNSIGNED_INT, 4 * first);
    gl.bindVertexArray(null);
  }

  // The finished picture onto the page, which stretches it where it was drawn smaller.
  present() {
    const gl = this.gl, { canvas } = this, { frame, width, height } = /** @type {Frame} */ (this.target);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, frame);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
    gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  // Resolves when the graphics side has finished its commands.
  async finished() {
    const gl = this.gl, sync = /** @type {WebGLSync} */ (gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0));
    gl.flush();
    while (sync && gl.clientWaitSync(sync, 0, 0) === gl.TIMEOUT_EXPIRED) await new Promise(done => setTimeout(done, 1));
    gl.deleteSync(sync);
  }

  // A place to draw to: one for smooth edges, one for while it moves.
  /** @param {number} width @param {number} height @param {number} samples @returns {Frame} */
  targetOf(width, height, samples) {
    const gl = this.gl, old = this.targets.get(samples);
    if (old && old.width === width && old.height === height) return old;
    if (old) {
      gl.deleteFramebuffer(old.frame);
      for (const buffer of old.buffers) gl.deleteRenderbuffer(buffer);
    }
    const frame = gl.createFramebuffer();
    /** @type {WebGLRenderbuffer[]} */
    const buffers = [];
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    for (const [place, format] of /** @type {const} */ ([[gl.COLOR_ATTACHMENT0, gl.RGB8], [gl.DEPTH_ATTACHMENT, gl.DEPTH_COMPONENT24]])) {
      const buffer = gl.createRenderbuffer();
      gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
      gl.renderbufferStorageMultisample(gl.RENDERBUFFER, samples, format, width, height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, place, gl.RENDERBUFFER, buffer);
      buffers.push(buffer);
    }
    const target = { frame, buffers, width, height };
    this.targets.set(samples, target);
    return target;
  }
}
