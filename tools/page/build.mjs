// Makes crates/files/src/page/page.html.gz of the library: `node build.mjs`. With --check it only compares the text.
import { createHash } from 'node:crypto';
import { readFileSync, writeFileSync } from 'node:fs';
import { gunzipSync, gzipSync } from 'node:zlib';
import { build } from 'esbuild';

const here = (name) => new URL(name, import.meta.url);
const asset = here('../../crates/files/src/page/page.html.gz');
const { outputFiles: [bundle] } = await build({
  entryPoints: [here('src/main.ts').pathname], bundle: true, minify: true, format: 'iife', target: 'es2022', legalComments: 'none', write: false, charset: 'utf8',
});
const licence = readFileSync(here('node_modules/three/LICENSE'), 'utf8').trim();
const script = `/*! Contains three.js:\n${licence} */\n${bundle.text.trim()}`.replaceAll('</script', '<\\/script');
const hash = `sha256-${createHash('sha256').update(script).digest('base64')}`;
const style = readFileSync(here('src/style.css'), 'utf8').trim();
const fill = (page, name, text) => page.split(`%%${name}%%`).join(text);
let page = readFileSync(here('page.html'), 'utf8');
page = fill(page, 'HASH', hash);
page = fill(page, 'STYLE', style);
page = fill(page, 'SCRIPT', script);
if (process.argv.includes('--check')) {
  if (gunzipSync(readFileSync(asset)).toString() !== page) {
    console.error('crates/files/src/page/page.html.gz is not what tools/page makes: run `node build.mjs` in tools/page and commit it');
    process.exit(1);
  }
} else {
  const packed = gzipSync(page, { level: 9 });
  writeFileSync(asset, packed);
  console.log(`page.html: ${page.length} characters, ${packed.length} bytes packed`);
}
