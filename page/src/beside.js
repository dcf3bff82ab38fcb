// Two pages that turn together: what moves in one is brought to the other, over the difference of their origins.

/** @import { Box } from './types.js' */
/** @import { Viewer } from './viewer.js' */
const windows = [...document.querySelectorAll('iframe')].map(frame => /** @type {Window} */ (frame.contentWindow));
const NEAR = 10;

/** @param {Viewer} viewer */
const world = ({ camera, origin }) => JSON.stringify([camera.azimuth, camera.elevation, camera.distance, camera.flat, ...camera.target.map((value, axis) => value + origin[axis])]);

/** @param {Viewer} viewer @param {string} state */
function follow(viewer, state) {
  const [azimuth, elevation, distance, flat, ...target] = JSON.parse(state);
  Object.assign(viewer.camera, { azimuth, elevation, distance, flat, target: target.map((/** @type {number} */ value, /** @type {number} */ axis) => value - viewer.origin[axis]) });
  viewer.ask();
}

// The building of one run that stands where the chosen one of the other does; −1 when there is none within a few metres.
/** @param {Viewer} from @param {Viewer} to */
function counterpart(from, to) {
  const middle = (/** @type {Box} */ { low, high }, /** @type {Viewer} */ { origin }) => [0, 1].map(axis => (low[axis] + high[axis]) / 2 + origin[axis]);
  const spot = from.spots[from.look.chosen - 1];
  if (!spot) return -1;
  const [x, y] = middle(spot, from), away = to.spots.map(other => Math.hypot(middle(other, to)[0] - x, middle(other, to)[1] - y));
  const nearest = away.indexOf(Math.min(...away));
  return away[nearest] <= NEAR ? nearest : -1;
}

/** @param {Viewer[]} viewers */
function begin(viewers) {
  for (const frame of windows) frame.document.documentElement.dataset.framed = 'yes';
  viewers[0].obeyAddress(location.hash);
  follow(viewers[1], world(viewers[0]));
  let seen = viewers.map(world), chosen = viewers.map(() => 0), kept = '';
  const step = () => {
    const moved = viewers.findIndex((viewer, place) => world(viewer) !== seen[place]);
    if (moved >= 0) follow(viewers[1 - moved], world(viewers[moved]));
    seen = viewers.map(world);
    const picked = viewers.findIndex((viewer, place) => viewer.look.chosen !== chosen[place]);
    if (picked >= 0) viewers[1 - picked].choose(counterpart(viewers[picked], viewers[1 - picked]), false);
    chosen = viewers.map(viewer => viewer.look.chosen);
    const address = viewers[0].address();
    if (address !== kept && moved < 0) history.replaceState(null, '', kept = address);
    requestAnimationFrame(step);
  };
  document.documentElement.dataset.ready = 'yes';
  step();
}

const waiting = setInterval(() => {
  const viewers = windows.map(frame => frame.eaves);
  if (viewers.some(viewer => !viewer)) return;
  clearInterval(waiting);
  begin(viewers);
}, 50);
