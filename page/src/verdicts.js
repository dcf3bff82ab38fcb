// What a user says of buildings, and the file of edits that it makes: id and verdict, as `eaves update --edits` takes them.
import { byId, field, page } from './page.js';

/** @import { Row } from './types.js' */

export class Verdicts {
  constructor() {
    /** @type {Map<string, string>} */
    this.said = new Map();
    /** @type {Row | undefined} */
    this.row = undefined;
    byId('verdict').addEventListener('change', () => this.say(field('verdict').value));
  }

  /** @param {Row | undefined} row */
  choose(row) {
    this.row = row;
    byId('judge').hidden = !row || !!page.epochs;
    field('verdict').value = row ? this.said.get(row.id) || '' : '';
  }

  /** @param {string} verdict */
  say(verdict) {
    if (!this.row) return;
    if (verdict) this.said.set(this.row.id, verdict);
    else this.said.delete(this.row.id);
    const link = /** @type {HTMLAnchorElement} */ (byId('verdicts')), count = this.said.size;
    if (link.href) URL.revokeObjectURL(link.href);
    link.hidden = !count;
    link.href = URL.createObjectURL(new Blob([this.text()], { type: 'text/csv' }));
    link.textContent = `Save ${count} verdict${count > 1 ? 's' : ''} (verdicts.csv)`;
  }

  text() {
    const quoted = (/** @type {string} */ text) => `"${String(text).replaceAll('"', '""')}"`;
    return ['id,verdict', ...[...this.said].map(pair => pair.map(quoted).join())].join('\r\n') + '\r\n';
  }
}
