// When what is drawn: all of it where the machine keeps up; else less while it moves, and all of it once it rests.
/** @import { Look, Quality } from './types.js' */
/** @import { Camera } from './camera.js' */
/** @import { Painter } from './draw.js' */

// `detail`: pixels that what stands for buildings far away takes at least.
export const QUALITIES = [
  { scale: 1, smooth: true, points: Infinity, ground: 0, lines: true, detail: 0 },
  { scale: 1, smooth: false, points: 120000, ground: 1, lines: true, detail: 1 },
  { scale: 0.7, smooth: false, points: 40000, ground: 2, lines: true, detail: 2 },
  { scale: 0.5, smooth: false, points: 15000, ground: 3, lines: false, detail: 2 },
  { scale: 0.35, smooth: false, points: 8000, ground: 3, lines: false, detail: 2 },
];
// Milliseconds: a frame that takes longer is drawn coarser, one that is shorter may get finer, and how long it
// rests before the whole picture is drawn.
export const LONG = 45, SHORT = 22, REST = 160;

export class Pace {
  /** @param {Painter} painter @param {() => [Camera, Look]} before @param {(quality: number) => void} after */
  constructor(painter, before, after) {
    this.painter = painter;
    this.before = before;
    this.after = after;
    this.quality = this.asked = this.painted = this.easy = 0;
    this.running = false;
    this.wake = () => {};
  }

  // Resolves when there is a picture.
  async first() { while (!this.painted) await new Promise(requestAnimationFrame); }

  ask() {
    this.asked++;
    this.wake();
    document.documentElement.dataset.still = 'no';
    if (!this.running) this.run();
  }

  async run() {
    this.running = true;
    for (let answered = 0, shown = 0; answered !== this.asked || shown > 0;) {
      await new Promise(requestAnimationFrame);
      if (answered !== this.asked) {
        answered = this.asked;
        shown = this.quality;
        const first = !this.painted, milliseconds = await this.paint(QUALITIES[shown]);
        // the first picture also pays for making programs and buffers, so it is no measure of the others
        this.adapt(first ? await this.paint(QUALITIES[shown]) : milliseconds);
        this.after(shown);
        if (shown) await this.rest(answered);
      } else if (await this.paintWhole(answered)) this.after(shown = 0);
    }
    this.running = false;
    document.documentElement.dataset.still = 'yes';
  }

  // One picture at once; the milliseconds it took.
  /** @param {Quality} quality */
  async paint(quality) {
    const began = performance.now(), { painter } = this;
    painter.begin(...this.before(), quality);
    painter.pieces(quality).forEach(piece => painter.draw(piece));
    painter.present();
    await painter.finished();
    if (!this.painted++) performance.mark('picture');
    return performance.now() - began;
  }

  // The whole picture, given up as soon as something else is asked for; whether it was finished.
  /** @param {number} answered */
  async paintWhole(answered) {
    const { painter } = this, [quality] = QUALITIES;
    painter.begin(...this.before(), quality);
    for (const piece of painter.pieces(quality)) {
      painter.draw(piece);
      await painter.finished();
      if (this.asked !== answered) return false;
    }
    painter.present();
    await painter.finished();
    return true;
  }

  /** @param {number} milliseconds */
  adapt(milliseconds) {
    const last = QUALITIES.length - 1;
    if (milliseconds > 8 * LONG) this.quality = Math.max(this.quality, last - 1);
    else if (milliseconds > LONG) this.quality = Math.min(last, this.quality + 1);
    this.easy = milliseconds < SHORT ? this.easy + 1 : 0;
    if (this.easy > 12 && this.quality > 0) [this.quality, this.easy] = [this.quality - 1, 0];
  }

  // Until it rests, or something else is asked for.
  /** @param {number} answered @returns {Promise<void>} */
  rest(answered) {
    return new Promise(done => {
      this.wake = done;
      if (this.asked === answered) setTimeout(done, REST);
      else done();
    });
  }
}
