// The table of buildings, its histograms, and the figures of one building.
const element = (tag, attributes = {}, ...children) => {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
};
const figure = value => value === null || value === undefined ? '' : typeof value === 'number' && !Number.isInteger(value) ? value.toFixed(2) : String(value);

class Table {
  constructor(table, columns, rows, choose) {
    Object.assign(this, { table, rows, lines: [], column: null, up: true });
    const head = table.createTHead().insertRow();
    for (const { name, title } of columns) {
      const button = element('button', { type: 'button' }, title), cell = element('th', { scope: 'col', ...(rows.some(row => typeof row[name] === 'number') ? { class: 'number' } : {}) }, button);
      button.addEventListener('click', () => this.sort(name, cell));
      head.append(cell);
    }
    const body = this.body = table.createTBody();
    rows.forEach((row, number) => {
      const line = element('tr', { tabindex: number ? '-1' : '0', 'data-row': number });
      for (const { name } of columns) line.append(element('td', typeof row[name] === 'number' ? { class: 'number' } : {}, figure(row[name])));
      this.lines.push(line);
      body.append(line);
    });
    const of = event => event.target.closest('tr[data-row]');
    body.addEventListener('click', event => of(event) && choose(Number(of(event).dataset.row)));
    body.addEventListener('keydown', event => {
      const line = of(event), next = { ArrowDown: 'nextElementSibling', ArrowUp: 'previousElementSibling' }[event.key];
      if (!line) return;
      if (event.key === 'Enter' || event.key === ' ') choose(Number(line.dataset.row));
      else if (next && line[next]) line[next].focus();
      else return;
      event.preventDefault();
    });
    body.addEventListener('focusin', event => {
      for (const line of body.querySelectorAll('tr[tabindex="0"]')) line.tabIndex = -1;
      if (of(event)) of(event).tabIndex = 0;
    });
  }

  sort(name, cell) {
    this.up = this.column === name ? !this.up : true;
    this.column = name;
    for (const other of this.table.tHead.rows[0].cells) other.removeAttribute('aria-sort');
    cell.setAttribute('aria-sort', this.up ? 'ascending' : 'descending');
    const missing = value => value === null || value === undefined;
    const order = this.rows.map((row, number) => number).sort((one, two) => {
      const [a, b] = [this.rows[one][name], this.rows[two][name]];
      if (missing(a) || missing(b)) return missing(a) - missing(b) || one - two;
      return (this.up ? 1 : -1) * (a < b ? -1 : a > b ? 1 : 0) || one - two;
    });
    this.body.append(...order.map(number => this.lines[number]));
  }

  mark(number) {
    for (const line of this.body.querySelectorAll('[aria-selected]')) line.removeAttribute('aria-selected');
    const line = this.lines[number], box = this.table.parentElement;
    if (!line) return;
    line.setAttribute('aria-selected', 'true');
    const top = line.offsetTop - this.table.tHead.offsetHeight;
    if (top < box.scrollTop || line.offsetTop > box.scrollTop + box.clientHeight - 40) box.scrollTop = top - 60;
  }
}

// Bars upright, with their counts; entries are [label, count].
function bars(title, entries, note = '') {
  const most = Math.max(1, ...entries.map(([, count]) => count));
  const list = element('ol', { class: 'bars' });
  for (const [label, count] of entries) {
    const bar = element('span', { class: 'bar', style: `height:${count ? Math.max(2, 110 * count / most) : 0}px` });
    list.append(element('li', { title: `${label}: ${count}` }, element('span', { class: 'count' }, count ? String(count) : ''), bar, element('span', { class: 'label' }, label)));
  }
  return element('figure', {}, element('figcaption', {}, title, ' ', element('small', {}, note)), list);
}

function histogram(title, values, width, top, unit, note = '') {
  const known = values.filter(Number.isFinite), count = Math.round(top / width), bins = new Array(count + 1).fill(0);
  for (const value of known) bins[Math.min(count, Math.floor(value / width + 1e-9))]++;
  const digits = width < 0.1 ? 2 : 1;
  const label = place => place === count ? `${top}+` : (place * width).toFixed(digits);
  return bars(title, bins.map((number, place) => [label(place), number]), `${unit}${note}`);
}

function tally(title, words) {
  const counts = new Map();
  for (const word of words) counts.set(word, (counts.get(word) || 0) + 1);
  return bars(title, [...counts].sort((one, two) => two[1] - one[1]));
}

function drawCharts(box, rows) {
  box.append(histogram('Fit of the models', column(rows, 'rmse_m'), 0.05, 0.5, 'RMSE, m'));
  if (rows.some(row => row.rmse95_m !== undefined)) box.append(histogram('Fit without the worst 5 %', column(rows, 'rmse95_m'), 0.05, 0.5, 'RMSE, m'));
  box.append(tally('Level of detail reached', words(rows, 'lod', 'no model')));
  box.append(tally('Roof types', words(rows, 'roof_type', 'none')));
  const failed = rows.filter(row => row.failure_code);
  box.append(tally(`Failures and coarser models: ${failed.length || 'none'}`, words(failed, 'failure_code', '')));
}

// The attributes and distances of one building.
function describe(box, row, number, { points }) {
  const list = element('dl');
  for (const [name, value] of Object.entries(row)) {
    if (value !== null && name !== 'number') list.append(element('dt', {}, name), element('dd', {}, figure(value)));
  }
  const distances = [];
  let mine = 0;
  for (let place = 0; place < points.count; place++) {
    if (points.building[place] !== number + 1) continue;
    mine++;
    if (points.distance[place] !== 32767) distances.push(Math.abs(points.distance[place]) / 1000);
  }
  distances.sort((one, two) => one - two);
  const parts = [element('h2', {}, row.id), list, element('p', {}, `${mine.toLocaleString('en')} of its points are drawn, ${distances.length.toLocaleString('en')} over its roof`
    + (distances.length ? `; median distance ${distances[Math.floor(distances.length / 2)].toFixed(3)} m` : ''))];
  if (distances.length) parts.push(histogram('Distances to the roof', distances, 0.05, 0.5, 'm'));
  box.replaceChildren(...parts);
}
