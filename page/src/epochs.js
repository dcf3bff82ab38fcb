// Two epochs in one scene: the old one is drawn left of the slider, the new one right of it.
import { byId, element, field, page } from './page.js';

/** @import { Viewer } from './viewer.js' */

export const HANDLE = 15; // half the width of the slider's handle, in pixels
/** @type {Record<string, string>} */
export const CHANGES = {
  new: '#0a8f3c', demolished: '#d0302f', raised: '#7a3fd1', lowered: '#b8529e', extended: '#2f9fd0', 'partly demolished': '#e2711d',
  'roof replaced': '#c79a00', unclear: '#6b7280', 'not covered': '#9aa4af', unchanged: '#d9d3c5',
};

export class Epochs {
  /** @param {Viewer} viewer */
  constructor(viewer) {
    this.canvas = viewer.canvas;
    if (!page.epochs) return;
    byId('epochs').hidden = false;
    page.epochs.forEach((name, place) => { byId('divider').children[place].textContent = name; });
    byId('swipe').addEventListener('input', () => viewer.ask());
    for (const way of ['lod', 'type', 'fit', 'trust', 'failure']) document.querySelector(`#model-colour [value=${way}]`)?.remove();
    byId('model-colour').prepend(element('option', { value: 'change', selected: '' }, 'change'));
  }

  // The share of the canvas that shows the old epoch.
  share() {
    const wide = this.canvas.clientWidth;
    byId('divider').style.left = `calc(${HANDLE}px + (100% - ${2 * HANDLE}px) * ${Number(field('swipe').value) / 1000})`;
    return (HANDLE + (wide - 2 * HANDLE) * Number(field('swipe').value) / 1000) / wide;
  }

  // Whether a thing of an epoch is seen in a column of pixels.
  /** @param {number} x */
  seenAt(x) {
    const old = x < this.share() * this.canvas.clientWidth;
    return (/** @type {number} */ epoch) => !epoch || (epoch === 1) === old;
  }
}
