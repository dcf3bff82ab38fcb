// The table of all buildings: only the lines in sight are in the page, so that a city's are no burden.
import { byId, element, figure, page } from './page.js';

/** @import { Column, Row } from './types.js' */

const LINES_MORE = 12, HIDDEN = 'eaves.hidden-columns';

// Without a model, then by rising probability of being right, as the layer review has them; where a run does not say it, coarser than asked for and by falling distance of the points to the roof.
/** @param {Row[]} rows */
export function worstFirst(rows) {
  const without = (/** @type {Row} */ row) => row.lod === null || row.lod === undefined, rank = (/** @type {Row} */ row) => (without(row) ? 2 : row.failure_code ? 1 : 0);
  const right = (/** @type {Row} */ row) => (without(row) ? 0 : row.trust_score ?? 1), fit = (/** @type {Row} */ row) => row.rmse_m ?? 0;
  return rows.map((_, number) => number).sort((one, two) => right(rows[one]) - right(rows[two]) || rank(rows[two]) - rank(rows[one]) || fit(rows[two]) - fit(rows[one]) || one - two);
}

// What this browser remembers under a name; a page from disk may be denied it.
/** @param {string} name @param {string[]} [list] @returns {string[]} */
export function remembered(name, list) {
  try {
    if (list) localStorage.setItem(name, JSON.stringify(list));
    const kept = JSON.parse(localStorage.getItem(name) ?? '[]');
    return Array.isArray(kept) ? kept : [];
  } catch { return list ?? []; }
}

export class Table {
  /** @param {HTMLTableElement} table @param {Column[]} columns @param {Row[]} rows @param {(number: number) => void} choose */
  constructor(table, columns, rows, choose) {
    this.table = table;
    this.columns = columns;
    this.rows = rows;
    this.choose = choose;
    /** @type {string | null} */
    this.column = null;
    this.up = true;
    this.order = worstFirst(rows);
    this.at = 0;
    this.marked = -1;
    this.state = '';
    this.box = /** @type {HTMLElement} */ (table.parentElement);
    table.setAttribute('aria-rowcount', String(rows.length + 1));
    const head = table.createTHead().insertRow();
    for (const column of columns) {
      const button = element('button', { type: 'button', title: page.meanings[column.name]?.[1] || '' }, column.title), cell = element('th', { scope: 'col', class: this.kind(column) }, button);
      button.addEventListener('click', () => this.sort(column.name, cell));
      head.append(cell);
    }
    const body = this.body = table.createTBody();
    this.broken = new Set(columns.map(({ name }) => name).filter(name => rows.some(row => typeof row[name] === 'number' && !Number.isInteger(row[name]))));
    this.keepWidths();
    this.offerColumns();
    this.over = element('div');
    this.under = element('div');
    table.before(this.over);
    table.after(this.under);
    const of = (/** @type {Event} */ event) => /** @type {HTMLTableRowElement | null} */ (/** @type {Element} */ (event.target).closest('tr[data-row]'));
    body.addEventListener('click', event => {
      const line = of(event);
      if (line) choose(Number(line.dataset.row));
    });
    body.addEventListener('keydown', event => this.key(event, of(event)));
    for (const name of /** @type {const} */ (['pointerover', 'focusin'])) body.addEventListener(name, event => this.tell(of(event)));
    this.box.addEventListener('scroll', () => this.fill());
    new ResizeObserver(() => this.fill()).observe(this.box);
    this.tall = 28;
    this.fill();
    if (body.rows.length) this.tall = body.rows[0].getBoundingClientRect().height || this.tall;
    this.fill();
  }

  /** @param {Column} column */
  kind({ name, number }) { return `${name === 'id' ? 'id ' : ''}${number ? 'number' : 'words'}`; }

  // A whole number stands with the digits of the others of its column.
  /** @param {Row} row @param {Column} column */
  text(row, { name }) {
    const value = row[name];
    return Number.isInteger(value) && this.broken.has(name) ? figure(value + 1e-9, name) : figure(value, name);
  }

  // A line that is not seen holds the longest text of every column: columns keep their widths as lines come and go.
  keepWidths() {
    const line = this.table.createTFoot().insertRow();
    line.setAttribute('aria-hidden', 'true');
    for (const column of this.columns) {
      let longest = '';
      for (const row of this.rows) {
        const text = this.text(row, column);
        if (text.length > longest.length) longest = text;
      }
      line.append(element('td', { class: this.kind(column) }, longest));
    }
  }

