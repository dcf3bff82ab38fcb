// The tools of outlines: each takes places from pointer or keys and ends in one action.
import { axisOf, carriedOn, closingCorner, contains, divided, Draft, distance, edgeMoved, edgesOf, middle, movedAside, nearestOnEdge, rectangle, ridgesOf, rounded, snap } from './geometry.js';

/** @typedef {import('./geometry.js').Place} Place */

const REACH = 10, KEY_STEP = 0.1;

/** What each tool asks for, place by place. */
export const HINTS = {
  corners: 'Drag a corner or an edge; a click on an edge adds a corner. Keys: , . choose a corner, arrows move it (shift: 1 m), Enter sets it, Insert adds one, Backspace deletes it.',
  rectangle: 'Three clicks: two ends of a wall, and the opposite side. Keys: arrows move the cross, Enter sets a place.',
  polygon: 'A click a corner, right angles to the first wall; Enter on the last place or a click on the first corner closes it.',
  split: 'Two clicks: a line across the building.',
  join: 'Click on the building that is one with this.',
  carry: 'Click on an edge near the end over which it is carried on, to what its line meets next.',
  ridge: 'Drag a ridge. Keys: , . choose one, arrows move it (shift: 1 m), Page Up and Down raise it, Enter sets it.',
  unite: 'Two clicks: the faces that are one.',
  dormer: 'Three clicks: two ends of a side of the face, and the opposite side.',
};

/** Tools that take hold of what is there, and those whose places are joined to nothing. */
const HOLDING = ['corners', 'ridge'], FREE = ['join', 'carry', 'unite'], ALONE = ['rectangle', 'polygon'];

export class Tools {
  /**
   * @param {import('./view.js').View} view
   * @param {Record<string, Place[][]>} plans
   * @param {(action: object) => Promise<boolean>} act
   * @param {(words: string) => void} say
   */
  constructor(view, plans, act, say) {
    Object.assign(this, { view, plans, act, say });
    this.view = view;
    this.plans = plans;
    this.act = act;
    this.say = say;
    this.name = '';
    this.draft = new Draft();
    /** @type {{ moves: [Place, Place][], number: number, edge: boolean, to?: Place, rise?: number } | null} */
    this.held = null;
    /** @type {[Place, Place][]} */
    this.ridges = [];
    /** @type {Place | null} */
    this.cursor = null;
    this.corner = -1;
    this.kind = '';
    this.free = false;
    /** @type {Place[][]} */
    this.marks = [];
    view.draw = () => this.draw();
    this.listen();
  }

  get id() { return this.view.chosen; }

  /** The outer ring of the chosen building. */
  get ring() { return this.plans[this.id]?.[0] || []; }

  get height() { return this.view.height(this.id); }

  /** Begins a tool, or ends the one that is used.
   * @param {string} name */
  use(name) {
    const { view } = this;
    this.name = name === this.name ? '' : name;
    if (this.name && !ALONE.includes(this.name) && !this.ring.length) {
      this.name = '';
      this.say('choose a building first');
    }
    this.draft = new Draft();
    Object.assign(this, { held: null, cursor: null, corner: -1, ridges: this.name === 'ridge' ? ridgesOf(view.edges(this.id), this.plans[this.id]) : [] });
    if (this.name) {
      view.above();
      this.say(HINTS[/** @type {keyof typeof HINTS} */ (this.name)]);
    }
    view.canvas.style.cursor = this.name ? 'crosshair' : '';
    for (const button of document.querySelectorAll('[data-tool]')) button.setAttribute('aria-pressed', String(/** @type {HTMLElement} */ (button).dataset.tool === this.name));
    this.draw();
  }

