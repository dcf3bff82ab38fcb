// The operator's table: the queue, the tools, and the calls to the server of this computer.
import { Tools } from './tools.js';
import { byId, viewOf } from './view.js';

/** @typedef {import('./geometry.js').Place} Place */
/** @typedef {{ id: string, worth_m2: number, reason: string, marks: Place[][], reviewed: { date: string, verdict: string } | null }} Entry */

const { plans } = JSON.parse(byId('data').textContent).edit;
const LOOK_MS = 4000;

/** The answer of a call.
 * @param {string} name
 * @param {unknown} words */
async function call(name, words = null) {
  const answer = await fetch(name, { method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify(words) });
  const content = await answer.json();
  if (!answer.ok) throw new Error(content.error);
  return content;
}

/** @type {import('./view.js').View} */
let view;
/** @type {Tools} */
let tools;
/** @type {Entry[]} */
let queue = [];
let place = -1;
let waiting = Promise.resolve(true);

const say = (/** @type {string} */ words, trouble = false) => {
  byId('said').textContent = words;
  byId('said').classList.toggle('trouble', trouble);
};

/** Draws what a call changed. */
async function show(/** @type {any} */ answer) {
  for (const id of answer.gone) delete plans[id];
  for (const { row, plan } of answer.changed) plans[row.id] = plan;
  await view.replace(answer);
  for (const entry of queue) {
    const verdict = answer.reviewed[entry.id];
    entry.reviewed = verdict ? { date: '', verdict } : null;
  }
  byId('undo').disabled = !answer.undo;
  byId('redo').disabled = !answer.redo;
  byId('edits').textContent = answer.edits === 1 ? '1 edit' : `${answer.edits} edits`;
  if (answer.words.length) say(answer.words.join('; '), true);
  tools.draw();
  list();
}

/** Makes a call, one after another, and draws what it changed; false where it was refused. */
function change(/** @type {string} */ name, /** @type {unknown} */ words = null, /** @type {string} */ done = '') {
  const began = performance.now();
  document.documentElement.dataset.busy = 'yes';
  waiting = waiting.then(async () => {
    try {
      say('…');
      const answer = await call(name, words);
      document.documentElement.dataset.answered = ((performance.now() - began) / 1000).toFixed(3);
      await show(answer);
      const seconds = (performance.now() - began) / 1000;
      document.documentElement.dataset.seconds = seconds.toFixed(3);
      if (!answer.words.length) say(`${done || name}: ${seconds.toFixed(1)} s`);
      return true;
    } catch (error) {
      say(/** @type {Error} */ (error).message, true);
      return false;
    } finally {
      document.documentElement.dataset.busy = 'no';
    }
  });
  return waiting;
}

const act = (/** @type {any} */ action) => {
  byId('choices').replaceChildren();
  return change('act', action, action.verdict || action.do);
};

/** Goes to an entry of the queue: the camera flies there, the reason is marked. */
function go(/** @type {number} */ to) {
  if (!queue.length) return say('the queue is empty');
  place = Math.max(0, Math.min(queue.length - 1, to));
  const { id, marks } = queue[place];
  tools.use('');
  byId('choices').replaceChildren();
  tools.marks = marks;
  view.choose(id);
  tools.draw();
  list();
}

/** The next entry from here on that nobody looked at. */
function next(/** @type {number} */ step = 1) {
  let to = place + step;
  while (step > 0 && to < queue.length && queue[to].reviewed) to++;
  if (to >= queue.length) return say('no more of the queue is left');
  go(to);
}

async function right() {
  if (!view.chosen) return say('choose a building first');
  const of = queue[place]?.id === view.chosen;
  if (await act({ do: 'right', id: view.chosen }) && of) next();
}

/** Says where in the queue one is. */
function list() {
  const entry = queue[place], left = queue.filter(one => !one.reviewed).length;
  byId('queue-place').textContent = entry ? `${place + 1} of ${queue.length}, ${left} left` : `${queue.length} to review, ${left} left`;
  byId('queue-reason').textContent = entry ? `${entry.id}: ${entry.reason}${entry.reviewed ? ` (${entry.reviewed.verdict})` : ''}` : '';
}

const state = (/** @type {string} */ verdict) => view.chosen ? act({ do: 'state', id: view.chosen, verdict }) : say('choose a building first');

/** A height that is typed. */
function height(/** @type {string} */ verdict, /** @type {string} */ column) {
  const row = view.row(view.chosen), input = byId('height');
  if (!row) return say('choose a building first');
  input.dataset.verdict = verdict;
  input.value = row[column]?.toFixed(2) ?? '';
  byId('height-label').textContent = verdict;
  byId('heights').hidden = false;
  input.focus();
  input.select();
}

