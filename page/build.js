// Bundles the modules of src into the page's two scripts; the first line of each says which sources it is of.
import { createHash } from 'node:crypto';
import { readdirSync, readFileSync } from 'node:fs';
import { build } from 'esbuild';

const OUT = '../src/eaves/report/page';

process.chdir(import.meta.dirname);
const digest = createHash('sha256');
for (const name of readdirSync('src').filter(file => file.endsWith('.js')).sort()) digest.update(readFileSync(`src/${name}`, 'utf8').replaceAll('\r\n', '\n'));
for (const [entry, name] of [['start', 'page'], ['beside', 'beside']]) {
  await build({
    absWorkingDir: import.meta.dirname, entryPoints: [`src/${entry}.js`], outfile: `${process.argv[2] ?? OUT}/${name}.js`, bundle: true, format: 'iife', target: 'es2022', charset: 'utf8',
    minifyWhitespace: true, minifySyntax: true, lineLimit: 160,
    banner: { js: `// made by \`make page\` of page/src ${digest.copy().digest('hex').slice(0, 16)}` },
  });
}