  /** A place joined to corners and edges, the frame and points; to nothing while Alt is held.
   * @param {Place} place
   * @param {Place | undefined} from */
  joined(place, from) {
    this.kind = '';
    if (this.free) return rounded(place);
    const reach = REACH * this.view.step, others = Object.entries(this.plans).filter(([id]) => id !== this.id || !this.held).flatMap(([, rings]) => rings);
    const near = others.filter(ring => ring.some(corner => distance(corner, place) < 60));
    const targets = { corners: near.flat(), edges: near.flatMap(edgesOf), points: this.view.points(place, reach), from, axis: this.ring.length ? axisOf(this.ring) : this.draft.places.length > 1 ? axisOf(this.draft.places.slice(0, 2)) : undefined };
    const found = snap(place, targets, reach);
    this.kind = found.kind;
    return rounded(found.place);
  }

  listen() {
    const { view } = this, stage = /** @type {HTMLElement} */ (view.canvas.parentElement);
    const stop = (/** @type {Event} */ event) => { event.stopPropagation(); event.preventDefault(); };
    let moved = 0;
    stage.addEventListener('pointerdown', (/** @type {PointerEvent} */ event) => {
      if (!this.name || event.button || event.shiftKey || event.target !== view.canvas) return;
      const place = view.under(event, this.height);
      if (!place) return;
      moved = 0;
      if (HOLDING.includes(this.name) && !this.grip(place)) return;
      view.canvas.focus({ preventScroll: true });
      view.canvas.setPointerCapture(event.pointerId);
      stop(event);
    }, true);
    stage.addEventListener('pointermove', (/** @type {PointerEvent} */ event) => {
      if (!this.name) return;
      const place = view.under(event, this.height);
      if (!place) return;
      this.free = event.altKey;
      if (this.held) {
        moved += Math.hypot(event.movementX, event.movementY);
        this.drag(place);
        stop(event);
      } else if (!HOLDING.includes(this.name)) {
        this.cursor = this.taken(place);
        this.draw();
      }
    }, true);
    stage.addEventListener('pointerup', (/** @type {PointerEvent} */ event) => {
      if (!this.name || event.button || event.target !== view.canvas) return;
      const place = view.under(event, this.height);
      if (!place) return;
      if (this.held) {
        stop(event);
        this.drop(place, moved);
      } else if (!HOLDING.includes(this.name)) {
        stop(event);
        this.take(this.taken(place));
      }
    }, true);
  }

  /** A place that a tool takes, joined to what is near but for tools that only point.
   * @param {Place} place */
  taken(place) {
    return FREE.includes(this.name) ? place : this.joined(place, this.draft.places.at(-1));
  }

  /** Takes hold of a corner or an edge of the chosen building, or of a ridge, near a place.
   * @param {Place} place */
  grip(place) {
    const { ring } = this, reach = REACH * this.view.step;
    if (this.name === 'ridge') {
      this.corner = this.ridges.findIndex(edge => distance(nearestOnEdge(place, edge), place) < reach);
      if (this.corner >= 0) this.held = { moves: [], number: this.corner, edge: true, to: place, rise: 0 };
      return this.corner >= 0;
    }
    const corner = ring.findIndex(one => distance(one, place) < reach);
    const number = corner >= 0 ? corner : edgesOf(ring).findIndex(edge => distance(nearestOnEdge(place, edge), place) < reach);
    if (number < 0) return false;
    this.held = { moves: [], number, edge: corner < 0 };
    this.corner = corner;
    return true;
  }

  /** @param {Place} place */
  drag(place) {
    const { held, ring } = this;
    if (!held) return;
    if (held.to) {
      held.to = this.joined(place, undefined);
      return this.draw();
    }
    const before = ring[(held.number + ring.length - 1) % ring.length];
    const to = this.joined(place, held.edge ? undefined : before);
    held.moves = held.edge ? edgeMoved(ring, held.number, to) : [[ring[held.number], to]];
    this.draw();
  }

  /** @param {Place} place
   * @param {number} moved */
  drop(place, moved) {
    const { held, ring } = this;
    this.held = null;
    if (held?.to) return moved > 4 ? this.moveRidge(held) : this.draw();
    if (held && moved > 4 && held.moves.length) return this.act({ do: 'move', id: this.id, moves: held.moves });
    if (held?.edge) return this.insert(held.number, rounded(nearestOnEdge(place, edgesOf(ring)[held.number])));
    this.draw();
  }

