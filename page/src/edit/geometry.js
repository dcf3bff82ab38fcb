// Plane geometry of the tools: places are [x, y] in metres about the page's origin; no page is needed for it.

/** @typedef {[number, number]} Place */
/** @typedef {{ corners?: Place[], edges?: [Place, Place][], points?: Place[], from?: Place, axis?: Place }} Targets */

/** @type {(one: Place, two: Place) => number} */
export const distance = (one, two) => Math.hypot(two[0] - one[0], two[1] - one[1]);

/** @type {(one: Place, two: Place) => Place} */
export const middle = (one, two) => [(one[0] + two[0]) / 2, (one[1] + two[1]) / 2];

/** @type {(place: Place) => Place} */
export const rounded = ([x, y]) => [Math.round(x * 1000) / 1000, Math.round(y * 1000) / 1000];

/**
 * The edges of a ring.
 * @param {Place[]} ring
 * @returns {[Place, Place][]}
 */
export const edgesOf = ring => ring.map((place, number) => [place, ring[(number + 1) % ring.length]]);

/**
 * The place of an edge that is nearest to a place.
 * @param {Place} place
 * @param {[Place, Place]} edge
 * @returns {Place}
 */
export function nearestOnEdge([x, y], [[ax, ay], [bx, by]]) {
  const [dx, dy] = [bx - ax, by - ay], share = Math.max(0, Math.min(1, ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy || 1)));
  return [ax + share * dx, ay + share * dy];
}

/** Twice the signed area of a ring: positive counter-clockwise.
 * @param {Place[]} ring */
export const twiceArea = ring => edgesOf(ring).reduce((sum, [[ax, ay], [bx, by]]) => sum + ax * by - bx * ay, 0);

/**
 * True if a place lies in a ring.
 * @param {Place} place
 * @param {Place[]} ring
 */
export function contains([x, y], ring) {
  let inside = false;
  for (const [[ax, ay], [bx, by]] of edgesOf(ring)) if (ay > y !== by > y && x < ax + (y - ay) / (by - ay) * (bx - ax)) inside = !inside;
  return inside;
}

/**
 * The direction (of length 1) of a ring's frame: that of its longest edge.
 * @param {Place[]} ring
 * @returns {Place}
 */
export function axisOf(ring) {
  const [one, two] = edgesOf(ring).reduce((best, edge) => (distance(edge[0], edge[1]) > distance(best[0], best[1]) ? edge : best));
  const length = distance(one, two) || 1;
  return [(two[0] - one[0]) / length, (two[1] - one[1]) / length];
}

/**
 * A place joined to what is within `reach` (m) of it: a corner, else both a line of the frame and an edge, an edge, a
 * line of the frame through `from` (along `axis` or across), else a point; and what it was joined to.
 * @param {Place} place
 * @param {Targets} targets
 * @param {number} reach
 * @returns {{ place: Place, kind: string }}
 */
export function snap(place, { corners = [], edges = [], points = [], from, axis = [1, 0] }, reach) {
  const nearest = (/** @type {Place[]} */ places) => {
    let best = null, least = reach;
    for (const one of places) if (distance(one, place) < least) [best, least] = [one, distance(one, place)];
    return best;
  };
  const corner = nearest(corners);
  if (corner) return { place: corner, kind: 'corner' };
  const edge = edges.reduce((/** @type {[Place, Place] | null} */ best, one) => {
    const away = distance(nearestOnEdge(place, one), place);
    return away < reach && (!best || away < distance(nearestOnEdge(place, best), place)) ? one : best;
  }, null);
  const line = from ? frameLine(place, from, axis, reach) : null;
  if (edge && line) {
    const met = crossing(from || place, line.way, edge);
    if (met && distance(met, place) < 2 * reach) return { place: met, kind: 'edge and frame' };
  }
  if (edge) return { place: nearestOnEdge(place, edge), kind: 'edge' };
  if (line) return { place: line.place, kind: 'frame' };
  const point = nearest(points);
  return point ? { place: point, kind: 'point' } : { place, kind: '' };
}

/**
 * The place of the line through `from`, along or across an axis, that is nearest to a place within `reach`.
 * @param {Place} place
 * @param {Place} from
 * @param {Place} axis
 * @param {number} reach
 * @returns {{ place: Place, way: Place } | null}
 */
export function frameLine([x, y], [fx, fy], [ux, uy], reach) {
  const along = (x - fx) * ux + (y - fy) * uy, across = (y - fy) * ux - (x - fx) * uy;
  if (Math.min(Math.abs(along), Math.abs(across)) > reach) return null;
  if (Math.abs(across) <= Math.abs(along)) return { place: [fx + along * ux, fy + along * uy], way: [ux, uy] };
  return { place: [fx - across * uy, fy + across * ux], way: [-uy, ux] };
}

