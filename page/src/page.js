// The page itself: its data, its elements and how figures stand in it.
export const byId = name => document.getElementById(name);
export const source = globalThis.document?.getElementById('data');
export const page = source ? JSON.parse(source.textContent) : {};
export const element = (tag, attributes = {}, ...children) => {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
};
export const figure = value => value === null || value === undefined ? '' : typeof value === 'number' && !Number.isInteger(value) ? value.toFixed(2).replace(/^-0\.00$/, '0.00') : String(value);