  /** @param {{ number: number, to?: Place, rise?: number }} held */
  moveRidge({ number, to, rise }) {
    return this.end({ do: 'ridge', id: this.id, line: this.ridges[number], to, rise: rise ?? 0 });
  }

  /** The outer ring with the edge at a place carried on; null where there is none to carry.
   * @param {Place} place */
  carried(place) {
    const { ring, id } = this, away = edgesOf(ring).map(edge => distance(nearestOnEdge(place, edge), place)), number = away.indexOf(Math.min(...away));
    if (!(away[number] < 2 * REACH * this.view.step)) return null;
    const [one, two] = edgesOf(ring)[number], others = Object.entries(this.plans).filter(([other]) => other !== id).flatMap(([, rings]) => rings.flatMap(edgesOf)).filter(edge => distance(edge[0], place) < 100);
    return carriedOn(ring, number, distance(place, two) < distance(place, one), others);
  }

  /** Adds a corner behind that of a number.
   * @param {number} number
   * @param {Place} place */
  insert(number, place) {
    this.corner = number + 1;
    return this.act({ do: 'outline', id: this.id, plan: [...this.ring.slice(0, number + 1), place, ...this.ring.slice(number + 1)] });
  }

  /** Takes a place of a tool that goes place by place.
   * @param {Place} place */
  take(place) {
    const { draft, name, id } = this;
    if (name === 'join') {
      const other = Object.keys(this.plans).find(one => one !== id && contains(place, this.plans[one][0]));
      return other ? this.end({ do: 'join', ids: [id, other] }) : this.say('no other building is there');
    }
    if (name === 'carry') {
      const plan = this.carried(place);
      return plan ? this.end({ do: 'outline', id, plan }) : this.say('the line of the edge meets nothing there');
    }
    if (name === 'polygon' && draft.places.length > 2 && distance(place, draft.places[0]) < REACH * this.view.step) return this.close();
    draft.add(place);
    if (name === 'unite' && draft.places.length === 2) return this.end({ do: 'unite', id, at: draft.places });
    if ((name === 'rectangle' || name === 'dormer') && draft.places.length === 3) {
      const plan = rectangle(draft.places[0], draft.places[1], draft.places[2]).map(rounded);
      return this.end(name === 'dormer' ? { do: 'face', id, plan } : { do: 'draw', plan });
    }
    if (name === 'split' && draft.places.length === 2) return this.end({ do: 'split', id, line: draft.places });
    this.draw();
  }

  /** Closes a polygon, with the corner that right angles ask for. */
  close() {
    const { places } = this.draft, last = closingCorner(places);
    if (places.length < 3) return this.say('a polygon has three corners at least');
    return this.end({ do: 'draw', plan: last ? [...places, rounded(last)] : places });
  }

  /** @param {object} action */
  end(action) {
    this.use('');
    return this.act(action);
  }