  // A list of the columns but the id, to be chosen from; the choice is remembered.
  offerColumns() {
    const hidden = new Set(remembered(HIDDEN)), style = element('style'), list = element('div', {});
    const hide = () => {
      style.textContent = this.columns.map(({ name }, place) => hidden.has(name) && place ? `#buildings :is(td, th):nth-child(${place + 1}) { display: none; }` : '').join('');
    };
    for (const { name, title } of this.columns.slice(1)) {
      const box = element('input', { type: 'checkbox', ...(hidden.has(name) ? {} : { checked: '' }) });
      box.addEventListener('change', () => {
        hidden[box.checked ? 'delete' : 'add'](name);
        remembered(HIDDEN, [...hidden]);
        hide();
      });
      list.append(element('label', {}, box, title));
    }
    hide();
    this.box.before(element('details', { id: 'columns' }, element('summary', {}, 'Columns'), list), style);
  }

  /** @param {number} place */
  line(place) {
    const number = this.order[place], row = this.rows[number];
    const line = element('tr', { 'data-row': number, 'aria-rowindex': place + 2, tabindex: place === this.at ? '0' : '-1', ...(number === this.marked ? { 'aria-current': 'true' } : {}) });
    for (const column of this.columns) line.append(element('td', { class: this.kind(column) }, element('bdi', {}, this.text(row, column))));
    return line;
  }

  // The lines in sight, and some above and below them.
  fill() {
    const { box, tall, order, body } = this, many = Math.ceil((box.clientHeight || 430) / tall) + 2 * LINES_MORE;
    const first = Math.max(0, Math.min(order.length - many, Math.floor(box.scrollTop / tall) - LINES_MORE)), last = Math.min(order.length, first + many);
    const state = [first, last, this.column, this.up, this.marked, this.at].join();
    if (state === this.state) return;
    const focused = body.contains(document.activeElement);
    this.state = state;
    body.replaceChildren(...Array.from({ length: last - first }, (_, place) => this.line(first + place)));
    this.over.style.height = `${first * tall}px`;
    this.under.style.height = `${(order.length - last) * tall}px`;
    if (focused) /** @type {HTMLElement | null} */ (body.querySelector('tr[tabindex="0"]'))?.focus({ preventScroll: true });
  }

  // The whole of what is cut off in a line, below the table.
  /** @param {HTMLTableRowElement | null} line */
  tell(line) { byId('whole').textContent = [...(line?.cells ?? [])].filter(cell => cell.scrollWidth > cell.clientWidth).map(cell => cell.textContent).join(' · '); }

  /** @param {KeyboardEvent} event @param {HTMLTableRowElement | null} line */
  key(event, line) {
    if (!line) return;
    const page = Math.max(1, Math.floor(this.box.clientHeight / this.tall) - 2), last = this.order.length - 1;
    /** @type {Record<string, number>} */
    const steps = { ArrowDown: 1, ArrowUp: -1, PageDown: page, PageUp: -page, Home: -last, End: last };
    const step = steps[event.key];
    if (event.key === 'Enter' || event.key === ' ') this.choose(Number(line.dataset.row));
    else if (step) this.go(Math.max(0, Math.min(last, Number(line.getAttribute('aria-rowindex')) - 2 + step)));
    else return;
    event.preventDefault();
  }

  // Brings a place of the order into sight and gives it the keyboard if a line had it.
  /** @param {number} place */
  go(place) {
    const { box, tall } = this, head = this.table.tHead?.offsetHeight ?? 0, top = place * tall;
    this.at = place;
    if (top < box.scrollTop) box.scrollTop = top;
    else if (top + tall + head > box.scrollTop + box.clientHeight) box.scrollTop = top + tall + head - box.clientHeight;
    this.fill();
  }

  /** @param {string} name @param {HTMLElement} cell */
  sort(name, cell) {
    this.up = this.column === name ? !this.up : true;
    this.column = name;
    for (const other of this.table.tHead?.rows[0].cells ?? []) other.removeAttribute('aria-sort');
    cell.setAttribute('aria-sort', this.up ? 'ascending' : 'descending');
    const missing = (/** @type {unknown} */ value) => value === null || value === undefined, { rows } = this;
    this.order.sort((one, two) => {
      const a = rows[one][name], b = rows[two][name];
      if (missing(a) || missing(b)) return Number(missing(a)) - Number(missing(b)) || one - two;
      return (this.up ? 1 : -1) * (a < b ? -1 : a > b ? 1 : 0) || one - two;
    });
    this.at = 0;
    this.box.scrollTop = 0;
    this.fill();
  }

  // A new row, at the top.
  /** @param {number} number */
  add(number) {
    this.order = [number, ...this.order.map(other => other + (other >= number ? 1 : 0))];
    this.update();
  }

  /** @param {number} number */
  remove(number) {
    this.order = this.order.filter(other => other !== number);
    this.update();
  }

  // Rows have changed.
  update() {
    this.state = '';
    this.table.setAttribute('aria-rowcount', String(this.order.length + 1));
    this.fill();
  }

  /** @param {number} number */
  mark(number) {
    this.marked = number;
    const place = this.order.indexOf(number);
    if (place >= 0) this.go(place);
    this.fill();
  }
}
