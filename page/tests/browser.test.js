// What a person meets: the page of a run (EAVES_PAGES, paths with ':' between) in Debian's chromium, in light and dark, by mouse, keys and touch, and on paper.
import assert from 'node:assert/strict';
import { existsSync, readFileSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { after, before, test } from 'node:test';
import { pathToFileURL } from 'node:url';

const pages = (process.env.EAVES_PAGES ?? '').split(':').filter(Boolean), program = process.env.CHROMIUM ?? '/usr/bin/chromium', shots = process.env.EAVES_ARTEFACTS;
const skip = !pages.length ? 'EAVES_PAGES names no page' : !existsSync(program) ? 'no chromium' : false;
const FLAGS = ['--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'];
/** @type {import('playwright-core').Browser} */
let browser;

before(async () => {
  if (skip) return;
  const { chromium } = await import('playwright-core');
  browser = await chromium.launch({ executablePath: program, args: FLAGS });
});
after(() => browser?.close());

/** @param {string} path @param {string} state @param {import('playwright-core').BrowserContextOptions} options */
async function opened(path, state, options) {
  const context = await browser.newContext(options), page = await context.newPage(), errors = /** @type {string[]} */ ([]);
  page.on('pageerror', error => errors.push(error.message));
  await page.goto(`${pathToFileURL(path)}#${state}`);
  await page.waitForFunction(() => document.documentElement.dataset.ready === 'yes' && document.documentElement.dataset.still === 'yes' && window.eaves.table);
  return { page, errors };
}

const SMALLEST = () => {
  const sizes = [], walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const { parentElement: holder, textContent } = node;
    if (holder && textContent?.trim() && !['SCRIPT', 'STYLE', 'NOSCRIPT'].includes(holder.tagName) && holder.getClientRects().length) sizes.push(parseFloat(getComputedStyle(holder).fontSize));
  }
  return Math.min(...sizes);
};