  /** Answers a key of the tool that is used; false for those it does not know.
   * @param {KeyboardEvent} event */
  key(event) {
    const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key], { ring, draft, view } = this;
    if (!this.name) return false;
    const far = event.shiftKey ? 10 * KEY_STEP : KEY_STEP;
    if (event.key === 'Escape') this.use('');
    else if (event.ctrlKey || event.metaKey) {
      if (!draft.places.length && !draft.undone.length) return false;
      if (event.key === 'z' ? !draft.undo() : !(event.key === 'y' && draft.redo())) return false;
    } else if (HOLDING.includes(this.name) && (event.key === '.' || event.key === ',')) {
      const [count, word] = this.name === 'ridge' ? [this.ridges.length, 'ridge'] : [ring.length, 'corner'];
      this.held = null;
      this.corner = count ? (this.corner + (event.key === '.' ? 1 : this.corner < 0 ? 0 : -1) + count) % count : -1;
      this.say(count ? `${word} ${this.corner + 1} of ${count}` : `there is no ${word}`);
    } else if (this.name === 'ridge' && this.corner >= 0) {
      const line = this.ridges[this.corner], held = this.held ?? { moves: [], number: this.corner, edge: true, to: middle(line[0], line[1]), rise: 0 }, [x, y] = held.to ?? [0, 0];
      const up = { PageUp: 1, PageDown: -1 }[event.key];
      if (event.key === 'Enter' && this.held) this.moveRidge(held);
      else if (arrow) this.held = { ...held, to: [x + far * arrow[0], y + far * arrow[1]] };
      else if (up) this.held = { ...held, rise: (held.rise ?? 0) + far * up };
      else return false;
      if (this.held) this.say(`ridge ${this.held.rise?.toFixed(1)} m higher`);
    } else if (this.name === 'corners' && this.corner >= 0) {
      const at = ring[this.corner], next = ring[(this.corner + 1) % ring.length];
      if (arrow) {
        const from = this.held ? this.held.moves[0][1] : at;
        this.held = { moves: [[at, rounded([from[0] + far * arrow[0], from[1] + far * arrow[1]])]], number: this.corner, edge: false };
      } else if (event.key === 'Enter' && this.held) {
        const { moves } = this.held;
        this.held = null;
        this.act({ do: 'move', id: this.id, moves });
      } else if (event.key === 'Insert') this.insert(this.corner, rounded(middle(at, next)));
      else if (event.key === 'Backspace') this.act({ do: 'outline', id: this.id, plan: ring.filter((_, number) => number !== this.corner) });
      else return false;
    } else if (arrow) {
      const [x, y] = this.cursor || draft.places.at(-1) || /** @type {Place} */ (view.viewer.camera.target.slice(0, 2));
      this.cursor = rounded([x + far * arrow[0], y + far * arrow[1]]);
    } else if (event.key === 'Enter' && this.cursor) {
      const last = draft.places.at(-1);
      if (this.name === 'polygon' && last && distance(last, this.cursor) < 0.05) this.close();
      else this.take(this.cursor);
    } else return false;
    this.draw();
    return true;
  }

  draw() {
    const { view, ring, name, draft, held, cursor } = this, z = this.height, shapes = /** @type {any[]} */ (this.marks.map(line => ({ line, z, kind: 'mark' })));
    const moved = ring.map(corner => held?.moves.find(([from]) => from === corner)?.[1] || corner);
    this.ridges.forEach((line, number) => shapes.push({ line: held?.to && held.number === number ? movedAside(line, held.to) : line, z, kind: number === this.corner ? 'ridge held' : 'ridge', data: { ridge: number } }));
    if (name && ring.length && this.id) shapes.push({ line: moved, closed: true, z, kind: 'plan' });
    if (name === 'corners') moved.forEach((at, number) => shapes.push({ at, z, kind: number === this.corner ? 'corner held' : 'corner', data: { corner: number } }));
    const places = cursor ? [...draft.places, cursor] : draft.places;
    const carried = name === 'carry' && cursor ? this.carried(cursor) : null;
    if (carried) shapes.push({ line: carried, closed: true, z, kind: 'draft' });
    if ((name === 'rectangle' || name === 'dormer') && places.length === 3) shapes.push({ line: rectangle(places[0], places[1], places[2]), closed: true, z, kind: 'draft' });
    else if (name === 'split' && places.length === 2 && divided(ring, places[0], places[1])) for (const line of divided(ring, places[0], places[1]) || []) shapes.push({ line, closed: true, z, kind: 'draft' });
    else if (places.length > 1) shapes.push({ line: places, z, kind: 'draft' });
    draft.places.forEach(at => shapes.push({ at, z, kind: 'corner' }));
    if (cursor) shapes.push({ at: cursor, z, kind: 'cursor' });
    if ((cursor || held) && this.kind) shapes.push({ at: cursor || held?.to || held?.moves[0]?.[1], z, kind: 'joined', text: this.kind });
    view.show(shapes.filter(shape => shape.line || shape.at));
  }
}
