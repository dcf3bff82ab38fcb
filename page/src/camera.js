// Where the eye is: it turns about a target; angles in radians, lengths in metres.

/** @import { Box, Place } from './types.js' */

export const FIELD = 0.7, STEEPEST = Math.PI / 2 - 1e-4;

export class Camera {
  azimuth = 0;
  elevation = 0.8;
  distance = 1;
  flat = false;
  size = 1;
  wide = 1;
  deep = 1;
  /** @type {Place} */
  target = [0, 0, 0];

  /** @param {Box} box @param {number} aspect */
  constructor(box, aspect) {
    this.box = box;
    this.aspect = aspect;
    this.reset();
  }

  reset() {
    const { low, high } = this.box;
    this.target = low.map((value, axis) => (value + high[axis]) / 2);
    this.size = Math.max(10, Math.hypot(high[0] - low[0], high[1] - low[1]));
    this.wide = high[0] - low[0];
    this.deep = high[1] - low[1];
    this.flat = false;
    // from the south, or from the side that fills the canvas clearly better
    const tries = [-0.35, -0.35 - Math.PI / 2].map(azimuth => {
      Object.assign(this, { distance: 1.36 * this.size, azimuth, elevation: 0.8, target: low.map((value, axis) => (value + high[axis]) / 2) });
      this.fit();
      return { azimuth, distance: this.distance, target: this.target };
    });
    Object.assign(this, tries[1].distance < 0.85 * tries[0].distance ? tries[1] : tries[0]);
  }

  // As near as it can be with every corner of the box in sight, and the box in the middle of the canvas.
  fit() {
    const { low, high } = this.box, tall = Math.tan(FIELD / 2), axes = this.axes();
    for (let round = 0; round < 8; round++) {
      const least = [Infinity, Infinity], most = [-Infinity, -Infinity];
      for (let corner = 0; corner < 8; corner++) {
        const away = this.target.map((value, axis) => (corner >> axis & 1 ? high : low)[axis] - value);
        const [x, y, z] = [axes.right, axes.up, axes.back].map(axis => axis[0] * away[0] + axis[1] * away[1] + axis[2] * away[2]);
        const depth = Math.max(0.05 * this.distance, this.distance - z);
        [x / (depth * tall * this.aspect), y / (depth * tall)].forEach((place, axis) => {
          least[axis] = Math.min(least[axis], place);
          most[axis] = Math.max(most[axis], place);
        });
      }
      const [right, up] = [0, 1].map(axis => (least[axis] + most[axis]) / 2 * this.distance * tall * (axis ? 1 : this.aspect));
      this.target = this.target.map((value, axis) => value + right * axes.right[axis] + up * axes.up[axis]);
      this.distance = Math.max(10, this.distance * Math.max((most[0] - least[0]) / 1.94, (most[1] - least[1]) / 1.84));
    }
  }

  // From above, all of it when nothing is looked at in particular.
  /** @param {boolean} all */
  above(all) {
    Object.assign(this, { azimuth: 0, elevation: STEEPEST, flat: true });
    if (all) this.distance = 1.06 * Math.max(this.deep, this.wide / this.aspect) / (2 * Math.tan(FIELD / 2));
  }

  /** @param {number} [quarter] */
  side(quarter = 0) { Object.assign(this, { azimuth: quarter * Math.PI / 2, elevation: 0.02, flat: true }); }

  /** @param {number} right @param {number} up */
  turn(right, up) {
    this.azimuth += right;
    this.elevation = Math.min(STEEPEST, Math.max(-0.3, this.elevation + up));
  }

  /** @param {number} factor */
  zoom(factor) { this.distance = Math.min(20 * this.size, Math.max(2, this.distance * factor)); }

  // Metres a pixel covers at the target.
  /** @param {number} height */
  step(height) { return 2 * this.distance * Math.tan(FIELD / 2) / height; }

  axes() {
    const [sin, cos] = [Math.sin(this.azimuth), Math.cos(this.azimuth)];
    const [up, level] = [Math.sin(this.elevation), Math.cos(this.elevation)];
    return {
      right: [cos, sin, 0],
      up: [-sin * up, cos * up, level],
      back: [sin * level, -cos * level, up],
    };
  }

  // By pixels right and down: over the ground, or up and down when seen from the side.
  /** @param {number} right @param {number} down @param {number} height */
  pan(right, down, height) {
    const step = this.step(height), axes = this.axes();
    const level = this.elevation < 0.35 ? axes.up : [-Math.sin(this.azimuth), Math.cos(this.azimuth), 0];
    this.target = this.target.map((value, axis) => value - step * right * axes.right[axis] + step * down * level[axis]);
  }

  eye() {
    const { back } = this.axes();
    return this.target.map((value, axis) => value + this.distance * back[axis]);
  }

  // World to clip space, column by column.
  /** @param {number} aspect */
  matrix(aspect) {
    const { right, up, back } = this.axes(), eye = this.eye();
    const move = [right, up, back].map(axis => -(axis[0] * eye[0] + axis[1] * eye[1] + axis[2] * eye[2]));
    const near = Math.max(0.1, this.distance / 100), far = this.distance + 4 * this.size, tall = Math.tan(FIELD / 2);
    const out = new Float32Array(16);
    for (let column = 0; column < 4; column++) {
      const [x, y, z] = [right, up, back].map((axis, row) => column < 3 ? axis[column] : move[row]), last = column === 3 ? 1 : 0;
      if (this.flat) {
        const reach = 4 * this.size + this.distance;
        out.set([x / (tall * aspect * this.distance), y / (tall * this.distance), -z / reach, last], 4 * column);
        if (last) out[14] = (-z - this.distance) / reach;
      } else {
        out.set([x / (tall * aspect), y / tall, (-(far + near) * z - 2 * far * near * last) / (far - near), -z], 4 * column);
      }
    }
    return out;
  }

  /** @param {Place} center @param {number} radius */
  flyTo(center, radius) {
    this.target = [...center];
    this.distance = Math.max(25, 3.2 * radius);
    if (!this.flat) this.elevation = Math.max(0.35, Math.min(this.elevation, 1.1));
  }
}
