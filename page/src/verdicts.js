// What a user says of buildings, and the file of edits that it makes: id and verdict, as `eaves update --edits` takes them.
import { byId, page } from './page.js';

export class Verdicts {
  constructor() {
    this.said = new Map();
    this.row = null;
    byId('verdict').addEventListener('change', event => this.say(event.target.value));
  }

  choose(row) {
    this.row = row;
    byId('judge').hidden = !row || !!page.epochs;
    byId('verdict').value = row ? this.said.get(row.id) || '' : '';
  }

  say(verdict) {
    if (!this.row) return;
    if (verdict) this.said.set(this.row.id, verdict);
    else this.said.delete(this.row.id);
    const link = byId('verdicts'), count = this.said.size;
    if (link.href) URL.revokeObjectURL(link.href);
    link.hidden = !count;
    link.href = URL.createObjectURL(new Blob([this.text()], { type: 'text/csv' }));
    link.textContent = `Save ${count} verdict${count > 1 ? 's' : ''} (verdicts.csv)`;
  }

  text() {
    const quoted = text => `"${String(text).replaceAll('"', '""')}"`;
    return ['id,verdict', ...[...this.said].map(pair => pair.map(quoted).join())].join('\r\n') + '\r\n';
  }
}
