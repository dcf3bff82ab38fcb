// The page itself: its data, its elements and how figures stand in it.

/** @import { Page } from './types.js' */
export const byId = (/** @type {string} */ name) => /** @type {HTMLElement} */ (document.getElementById(name));
export const field = (/** @type {string} */ name) => /** @type {HTMLInputElement} */ (byId(name));
const source = globalThis.document?.getElementById('data');
/** @type {Page} */
export const page = source ? JSON.parse(source.textContent ?? '') : {};
/** @template {keyof HTMLElementTagNameMap} T @param {T} tag @param {Record<string, string | number>} [attributes] @param {(string | Node)[]} children @returns {HTMLElementTagNameMap[T]} */
export const element = (tag, attributes = {}, ...children) => {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, String(value));
  made.append(...children);
  return made;
};
// A figure with as many digits as mean something: areas and volumes have four, lengths are to the centimetre.
/** @param {any} value @param {string} [name] of its column */
export function figure(value, name = '') {
  if (value === null || value === undefined) return '';
  if (typeof value !== 'number' || Number.isInteger(value)) return String(value);
  if (/_m[23]$/.test(name)) return Number(value.toPrecision(4)).toLocaleString('en', { maximumFractionDigits: Math.abs(value) < 100 ? 1 : 0 });
  return value.toFixed(2).replace(/^-0\.00$/, '0.00');
}

// The label around a control, which is hidden with it.
export const frameOf = (/** @type {string} */ name) => /** @type {HTMLElement} */ (byId(name).parentElement);
export const messageOf = (/** @type {unknown} */ error) => error instanceof Error ? error.message : String(error);
