// Bundles the modules of src into the page's two scripts and that of the operator's table; the first line of each says which sources it is of.
import { createHash } from 'node:crypto';
import { readdirSync, readFileSync } from 'node:fs';
import { build } from 'esbuild';

const SCRIPTS = [['start', 'report/page/page'], ['beside', 'report/page/beside'], ['edit/main', 'edit/page/edit']];

process.chdir(import.meta.dirname);
const digest = createHash('sha256');
for (const name of readdirSync('src', { recursive: true, encoding: 'utf8' }).map(file => file.replaceAll('\\', '/')).filter(file => file.endsWith('.js')).sort()) digest.update(readFileSync(`src/${name}`, 'utf8').replaceAll('\r\n', '\n'));
for (const [entry, name] of SCRIPTS) {
  await build({
    absWorkingDir: import.meta.dirname, entryPoints: [`src/${entry}.js`], outfile: `${process.argv[2] ?? '../src/eaves'}/${name}.js`, bundle: true, format: 'iife', target: 'es2022', charset: 'utf8',
    minifyWhitespace: true, minifySyntax: true, lineLimit: 160,
    banner: { js: `// made by \`make page\` of page/src ${digest.copy().digest('hex').slice(0, 16)}` },
  });
}