for (const path of pages) {
  for (const width of [1400, 768, 390]) {
    for (const theme of ['light', 'dark']) {
      test(`${path} at ${width} px, ${theme}: no violation of WCAG AA, no text under 12 px, the first columns in sight`, { skip }, async () => {
        const { page, errors } = await opened(path, `theme=${theme}&models=trust`, { viewport: { width, height: 900 }, hasTouch: width < 1000 });
        await page.locator('#buildings tbody tr').first().click();
        await page.waitForFunction(() => document.documentElement.dataset.still === 'yes');
        if (shots) await page.screenshot({ path: `${shots}/${path.split('/').at(-2)}-${width}-${theme}.png` });
        if (shots) await page.screenshot({ path: `${shots}/${path.split('/').at(-2)}-${width}-${theme}-whole.png`, fullPage: true });
        await page.evaluate(() => {
          document.getElementById('profiling')?.click();
          document.querySelector('#columns')?.setAttribute('open', '');
        });
        await page.evaluate(readFileSync(createRequire(import.meta.url).resolve('axe-core/axe.min.js'), 'utf8'));
        const found = await page.evaluate(() => /** @type {any} */ (window).axe.run(document, { runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa'] }));
        assert.deepEqual(found.violations.map((/** @type {any} */ rule) => [rule.id, rule.nodes.slice(0, 6).map((/** @type {any} */ node) => [node.target.join(), node.any[0]?.message ?? node.all[0]?.message])]), []);
        assert.ok(await page.evaluate(SMALLEST) >= 12, `smallest text: ${await page.evaluate(SMALLEST)} px`);
        const edges = await page.evaluate(() => [...document.querySelectorAll('#buildings th')].slice(0, 5).map(head => [head.textContent, head.getBoundingClientRect().right]));
        assert.deepEqual(edges.filter(([, right]) => Number(right) > width).map(([name]) => name), []);
        assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), 'nothing beside the screen');
        const id = await page.evaluate(() => {
          const box = document.querySelector('.scroll'), cell = document.querySelector('#buildings tbody td.id');
          if (box) box.scrollLeft = 1e4;
          return [box?.getBoundingClientRect().left, cell?.getBoundingClientRect().left];
        });
        assert.ok(Math.abs(Number(id[0]) - Number(id[1])) < 3, 'the id stays');
        assert.deepEqual(errors, []);
      });
    }
  }

  test(`${path}: keys alone choose, measure and cut a profile`, { skip }, async () => {
    const { page } = await opened(path, '', { viewport: { width: 1400, height: 900 } });
    await page.locator('#scene').focus();
    for (const key of ['Enter', 'Escape', 'n', 'a', 'm', 'Enter', 'Shift+ArrowLeft', 'Enter', 'l']) await page.keyboard.press(key);
    assert.equal(await page.evaluate(() => window.eaves.ruler.places.length), 2);
    await page.locator('#profile').focus();
    await page.keyboard.press('ArrowRight');
    assert.match(await page.locator('#profile text.cursor').textContent() ?? '', /m along/);
    const unsaid = await page.evaluate(() => [...document.querySelectorAll('#views button')].filter(button => !button.querySelector('kbd')).map(button => button.textContent));
    assert.deepEqual(unsaid, []);
  });

  test(`${path}: touch at 768 px chooses, turns and measures`, { skip }, async () => {
    const { page } = await opened(path, 'view=above', { viewport: { width: 768, height: 1024 }, hasTouch: true });
    const [x, y] = await page.evaluate(() => {
      const { tools, spots, canvas } = window.eaves, box = canvas.getBoundingClientRect(), inside = spots.map(({ low, high }) => tools.seen([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, high[2]])).find(({ x, y }) => x > 100 && x < box.width - 100 && y > 150 && y < box.height - 150);
      return [box.left + (inside?.x ?? 0), box.top + (inside?.y ?? 0)];
    });
    await page.touchscreen.tap(x, y);
    await page.waitForFunction(() => document.documentElement.dataset.chosen);
    await page.locator('#measure').tap();
    await page.touchscreen.tap(x, y);
    await page.touchscreen.tap(x + 60, y + 20);
    assert.equal(await page.evaluate(() => window.eaves.ruler.places.length), 2);
    assert.ok(await page.evaluate(() => [...document.querySelectorAll('#views button')].every(button => button.getBoundingClientRect().height >= 24)));
  });

  test(`${path}: Print gives one page of A4 at 1:500, no text under 7 pt`, { skip }, async () => {
    const { page } = await opened(path, 'building=worst', { viewport: { width: 1400, height: 900 } });
    const pdf = await page.pdf({ preferCSSPageSize: true });
    if (shots) writeFileSync(`${shots}/${path.split('/').at(-2)}.pdf`, pdf);
    assert.equal((pdf.toString('latin1').match(/\/Type\s*\/Page\b/g) ?? []).length, 1);
    await page.emulateMedia({ media: 'print' });
    await page.evaluate(() => dispatchEvent(new Event('beforeprint')));
    assert.ok(await page.evaluate(SMALLEST) >= 7 * 96 / 72 - 0.01, `${await page.evaluate(SMALLEST)} px`);
    const [wide, shown] = await page.evaluate(() => [document.querySelector('.plan')?.getBoundingClientRect().width, document.querySelectorAll('.plan .id').length]);
    assert.ok(Math.abs(Number(wide) - 186 * 96 / 25.4) < 1);
    assert.ok(Number(shown) > 0);
  });

  test(`${path}: a column that is hidden stays hidden`, { skip }, async () => {
    const { page } = await opened(path, '', { viewport: { width: 1400, height: 900 } }), shown = page.locator('#buildings th', { hasText: 'RMSE' });
    await page.locator('#columns summary').click();
    await page.locator('#columns label', { hasText: 'RMSE' }).locator('input').uncheck();
    assert.equal(await shown.isVisible(), false);
    await page.reload();
    await page.waitForFunction(() => window.eaves?.table);
    assert.equal(await shown.isVisible(), false);
  });
}
