// Mouse, fingers, keys and the controls.
import { byId, field, page } from './page.js';
import { pickBuilding } from './pick.js';

/** @import { Viewer } from './viewer.js' */

/** @type {Record<string, [number, number]>} */
const ARROWS = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

/** @param {Viewer} viewer */
export function listenToCanvas(viewer) {
  const { canvas, camera } = viewer, down = /** @type {Map<number, [number, number]>} */ (new Map());
  let moved = 0, taken = 0;
  const tap = (/** @type {number} */ x, /** @type {number} */ y) => {
    if (viewer.ruler.active) viewer.ruler.take(x, y);
    else viewer.choose(pickBuilding(viewer, x, y) - 1, false);
  };
  canvas.addEventListener('pointerdown', event => {
    canvas.setPointerCapture(event.pointerId);
    moved = 0;
    if (viewer.tools.pointer('down', event)) taken = event.pointerId;
    else down.set(event.pointerId, [event.clientX, event.clientY]);
  });
  canvas.addEventListener('pointermove', event => {
    if (taken === event.pointerId || !down.size) viewer.tools.pointer('move', event);
    if (!down.has(event.pointerId)) return;
    const [x, y] = down.get(event.pointerId) ?? [0, 0], [right, lower] = [event.clientX - x, event.clientY - y];
    moved += Math.hypot(right, lower);
    if (down.size === 2) {
      const [other] = [...down].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
      camera.zoom(Math.hypot(x - other[0], y - other[1]) / Math.max(1, Math.hypot(event.clientX - other[0], event.clientY - other[1])));
      camera.pan(right / 2, lower / 2, canvas.clientHeight);
    } else if (event.buttons & 6 || event.shiftKey || event.ctrlKey) camera.pan(right, lower, canvas.clientHeight);
    else camera.turn(-right * 0.006, lower * 0.006);
    down.set(event.pointerId, [event.clientX, event.clientY]);
    viewer.ask();
  });
  const lift = (/** @type {PointerEvent} */ event) => {
    const box = canvas.getBoundingClientRect();
    if (taken === event.pointerId) {
      taken = 0;
      viewer.tools.pointer('up', event);
    }
    if (down.delete(event.pointerId) && moved < 4 && event.type === 'pointerup' && event.button === 0) {
      if (!viewer.tools.pointer('tap', event)) tap(event.clientX - box.left, event.clientY - box.top);
      viewer.ask();
    }
  };
  canvas.addEventListener('pointerup', lift);
  canvas.addEventListener('pointercancel', lift);
  canvas.addEventListener('dblclick', () => !viewer.ruler.active && viewer.look.chosen && viewer.choose(viewer.look.chosen - 1));
  canvas.addEventListener('contextmenu', event => event.preventDefault());
  canvas.addEventListener('wheel', event => {
    event.preventDefault();
    camera.zoom(Math.exp(Math.max(-0.4, Math.min(0.4, event.deltaY * (event.deltaMode ? 0.04 : 0.0015)))));
    viewer.ask();
  }, { passive: false });
  canvas.addEventListener('keydown', event => {
    const arrows = ARROWS[event.key], count = viewer.scene.rows.length;
    if (viewer.tools.active?.keydown?.(event)) return event.preventDefault();
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (arrows && event.shiftKey) camera.pan(40 * arrows[0], 40 * arrows[1], canvas.clientHeight);
    else if (arrows) camera.turn(-0.1 * arrows[0], 0.1 * arrows[1]);
    else if ('+='.includes(event.key)) camera.zoom(0.85);
    else if ('-_'.includes(event.key)) camera.zoom(1 / 0.85);
    else if (event.key === 'Escape' && viewer.tools.active) viewer.tools.stop();
    else if (event.key === 'Escape' && viewer.ruler.active) viewer.ruler.toggle(false);
    else if (event.key === 'Escape') viewer.choose(-1);
    else if ('nNpP'.includes(event.key) && count) viewer.choose((viewer.look.chosen - 1 + ('nN'.includes(event.key) ? 1 : -1) + count + (viewer.look.chosen ? 0 : 'nN'.includes(event.key) ? 0 : 1)) % count);
    else if (event.key === 'Enter') tap(canvas.clientWidth / 2, canvas.clientHeight / 2);
    else if (event.key === '/') byId('find').focus();
    else if (!pressed(event.key)) return;
    event.preventDefault();
    viewer.ask();
  });
}

// Presses the button that says it has a key; whether there is one.
/** @param {string} key */
function pressed(key) {
  const button = [.../** @type {NodeListOf<HTMLButtonElement>} */ (document.querySelectorAll('button[aria-keyshortcuts]'))].find(one => one.getAttribute('aria-keyshortcuts') === key);
  button?.click();
  return !!button;
}

/** @param {Viewer} viewer */
export function listenToControls(viewer) {
  for (const control of document.querySelectorAll('#controls input:not([type=text]), #controls select')) control.addEventListener('input', () => viewer.refresh());
  for (const button of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll('[data-view]'))) button.addEventListener('click', () => viewer.view(button.dataset.view ?? ''));
  const find = field('find');
  find.addEventListener('change', () => {
    byId('answer').textContent = '';
    const wanted = find.value.trim(), { all } = viewer, place = wanted.match(/^(-?\d+(?:\.\d+)?)[,; ]+(-?\d+(?:\.\d+)?)$/);
    viewer.network.offer('');
    if (place) return viewer.fly(place.slice(1).map((value, axis) => Number(value) * page.unit - viewer.origin[axis]));
    let number = all.findIndex(row => row.id === wanted);
    if (number < 0 && wanted) number = all.findIndex(row => String(row.id).includes(wanted));
    if (number >= 0) viewer.choose(number);
    else if (wanted) byId('answer').textContent = `no building here has an id with ${wanted} in it`;
    viewer.network.offer(number < 0 ? wanted : '');
  });
  byId('theme').addEventListener('click', () => {
    const root = document.documentElement, dark = getComputedStyle(root).colorScheme === 'dark' || (getComputedStyle(root).colorScheme !== 'light' && matchMedia('(prefers-color-scheme: dark)').matches);
    root.dataset.theme = dark ? 'light' : 'dark';
    viewer.refresh();
  });
}
