// The table of all buildings: only the lines in sight are in the page, so that a city's are no burden.
import { element, figure, page } from './page.js';

export const LINES_MORE = 12;

// Without a model, then by rising probability of being right, as the layer review has them; where a run does not say it, coarser than asked for and by falling distance of the points to the roof.
export function worstFirst(rows) {
  const without = row => row.lod === null || row.lod === undefined, rank = row => (without(row) ? 2 : row.failure_code ? 1 : 0), fit = row => row.rmse_m ?? 0;
  const right = row => (without(row) ? 0 : row.trust_score ?? 1);
  return rows.map((_, number) => number).sort((one, two) => right(rows[one]) - right(rows[two]) || rank(rows[two]) - rank(rows[one]) || fit(rows[two]) - fit(rows[one]) || one - two);
}

export class Table {
  constructor(table, columns, rows, choose) {
    Object.assign(this, { table, columns, rows, choose, column: null, up: true, order: worstFirst(rows), at: 0, marked: -1 });
    this.box = table.parentElement;
    table.setAttribute('aria-rowcount', rows.length + 1);
    const head = table.createTHead().insertRow();
    for (const { name, title } of columns) {
      const button = element('button', { type: 'button', title: page.meanings[name]?.[1] || '' }, title), cell = element('th', { scope: 'col', ...this.kind(name) }, button);
      button.addEventListener('click', () => this.sort(name, cell));
      head.append(cell);
    }
    const body = this.body = table.createTBody();
    this.keepWidths();
    [this.over, this.under] = [element('div'), element('div')];
    table.before(this.over);
    table.after(this.under);
    const of = event => event.target.closest('tr[data-row]');
    body.addEventListener('click', event => of(event) && choose(Number(of(event).dataset.row)));
    body.addEventListener('keydown', event => this.key(event, of(event)));
    this.box.addEventListener('scroll', () => this.fill());
    new ResizeObserver(() => this.fill()).observe(this.box);
    this.tall = 28;
    this.fill();
    if (body.rows.length) this.tall = body.rows[0].getBoundingClientRect().height || this.tall;
    this.fill();
  }

  kind(name) { return this.columns.find(column => column.name === name).number ? { class: 'number' } : {}; }

  // A line that is not seen holds the longest text of every column: columns keep their widths as lines come and go.
  keepWidths() {
    const line = this.table.createTFoot().insertRow();
    line.setAttribute('aria-hidden', 'true');
    for (const { name } of this.columns) {
      let longest = '';
      for (const row of this.rows) {
        const text = figure(row[name]);
        if (text.length > longest.length) longest = text;
      }
      line.append(element('td', this.kind(name), longest));
    }
  }

  line(place) {
    const number = this.order[place], row = this.rows[number];
    const line = element('tr', { 'data-row': number, 'aria-rowindex': place + 2, tabindex: place === this.at ? '0' : '-1', ...(number === this.marked ? { 'aria-selected': 'true' } : {}) });
    for (const { name } of this.columns) line.append(element('td', this.kind(name), figure(row[name])));
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
    if (focused) body.querySelector('tr[tabindex="0"]')?.focus({ preventScroll: true });
  }

  key(event, line) {
    if (!line) return;
    const page = Math.max(1, Math.floor(this.box.clientHeight / this.tall) - 2), last = this.order.length - 1;
    const step = { ArrowDown: 1, ArrowUp: -1, PageDown: page, PageUp: -page, Home: -last, End: last }[event.key];
    if (event.key === 'Enter' || event.key === ' ') this.choose(Number(line.dataset.row));
    else if (step) this.go(Math.max(0, Math.min(last, Number(line.getAttribute('aria-rowindex')) - 2 + step)));
    else return;
    event.preventDefault();
  }

  // Brings a place of the order into sight and gives it the keyboard if a line had it.
  go(place) {
    const { box, tall } = this, head = this.table.tHead.offsetHeight, top = place * tall;
    this.at = place;
    if (top < box.scrollTop) box.scrollTop = top;
    else if (top + tall + head > box.scrollTop + box.clientHeight) box.scrollTop = top + tall + head - box.clientHeight;
    this.fill();
  }

  sort(name, cell) {
    this.up = this.column === name ? !this.up : true;
    this.column = name;
    for (const other of this.table.tHead.rows[0].cells) other.removeAttribute('aria-sort');
    cell.setAttribute('aria-sort', this.up ? 'ascending' : 'descending');
    const missing = value => value === null || value === undefined, { rows } = this;
    this.order.sort((one, two) => {
      const a = rows[one][name], b = rows[two][name];
      if (missing(a) || missing(b)) return missing(a) - missing(b) || one - two;
      return (this.up ? 1 : -1) * (a < b ? -1 : a > b ? 1 : 0) || one - two;
    });
    this.at = 0;
    this.box.scrollTop = 0;
    this.fill();
  }

  // A new row, at the top.
  add(number) {
    this.order = [number, ...this.order.map(other => other + (other >= number ? 1 : 0))];
    this.update();
  }

  remove(number) {
    this.order = this.order.filter(other => other !== number);
    this.update();
  }

  // Rows have changed.
  update() {
    this.state = '';
    this.table.setAttribute('aria-rowcount', this.order.length + 1);
    this.fill();
  }

  mark(number) {
    this.marked = number;
    const place = this.order.indexOf(number);
    if (place >= 0) this.go(place);
    this.fill();
  }
}
