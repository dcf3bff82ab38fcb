// The licences of what is in three-tiles.js, in one file beside it.
import { readFileSync, writeFileSync } from 'node:fs';

const texts = ['three', '3d-tiles-renderer'].map(name => {
  const folder = `node_modules/${name}`, { version, license } = JSON.parse(readFileSync(`${folder}/package.json`));
  return `${name} ${version}, ${license}\n\n${readFileSync(`${folder}/LICENSE`, 'utf8').trim()}\n`;
});
writeFileSync('../../src/eaves/report/tiles/three-tiles.LICENSE.txt', texts.join('\n\n'));