/**
 * Where the line from a place along a way meets the line of an edge: the place, how many ways on, and at which share of
 * the edge; null where they are parallel.
 * @param {Place} from
 * @param {Place} way
 * @param {[Place, Place]} edge
 * @returns {{ place: Place, ahead: number, share: number } | null}
 */
export function meeting([fx, fy], [ux, uy], [[ax, ay], [bx, by]]) {
  const [dx, dy] = [bx - ax, by - ay], size = ux * dy - uy * dx;
  if (Math.abs(size) < 1e-3 * Math.hypot(ux, uy) * Math.hypot(dx, dy)) return null;
  const share = ((ax - fx) * uy - (ay - fy) * ux) / size, place = /** @type {Place} */ ([ax + share * dx, ay + share * dy]);
  return { place, share, ahead: ((place[0] - fx) * ux + (place[1] - fy) * uy) / (ux * ux + uy * uy) };
}

/**
 * Where the line from a place along a way meets an edge; null where it does not.
 * @param {Place} from
 * @param {Place} way
 * @param {[Place, Place]} edge
 * @returns {Place | null}
 */
export function crossing(from, way, edge) {
  const met = meeting(from, way, edge);
  return !met || met.share < -1e-9 || met.share > 1 + 1e-9 ? null : met.place;
}

/**
 * A ring with an edge carried on over its end, or over its start, to what its line meets next: the line of a later edge of
 * the ring, which is carried back to it so that the corners between go, or an edge of a neighbour, to which the wall at
 * the edge's end moves. Null where it meets nothing within `reach` (m).
 * @param {Place[]} ring
 * @param {number} number
 * @param {boolean} overEnd
 * @param {[Place, Place][]} others
 * @param {number} [reach]
 * @returns {Place[] | null}
 */
export function carriedOn(ring, number, overEnd, others, reach = 25) {
  const count = ring.length, at = (/** @type {number} */ place) => ring[(number + place) % count];
  if (!overEnd) return carriedOn([...ring].reverse(), (2 * count - 2 - number) % count, true, others, reach)?.reverse() ?? null;
  const [start, end] = [at(0), at(1)], length = distance(start, end) || 1, way = /** @type {Place} */ ([(end[0] - start[0]) / length, (end[1] - start[1]) / length]);
  /** @type {Place[] | null} */
  let best = null;
  let least = reach;
  for (let later = 2; later < count - 1; later++) {
    const met = meeting(end, way, [at(later), at(later + 1)]);
    if (!met || met.ahead < 1e-3 || met.ahead > least || met.share > 1 + 1e-9) continue;
    [best, least] = [[start, rounded(met.place), ...Array.from({ length: count - later - 1 }, (_, place) => at(later + 1 + place))], met.ahead];
    break;
  }
  for (const edge of others) {
    const met = meeting(end, way, edge);
    if (!met || met.ahead < 0.05 || met.ahead > least || met.share < -1e-9 || met.share > 1 + 1e-9) continue;
    const moved = new Map(edgeMoved(ring, (number + 1) % count, met.place));
    [best, least] = [ring.map(corner => moved.get(corner) ?? corner), met.ahead];
  }
  return best;
}

/**
 * Edges of a model that may be ridges: level, longer than 0.5 m, within the outline; each once.
 * @param {[number, number, number][][]} edges
 * @param {Place[][]} rings
 * @returns {[Place, Place][]}
 */
export function ridgesOf(edges, rings) {
  const outline = rings.flatMap(edgesOf), found = /** @type {Map<string, [Place, Place]>} */ (new Map());
  for (const [one, two] of edges) {
    const ends = /** @type {[Place, Place]} */ ([[one[0], one[1]], [two[0], two[1]]].map(place => rounded(/** @type {Place} */ (place)))), length = distance(ends[0], ends[1]), between = middle(ends[0], ends[1]);
    if (length < 0.5 || Math.abs(one[2] - two[2]) > 0.1 * length) continue;
    if (outline.some(edge => distance(nearestOnEdge(between, edge), between) < 0.1)) continue;
    found.set(ends.map(String).sort().join(), ends);
  }
  return [...found.values()];
}

/**
 * A line moved aside to go through a place.
 * @param {[Place, Place]} line
 * @param {Place} to
 * @returns {[Place, Place]}
 */
