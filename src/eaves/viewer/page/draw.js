// WebGL2: points, triangles and lines with a colour and a building each; the same drawn as numbers to pick from.
const VERTEX = `#version 300 es
precision highp float;
in vec3 position; in vec4 colour; in float building;
uniform mat4 view; uniform float chosen, only, picking, points, strength; uniform vec3 mark, eye;
out vec3 place; out vec4 tint;
void main() {
  place = position;
  vec3 nearer = points != 0.0 ? place + 0.15 * normalize(eye - place) : place;
  gl_Position = view * vec4(nearer, 1.0);
  gl_PointSize = points > 0.0 ? clamp(points / gl_Position.w, 1.5, 11.0) : -points;
  bool mine = chosen > 0.0 && abs(building - chosen) < 0.5;
  bool shown = colour.a > 0.0 && (only < 0.5 || mine || building < 0.5);
  if (!shown || (picking > 0.5 && building < 0.5 && colour.a < 0.99)) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  tint = mine ? vec4(mix(colour.rgb, mark, strength), 1.0) : colour;
  if (picking > 0.5) {
    float rest = floor(building + 0.5);
    tint = vec4(mod(rest, 256.0), mod(floor(rest / 256.0), 256.0), floor(rest / 65536.0), 255.0) / 255.0;
  }
}`;
const FRAGMENT = `#version 300 es
precision highp float;
in vec3 place; in vec4 tint;
uniform float picking, shaded, points; uniform vec3 eye;
out vec4 result;
void main() {
  if (picking > 0.5) { result = tint; return; }
  float light = 1.0;
  if (shaded > 0.5) {
    vec3 normal = normalize(cross(dFdx(place), dFdy(place)));
    if (dot(normal, eye - place) < 0.0) normal = -normal;
    light = 0.62 + 0.3 * max(0.0, dot(normal, normalize(vec3(-0.6, 0.5, 0.65)))) + 0.14 * max(0.0, normal.z);
  } else if (points != 0.0 && distance(gl_PointCoord, vec2(0.5)) > 0.5) discard;
  result = vec4(tint.rgb * light, 1.0);
}`;
const UNIFORMS = ['view', 'chosen', 'only', 'picking', 'points', 'strength', 'mark', 'shaded', 'eye'];

class Painter {
  constructor(canvas) {
    const gl = this.gl = canvas.getContext('webgl2', { antialias: true, preserveDrawingBuffer: true });
    if (!gl) throw new Error('this browser gives no WebGL2; the table and the figures below work without it');
    this.canvas = canvas;
    this.layers = [];
    const program = this.program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    ['position', 'colour', 'building'].forEach((name, place) => gl.bindAttribLocation(program, place, name));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    this.uniform = Object.fromEntries(UNIFORMS.map(name => [name, gl.getUniformLocation(program, name)]));
  }

  // kind: 'points', 'triangles' or 'lines'; building holds a number for each vertex, 0 for none.
  add(kind, position, building, { shaded = false, indices = null, pickable = true, strength = 0 } = {}) {
    const gl = this.gl, vao = gl.createVertexArray(), count = position.length / 3;
    gl.bindVertexArray(vao);
    const fill = (place, data, size, type, normalised) => {
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, size, type, normalised, 0, 0);
      return buffer;
    };
    fill(0, position, 3, gl.FLOAT, false);
    const colour = fill(1, new Uint8Array(4 * count), 4, gl.UNSIGNED_BYTE, true);
    fill(2, building, 1, gl.UNSIGNED_INT, false);
    if (indices) {
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
    }
    gl.bindVertexArray(null);
    const mode = { points: gl.POINTS, triangles: gl.TRIANGLES, lines: gl.LINES }[kind];
    const layer = { kind, mode, vao, colour, count: indices ? indices.length : count, indexed: !!indices, shaded, pickable, strength };
    this.layers.push(layer);
    return layer;
  }

  recolour(layer, colours) {
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, layer.colour);
    this.gl.bufferData(this.gl.ARRAY_BUFFER, colours, this.gl.DYNAMIC_DRAW);
  }

  resize() {
    const ratio = Math.min(2, window.devicePixelRatio || 1), { clientWidth, clientHeight } = this.canvas;
    const [width, height] = [clientWidth, clientHeight].map(side => Math.max(1, Math.round(side * ratio)));
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
  }

  paint(camera, look, picking = false) {
    const gl = this.gl, uniform = this.uniform, { width, height } = this.canvas;
    gl.viewport(0, 0, width, height);
    gl.clearColor(...(picking ? [0, 0, 0, 0] : [...look.background, 1]));
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    gl.useProgram(this.program);
    gl.uniformMatrix4fv(uniform.view, false, camera.matrix(width / height));
    gl.uniform3fv(uniform.eye, camera.eye());
    gl.uniform1f(uniform.chosen, look.chosen);
    gl.uniform1f(uniform.only, look.only ? 1 : 0);
    gl.uniform1f(uniform.picking, picking ? 1 : 0);
    const spot = look.pointSize / camera.step(height);
    for (const layer of this.layers) {
      if (!layer.count || (picking && !layer.pickable)) continue;
      const points = layer.kind === 'points' ? (camera.flat ? -Math.min(11, Math.max(1.5, spot)) : spot * camera.distance) : 0;
      gl.uniform1f(uniform.points, points);
      gl.uniform1f(uniform.shaded, layer.shaded ? 1 : 0);
      gl.uniform1f(uniform.strength, layer.strength);
      gl.uniform3fv(uniform.mark, look.mark);
      if (layer.kind === 'triangles') {
        gl.enable(gl.POLYGON_OFFSET_FILL);
        gl.polygonOffset(1.5, 2);
      } else gl.disable(gl.POLYGON_OFFSET_FILL);
      gl.bindVertexArray(layer.vao);
      if (layer.indexed) gl.drawElements(layer.mode, layer.count, gl.UNSIGNED_INT, 0);
      else gl.drawArrays(layer.mode, 0, layer.count);
    }
    gl.bindVertexArray(null);
  }

  // The building number drawn nearest to a place (pixels of the page) within three pixels; 0 for none.
  pick(camera, look, x, y) {
    const gl = this.gl, { width, height } = this.canvas, ratio = width / this.canvas.clientWidth;
    if (!this.target || this.target.width !== width || this.target.height !== height) this.makeTarget(width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target.frame);
    this.paint(camera, look, true);
    const reach = 3, side = 2 * reach + 1, pixels = new Uint8Array(4 * side * side);
    gl.readPixels(Math.round(x * ratio) - reach, height - Math.round(y * ratio) - reach, side, side, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    let best = 0, nearest = Infinity;
    for (let place = 0; place < side * side; place++) {
      const number = pixels[4 * place] + 256 * pixels[4 * place + 1] + 65536 * pixels[4 * place + 2];
      const away = Math.hypot(place % side - reach, Math.floor(place / side) - reach);
      if (number && away < nearest) [best, nearest] = [number, away];
    }
    return best;
  }

  makeTarget(width, height) {
    const gl = this.gl, frame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    for (const [place, format] of [[gl.COLOR_ATTACHMENT0, gl.RGBA8], [gl.DEPTH_ATTACHMENT, gl.DEPTH_COMPONENT24]]) {
      const buffer = gl.createRenderbuffer();
      gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
      gl.renderbufferStorage(gl.RENDERBUFFER, format, width, height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, place, gl.RENDERBUFFER, buffer);
    }
    this.target = { frame, width, height };
  }
}