/** Three roofs to choose from. */
async function choices() {
  const id = view.chosen;
  if (!id) return say('choose a building first');
  say('three roofs …');
  try {
    const { choices: pictures } = await call('choices', { id });
    byId('choices').replaceChildren(...Object.entries(pictures).map(([verdict, picture]) => {
      const button = document.createElement('button'), words = document.createElement('span');
      button.type = 'button';
      button.innerHTML = String(picture); // drawn by our own server, of numbers alone
      words.textContent = verdict;
      button.append(words);
      button.addEventListener('click', () => {
        byId('choices').replaceChildren();
        act({ do: 'state', id, verdict });
      });
      return button;
    }));
    byId('choices').querySelector('button')?.focus();
    say('choose a roof');
  } catch (error) { say(/** @type {Error} */ (error).message, true); }
}

async function save() {
  say('the files are written …');
  document.documentElement.dataset.busy = 'yes';
  try {
    const { saved } = await call('save');
    say(saved);
    document.documentElement.dataset.saved = 'yes';
    location.reload();
  } catch (error) { say(/** @type {Error} */ (error).message, true); }
  document.documentElement.dataset.busy = 'no';
}

const remove = () => view.chosen ? act({ do: 'delete', id: view.chosen }) : say('choose a building first');

/** Every button with its key; what it does. */
const KEYS = /** @type {Record<string, [string, () => unknown]>} */ ({
  y: ['right', right], j: ['next', () => next(1)], k: ['back', () => go(place - 1)], x: ['skip', () => go(place + 1)],
  c: ['corners', () => tools.use('corners')], d: ['rectangle', () => tools.use('rectangle')], g: ['polygon', () => tools.use('polygon')],
  v: ['split', () => tools.use('split')], b: ['join', () => tools.use('join')], e: ['carry on', () => tools.use('carry')], Delete: ['delete', remove],
  i: ['ridge', () => tools.use('ridge')], f: ['one face', () => tools.use('unite')], q: ['dormer', () => tools.use('dormer')],
  1: ['coarser', () => state('coarser roof')], 2: ['of points', () => state('roof of points')], 3: ['finer', () => state('finer roof')], w: ['three roofs', choices],
  4: ['flat', () => state('flat roof')], 5: ['gable', () => state('gable roof')], 6: ['hip', () => state('hip roof')],
  7: ['base height', () => height('base height', 'h_ground')], 8: ['eaves height', () => height('eaves height', 'h_eaves')],
  u: ['undo', () => change('undo')], r: ['redo', () => change('redo')], F2: ['save', save],
});

function listen() {
  for (const [key, [, doIt]] of Object.entries(KEYS)) document.querySelector(`[data-key="${key}"]`)?.addEventListener('click', doIt);
  document.addEventListener('keydown', event => {
    const target = /** @type {HTMLElement} */ (event.target);
    if (target.matches('input, select, textarea') || event.altKey) return;
    const undoing = event.ctrlKey || event.metaKey;
    let known = tools.key(event);
    if (!known && undoing && 'zZyY'.includes(event.key)) {
      change(event.key === 'z' ? 'undo' : 'redo');
      known = true;
    } else if (!known && !undoing && KEYS[event.key] && !(event.key === 'Enter')) {
      KEYS[event.key][1]();
      known = true;
    }
    if (!known) return;
    event.preventDefault();
    event.stopPropagation();
  }, true);
  byId('height').addEventListener('keydown', (/** @type {KeyboardEvent} */ event) => {
    if (event.key === 'Escape') byId('heights').hidden = true;
    if (event.key !== 'Enter') return;
    byId('heights').hidden = true;
    act({ do: 'state', id: view.chosen, verdict: byId('height').dataset.verdict, value: Number(byId('height').value) });
    view.canvas.focus();
  });
}

async function start() {
  view = await viewOf();
  tools = new Tools(view, plans, act, say);
  const opened = await call('state');
  queue = opened.queue;
  const reviewed = Object.fromEntries(queue.map(entry => [entry.id, entry.reviewed]));
  await show(opened);
  for (const entry of queue) entry.reviewed = reviewed[entry.id] || entry.reviewed;
  listen();
  list();
  say('ready');
  document.documentElement.dataset.table = 'yes';
  document.documentElement.dataset.busy = 'no';
  setInterval(() => {
    if (document.hidden || document.documentElement.dataset.busy === 'yes') return;
    call('look').then(answer => (answer.changed.length || answer.gone.length) && show(answer).then(() => say('another program changed edits: they are shown')), () => say('the server has ended; all is kept', true));
  }, LOOK_MS);
}

start().catch(error => say(error.message, true));