export function movedAside([one, two], to) {
  const moved = rectangle(one, two, to);
  return [rounded(moved[3]), rounded(moved[2])];
}

/**
 * The rectangle of an edge and a third place on the opposite side.
 * @param {Place} one
 * @param {Place} two
 * @param {Place} three
 * @returns {Place[]}
 */
export function rectangle(one, two, three) {
  const length = distance(one, two) || 1, normal = [-(two[1] - one[1]) / length, (two[0] - one[0]) / length];
  const deep = (three[0] - one[0]) * normal[0] + (three[1] - one[1]) * normal[1];
  const moved = (/** @type {Place} */ place) => /** @type {Place} */ ([place[0] + deep * normal[0], place[1] + deep * normal[1]]);
  return [one, two, moved(two), moved(one)];
}

/**
 * The last corner of a polygon of right angles, between its first and its last place: it closes both edges in
 * the frame of the first edge.
 * @param {Place[]} places
 * @returns {Place | null}
 */
export function closingCorner(places) {
  if (places.length < 3) return null;
  const [one] = places, last = places[places.length - 1], [ux, uy] = axisOf(places.slice(0, 2));
  const away = [last[0] - one[0], last[1] - one[1]], along = away[0] * ux + away[1] * uy, across = away[1] * ux - away[0] * uy;
  if (Math.abs(along) < 1e-6 || Math.abs(across) < 1e-6) return null;
  const before = places[places.length - 2], cameAlong = Math.abs((last[0] - before[0]) * ux + (last[1] - before[1]) * uy) > Math.abs((last[1] - before[1]) * ux - (last[0] - before[0]) * uy);
  return cameAlong ? [last[0] + across * uy, last[1] - across * ux] : [last[0] - along * ux, last[1] - along * uy];
}

/**
 * The two parts into which a line divides a ring without courtyards; null where it does not cross it just twice.
 * The ends of the line are carried on.
 * @param {Place[]} ring
 * @param {Place} one
 * @param {Place} two
 * @returns {[Place[], Place[]] | null}
 */
export function divided(ring, one, two) {
  const way = /** @type {Place} */ ([two[0] - one[0], two[1] - one[1]]), side = (/** @type {Place} */ [x, y]) => way[0] * (y - one[1]) - way[1] * (x - one[0]);
  /** @type {[Place[], Place[]]} */
  const parts = [[], []];
  let changes = 0;
  for (const [a, b] of edgesOf(ring)) {
    const here = side(a) >= 0 ? 0 : 1, there = side(b) >= 0 ? 0 : 1;
    parts[here].push(a);
    if (here === there) continue;
    changes++;
    const share = side(a) / (side(a) - side(b)), met = /** @type {Place} */ ([a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])]);
    parts[0].push(met);
    parts[1].push(met);
  }
  return changes === 2 ? parts : null;
}

/**
 * An edge of a ring moved along its normal to go through a place: its two corners with where they go.
 * @param {Place[]} ring
 * @param {number} number
 * @param {Place} to
 * @returns {[Place, Place][]}
 */
export function edgeMoved(ring, number, to) {
  const one = ring[number], two = ring[(number + 1) % ring.length], length = distance(one, two) || 1;
  const normal = [-(two[1] - one[1]) / length, (two[0] - one[0]) / length], deep = (to[0] - one[0]) * normal[0] + (to[1] - one[1]) * normal[1];
  const before = ring[(number + ring.length - 1) % ring.length], after = ring[(number + 2) % ring.length];
  const shift = (/** @type {Place} */ corner, /** @type {Place} */ beside) => {
    // along the edge beside it where that is no continuation, so that its direction stays
    const [wx, wy] = [beside[0] - corner[0], beside[1] - corner[1]], rise = wx * normal[0] + wy * normal[1];
    const steep = Math.abs(rise) > 0.3 * Math.hypot(wx, wy), step = steep ? [wx * deep / rise, wy * deep / rise] : [normal[0] * deep, normal[1] * deep];
    return rounded([corner[0] + step[0], corner[1] + step[1]]);
  };
  return [[one, shift(one, before)], [two, shift(two, after)]];
}

/** Places set one after another, taken back and set again. */
export class Draft {
  constructor() {
    /** @type {Place[]} */
    this.places = [];
    /** @type {Place[]} */
    this.undone = [];
  }

  /** @param {Place} place */
  add(place) {
    this.places.push(rounded(place));
    this.undone = [];
  }

  undo() {
    const last = this.places.pop();
    if (last) this.undone.push(last);
    return !!last;
  }

  redo() {
    const last = this.undone.pop();
    if (last) this.places.push(last);
    return !!last;
  }
}
