// What a reader sees and does, in Debian's Chromium: `node test.mjs PROGRAM FOLDER`.
import assert from 'node:assert/strict';
import { execFileSync, spawn } from 'node:child_process';
import { existsSync, mkdirSync, readFileSync, statSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { pathToFileURL } from 'node:url';
import { chromium } from 'playwright-core';

const [program, folder] = process.argv.slice(2);
const meshes = new URL('../../meshes/', import.meta.url).pathname;
const executablePath = [process.env.CHROMIUM, '/usr/bin/chromium', '/usr/bin/chromium-browser', '/usr/bin/google-chrome'].find((p) => p && existsSync(p));
mkdirSync(folder, { recursive: true });
const run = (...args) => execFileSync(program, [...args, '--quiet'], { encoding: 'utf8', maxBuffer: 1 << 28 });
const browser = await chromium.launch({ executablePath, args: ['--no-sandbox', '--disable-gpu'] });
let failed = 0;

async function test(name, body) {
  const start = performance.now();
  try {
    await body();
    console.log(`ok   ${name} (${Math.round(performance.now() - start)} ms)`);
  } catch (error) {
    failed++;
    console.log(`FAIL ${name}, with playwright ${JSON.parse(readFileSync(new URL('node_modules/playwright-core/package.json', import.meta.url))).version} and chromium ${browser.version()}\n${error.stack}`);
  }
}

/** Opens a page and fails on whatever it complains about or asks the network for. */
async function open(path, options = {}, hash = '') {
  const page = await browser.newPage({ viewport: { width: 1280, height: 800 }, reducedMotion: 'reduce', ...options });
  const complaints = [];
  page.on('pageerror', (e) => complaints.push(`page error: ${e}`));
  page.on('console', (m) => { if (m.type() === 'error') complaints.push(`console: ${m.text()}`); });
  page.on('request', (r) => { if (!/^(file|data|blob):/.test(r.url())) complaints.push(`request: ${r.url()}`); });
  page.on('dialog', (d) => { complaints.push(`dialog: ${d.message()}`); void d.dismiss(); });
  await page.goto(pathToFileURL(path) + hash);
  await page.waitForSelector('html[data-ready]', { timeout: 60000 });
  page.complaints = complaints;
  return page;
}

async function close(page) {
  assert.deepEqual(page.complaints, []);
  await page.close();
}

const settle = (page) => page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done()))));

/** Moves the mouse over taxels and says how many were named. */
async function hits(page, isMap, count) {
  const targets = await page.evaluate(([isMap, count]) => {
    const d = window.dermatome, box = document.getElementById('stage').getBoundingClientRect(), found = [];
    for (let n = 0; n < 40 * count && found.length < count; n++) {
      const patch = n % d.patches.length, p = d.patches[patch], taxel = (n * 7919 + 13) % p.taxels;
      const [x, y] = d.view.toPixels(isMap, patch, [[taxel, 1]]);
      const r = isMap ? d.view.map : d.view.skin;
      if (x < r.x + 4 || y < r.y + 4 || x > r.x + r.width - 4 || y > r.y + r.height - 4) continue;
      // In space only what nothing hides.
      if (!isMap) {
        const on = d.view.sheetAt(x - r.x, y - r.y);
        if (!on || Math.hypot(on[0] - p.sheet[2 * taxel], on[1] - p.sheet[2 * taxel + 1]) > 0.3 * p.spacing) continue;
      }
      found.push({ patch, taxel, x: x + box.left, y: y + box.top });
    }
    return found;
  }, [isMap, count]);
  let right = 0;
  for (const { patch, taxel, x, y } of targets) {
    await page.mouse.move(x, y);
    await settle(page);
    if (await page.evaluate(() => document.documentElement.dataset.taxel) === `${patch}:${taxel}`) right++;
  }
  return [right, targets.length];
}

/** How many pixels of the canvas around a point of the stage are in the colour of what is lit. */
async function accentAt(page, x, y) {
  return page.evaluate(([x, y]) => {
    const d = window.dermatome, source = d.view.canvas, ratio = source.width / source.clientWidth;
    d.view.draw();
    const copy = document.createElement('canvas');
    copy.width = copy.height = 24;
    const c = copy.getContext('2d');
    c.drawImage(source, x * ratio - 12, y * ratio - 12, 24, 24, 0, 0, 24, 24);
    const { data } = c.getImageData(0, 0, 24, 24);
    let count = 0;
    for (let k = 0; k < data.length; k += 4) if (data[k] > 120 && data[k + 1] < 110 && data[k] - data[k + 1] > 60) count++;
    return count;
  }, [x, y]);
}

const maps = {};
for (const name of ['forearm', 'hand', 'robot', 'glove']) {
  run('build', join(meshes, `${name}.glb`), '-o', join(folder, name));
  maps[name] = join(folder, name, 'report.html');
}
run('touch', join(folder, 'robot', 'map.glb'), '-o', join(folder, 'robot.npz'));
run('report', join(folder, 'robot', 'map.glb'), join(folder, 'robot.npz'), '-o', join(folder, 'recording.html'));

for (const [name, path] of Object.entries(maps)) {
  await test(`${name}: a taxel under the pointer lights in both views, at every stage of unfolding`, async () => {
    const page = await open(path);
    for (const unfold of [0, 0.5, 1]) {
      await page.evaluate((x) => window.dermatome.setUnfold(x), unfold);
      await settle(page);
      for (const isMap of [false, true]) {
        const [right, of] = await hits(page, isMap, 6);
        assert.ok(of >= 3 && right >= of - 1, `${right} of ${of} at ${unfold}, ${isMap ? 'map' : 'space'}`);
      }
      const at = await page.evaluate(() => {
        const d = window.dermatome, [patch, taxel] = document.documentElement.dataset.taxel.split(':').map(Number);
        return d.view.toPixels(true, patch, [[taxel, 1]]);
      });
      assert.ok(await accentAt(page, ...at) > 0, `lit on the map at ${unfold}`);
    }
    await close(page);
  });
}

await test('the skin at 1 is the map', async () => {
  const page = await open(maps.robot);
  const far = await page.evaluate(() => {
    const d = window.dermatome;
    d.setUnfold(1);
    let worst = 0;
    const scale = d.view.metresPerPixel(false), mapScale = d.view.metresPerPixel(true);
    const centre = (isMap) => { const r = isMap ? d.view.map : d.view.skin; return [r.x + r.width / 2, r.y + r.height / 2]; };
    d.patches.forEach((p, k) => { for (let t = 0; t < p.taxels; t += 7) {
      const [a, b] = [false, true].map((isMap) => d.view.toPixels(isMap, k, [[t, 1]]).map((x, i) => (x - centre(isMap)[i]) * (isMap ? mapScale : scale)));
      worst = Math.max(worst, Math.hypot(a[0] - b[0], a[1] - b[1]));
    } });
    return worst;
  });
  assert.ok(far < 1e-5, `${far} m apart`);
  await close(page);
});

await test('a field of level 2 lights the taxels of the matrix in the map, with its weights', async () => {
  const page = await open(maps.forearm);
  const { json, binary } = glb(readFileSync(join(folder, 'forearm', 'map.glb')));
  const { direct } = json.meshes.find((m) => m.name.endsWith('/L2')).extras.dermatome;
  const indices = accessor(json, binary, direct.indices), weights = accessor(json, binary, direct.weights);
  for (const taxel of [5, 321, 777]) {
    const shown = await page.evaluate((taxel) => {
      const d = window.dermatome;
      d.setLevel(2);
      d.pin({ patch: 0, taxel });
      return d.lit();
    }, taxel);
    const expected = [];
    for (let t = 0; t < indices.length / 3; t++) for (let k = 0; k < 3; k++) if (weights[3 * t + k] > 0 && indices[3 * t + k] === shown.field) expected.push([t, weights[3 * t + k]]);
    assert.deepEqual(shown.members.map(([t]) => t), expected.map(([t]) => t));
    shown.members.forEach(([, w], k) => assert.ok(Math.abs(w - expected[k][1]) < 1 / 100, `${w} is ${expected[k][1]}`));
  }
  await close(page);
});

await test('levels of the whole body lie above those of the patches and light the taxels of all', async () => {
  const page = await open(maps.robot);
  const [says, lit, taxels] = await page.evaluate(() => {
    const d = window.dermatome;
    d.setLevel(+document.getElementById('level').max);
    d.pin({ patch: 0, taxel: 5 });
    d.draw();
    return [document.getElementById('level-text').textContent, document.documentElement.dataset.lit, d.patches.reduce((sum, p) => sum + p.taxels, 0)];
  });
  assert.match(says, /^body\.L\d+: 1 field$/);
  assert.equal(+lit, taxels);
  await close(page);
});

await test('all places of a taxel on a seam are named', async () => {
  const page = await open(maps.robot);
  const says = await page.evaluate(() => {
    const d = window.dermatome, patch = d.patches.findIndex((p) => p.places > p.taxels);
    d.pin({ patch, taxel: d.patches[patch].taxelOf[d.patches[patch].places - 1] });
    d.draw();
    return document.getElementById('taxel').textContent;
  });
  assert.match(says, /2 places/);
  await close(page);
});

await test('sliders and keys change what they say', async () => {
  const page = await open(maps.hand);
  const level = () => page.textContent('#level-text');
  await page.focus('#level');
  const before = await level();
  await page.keyboard.press('ArrowRight');
  assert.notEqual(await level(), before);
  assert.match(await level(), /^level 3: \d+ fields$/);
  await page.keyboard.press('+');
  assert.match(await level(), /^level 2: /);
  await page.focus('#unfold');
  for (let k = 0; k < 5; k++) await page.keyboard.press('ArrowRight');
  assert.equal(await page.inputValue('#unfold'), '5');
  await page.focus('#map');
  await page.keyboard.press('u');
  assert.equal(await page.textContent('#unfold-text'), 'the map');
  for (const name of ['angle', 'area', 'receptive', 'presence', 'patch', 'field']) {
    await page.selectOption('#colour', name);
    assert.notEqual((await page.textContent('#legend-text')).trim(), '', name);
  }
  await close(page);
});

await test('arrows walk to a neighbour, and the address keeps the state', async () => {
  const page = await open(maps.forearm);
  await page.evaluate(() => window.dermatome.pin({ patch: 0, taxel: 500 }));
  await page.focus('#map');
  await page.keyboard.press('ArrowLeft');
  const taxel = await page.evaluate(() => { window.dermatome.draw(); return document.documentElement.dataset.taxel; });
  assert.notEqual(taxel, '0:500');
  await page.evaluate(() => window.dermatome.setUnfold(0.25));
  await page.waitForFunction((taxel) => {
    const state = new URLSearchParams(location.hash.slice(1));
    return state.get('taxel') === taxel && state.get('unfold') === '0.25';
  }, taxel);
  const hash = new URL(page.url()).hash;
  await close(page);
  const again = await open(maps.forearm, {}, hash);
  assert.equal(await again.evaluate(() => document.documentElement.dataset.taxel), taxel);
  assert.equal(await again.inputValue('#unfold'), '250');
  await close(again);
});

await test('what is chosen in the page is what its options take', async () => {
  const page = await open(maps.forearm);
  assert.ok(await page.isHidden('#options'));
  const box = await page.locator('#map').boundingBox();
  await page.keyboard.down('Control');
  await page.mouse.move(box.x + 0.35 * box.width, box.y + 0.35 * box.height);
  await page.mouse.down();
  await page.mouse.move(box.x + 0.6 * box.width, box.y + 0.6 * box.height, { steps: 4 });
  await page.mouse.up();
  await page.keyboard.up('Control');
  const options = (await page.textContent('#options-text')).split(' ');
  assert.equal(options[0], '--box');
  const inside = await page.evaluate(() => { const d = window.dermatome, p = d.patches[0]; let n = 0; for (let t = 0; t < p.taxels; t++) n += d.isInBox(p, t); return n; });
  assert.ok(inside > 20, `${inside} taxels`);
  run('build', join(meshes, 'forearm.glb'), '-o', join(folder, 'chosen'), ...options);
  const { json } = glb(readFileSync(join(folder, 'chosen', 'map.glb')));
  const made = json.accessors[json.meshes[0].primitives[0].attributes._TAXEL_ID].count;
  // The faces whose centre lies in the box have corners up to an edge outside of it.
  assert.ok(made > 0.9 * inside && made < 2 * inside, `${made} of ${inside} taxels`);
  await page.keyboard.press('Escape');
  assert.ok(await page.isHidden('#options'));
  await close(page);
  const robot = await open(maps.robot);
  const names = await robot.evaluate(() => window.dermatome.patches.map((p) => p.header.name));
  await robot.locator('#tree input').first().uncheck();
  assert.equal((await robot.textContent('#options-text')).match(/--patch/g).length, names.length - 1);
  await close(robot);
});

await test('a region that is drawn names the taxels that the page counts', async () => {
  const page = await open(maps.forearm);
  const box = await page.locator('#map').boundingBox();
  const click = async (x, y) => page.mouse.click(box.x + x * box.width, box.y + y * box.height);
  await page.click('#draw-region');
  for (const [x, y] of [[0.3, 0.35], [0.6, 0.6], [0.6, 0.35], [0.3, 0.6]]) await click(x, y);
  await page.keyboard.press('Enter');
  assert.match(await page.textContent('#regions-text'), /crosses itself/);
  for (let k = 0; k < 3; k++) await page.keyboard.press('Backspace');
  for (const [x, y] of [[0.6, 0.35], [0.6, 0.6], [0.3, 0.6], [0.3, 0.35]]) await click(x, y);
  assert.equal(await page.locator('#regions li').count(), 1);
  // Every letter is one of the name, also those that are keys of the page.
  await page.focus('#regions input');
  await page.locator('#regions input').selectText();
  await page.keyboard.type('upper + f=?r-e E');
  assert.equal(await page.inputValue('#regions input'), 'upper + f=?r-e E');
  assert.equal(await page.evaluate(() => window.dermatome.view.unfold), 0);
  await page.fill('#regions input', 'wrist');
  await page.focus('#map');
  const count = +(await page.textContent('#regions small')).match(/(\d+) taxel/)[1];
  const [saved] = await Promise.all([page.waitForEvent('download'), page.click('#save-regions')]);
  const path = join(folder, 'regions.json');
  await saved.saveAs(path);
  run('build', join(meshes, 'forearm.glb'), '-o', join(folder, 'named'), '--regions', path);
  const named = await open(join(folder, 'named', 'report.html'));
  const inside = await named.evaluate(() => { const d = window.dermatome; return [d.data.header.regions.join(), [...d.patches[0].region].filter((r) => r === 1).length]; });
  assert.deepEqual(inside, ['wrist', count]);
  assert.ok(count > 20, `${count} taxels`);
  await close(named);
  await page.click('#regions button');
  assert.ok(await page.isHidden('#save-regions'));
  await close(page);
});

/** The pixel of the window that shows a taxel in a view of the skin or of the atlas. */
const pixelOf = (page, isOwn, isMap, patch, taxel) => page.evaluate(([isOwn, isMap, patch, taxel]) => {
  const l = window.dermatome.landmarks, stage = isOwn ? l.own : l.stage, box = stage.box.getBoundingClientRect();
  const [x, y] = stage.view.toPixels(isMap, patch, [[taxel, 1]]);
  return [x + box.left, y + box.top];
}, [isOwn, isMap, patch, taxel]);

run('build', join(meshes, 'robot_hand.glb'), '-o', join(folder, 'robot_hand'));
run('report', join(folder, 'robot_hand', 'map.glb'), '--atlas', join(folder, 'hand', 'map.glb'), '-o', join(folder, 'landmarks.html'));
const hands = readFileSync(join(meshes, 'hands.csv'), 'utf8').trim().split('\n').slice(1).map((line) => line.split(',').map(Number));

await test('landmarks that are clicked on two skins are those that build takes', async () => {
  const page = await open(join(folder, 'landmarks.html'));
  const where = await page.evaluate((hands) => {
    const l = window.dermatome.landmarks, find = (patches, id) => { for (const [patch, p] of patches.entries()) { const taxel = p.ids.indexOf(id); if (taxel >= 0) return { patch, taxel }; } };
    return hands.map(([own, other]) => [find(l.own.patches, own), find(l.stage.patches, other)]);
  }, hands);
  const count = () => page.evaluate(() => +document.documentElement.dataset.landmarks);
  assert.match(await page.textContent('#landmarks-needs'), /Still too few: palm: 0 of 4; thumb: 0 of 4/);
  assert.ok(await page.isDisabled('#save-landmarks') && await page.isDisabled('#accept'));
  // Four a patch; those of the palm in space, the others on the maps.
  let made = 0;
  for (const [k, [own, other]] of where.entries()) {
    if (k % 5 === 4) continue;
    for (const [isOwn, at] of [[true, own], [false, other]]) { await page.mouse.click(...await pixelOf(page, isOwn, k >= 5, at.patch, at.taxel)); await settle(page); }
    assert.equal(await count(), ++made);
    if (k < 4) assert.match(await page.textContent('#landmarks-needs'), new RegExp(k < 3 ? `palm: ${k + 1} of 4` : '^(?!.*palm:)'));
  }
  // Taxels of the atlas are as small as a pixel.
  const far = await page.evaluate((wanted) => {
    const l = window.dermatome.landmarks, at = (patches, { patch, taxel }) => patches[patch].frame(taxel)[0].applyMatrix4(patches[patch].pose);
    return l.pairs.map((pair, k) => [at(l.own.patches, pair.own).distanceTo(at(l.own.patches, wanted[k][0])), at(l.stage.patches, pair.other).distanceTo(at(l.stage.patches, wanted[k][1]))]);
  }, where.filter((_, k) => k % 5 !== 4));
  assert.ok(far.every(([own, other]) => own < 1e-6 && other < 0.0025), `${far}`);
  assert.match(await page.textContent('#landmarks-needs'), /enough/);
  // The page proposes the farthest place, and expects its partner near where it is: tips of fingers.
  for (let k = 0; k < 3; k++) {
    const [own, far] = await page.evaluate(() => {
      const l = window.dermatome.landmarks, q = l.question, d = l.own.patches[q.own.patch].distances(l.pairs.filter((p) => p.own.patch === q.own.patch).map((p) => p.own.taxel));
      return [q.guess !== null, d[q.own.taxel]];
    });
    assert.ok(own && far > 0.02, `${far} m from other landmarks`);
    await page.keyboard.press('Enter');
    assert.equal(await count(), made + k + 1);
  }
  await page.screenshot({ path: join(folder, 'landmarks.png') });
  const expected = await page.evaluate(() => { const l = window.dermatome.landmarks; return l.fit.misses().slice(-3); });
  assert.ok(expected.every((miss) => miss < 0.02), expected.join());
  // A taxel of the atlas is one landmark, and a pair goes when it is removed.
  const taken = await page.evaluate(() => window.dermatome.landmarks.pairs[6].other);
  await page.mouse.click(...await pixelOf(page, false, true, taken.patch, taken.taxel));
  assert.match(await page.textContent('#landmarks-wrong'), /is landmark \d+ already/);
  await page.locator('#landmarks-list button').last().click();
  assert.equal(await count(), made + 2);
  await page.locator('#landmarks-list input').first().fill('heel, "left"');
  await page.focus('#map');
  const [saved] = await Promise.all([page.waitForEvent('download'), page.click('#save-landmarks')]);
  assert.equal(saved.suggestedFilename(), 'landmarks.csv');
  const path = join(folder, 'landmarks.csv');
  await saved.saveAs(path);
  assert.match(readFileSync(path, 'utf8'), /^taxel_id,atlas_taxel_id,name\n\d+,\d+,"heel, ""left"""\n/);
  run('build', join(meshes, 'robot_hand.glb'), '-o', join(folder, 'drawn'), '--atlas', join(folder, 'hand', 'map.glb'), '--landmarks', path);
  const report = JSON.parse(readFileSync(join(folder, 'drawn', 'report.json'), 'utf8'));
  assert.deepEqual(report.patches.map((patch) => [patch.atlas.patch, patch.atlas.landmarks >= 4, patch.atlas.left_out]), Array(6).fill(['hand', true, 0]));
  await close(page);
  // What was saved is read again.
  const again = await open(join(folder, 'landmarks.html'));
  await again.setInputFiles('#landmarks-file', path);
  await again.waitForSelector(`html[data-landmarks="${made + 2}"]`);
  assert.equal(await again.locator('#landmarks-list input').first().inputValue(), 'heel, "left"');
  await again.setInputFiles('#landmarks-file', { name: 'x.csv', mimeType: 'text/csv', buffer: Buffer.from('taxel_id,atlas_taxel_id\n75,71\n7777777,5\n') });
  await again.waitForSelector('html[data-landmarks="1"]');
  assert.equal(await again.textContent('#landmarks-wrong'), 'Line 3: 0 taxels of the skin have the id 7777777.');
  await close(again);
});

await test('an atlas of one patch shows its coarsest level below those of the whole skin', async () => {
  const page = await open(join(folder, 'landmarks.html'));
  const shown = await page.evaluate(() => {
    const d = window.dermatome, atlas = d.landmarks.stage, own = d.patches[0].most, { most, body } = atlas.patches[0], levels = [];
    d.setPaint('field');
    for (let level = 0; level <= +document.getElementById('level').max; level++) { d.setLevel(level); d.draw(); levels.push(atlas.view.level); }
    return { levels, own, most, body: body.length };
  });
  assert.ok(shown.body === 0 && shown.levels.length > shown.own, JSON.stringify(shown));
  assert.deepEqual(shown.levels, shown.levels.map((_, level) => Math.min(level, shown.most - 1)), JSON.stringify(shown));
  await close(page);
});

await test('tables of landmarks have the words of other tables', async () => {
  const page = await open(join(folder, 'landmarks.html'));
  for (const [head, sign] of [['taxel_id,atlas_taxel_id', ','], ['ID;Atlas_Taxel_ID', ';'], ['id\tatlas_taxel_id', '\t'], ['Taxel_id;atlas_taxel_id;NAME', ';']]) {
    const rows = hands.slice(0, 5).map(([own, other]) => [own, other, ...(head.includes('NAME') ? ['"a;b"'] : [])].join(sign));
    await page.evaluate(() => document.documentElement.dataset.landmarks = '');
    await page.setInputFiles('#landmarks-file', { name: 'x.csv', mimeType: 'text/csv', buffer: Buffer.from(`${head}\n${rows.join('\n')}\n`) });
    await page.waitForSelector('html[data-landmarks="5"]');
    assert.equal(await page.textContent('#landmarks-wrong'), '', head);
  }
  assert.equal(await page.locator('#landmarks-list input').first().inputValue(), 'a;b');
  await close(page);
});

await test('a flipped triangle is under the pointer only where it lies', async () => {
  const page = await open(join(folder, 'landmarks.html'));
  const found = await page.evaluate(() => {
    // The second triangle is flipped, and the place is outside of it.
    const patch = { faces: 2, sheet: [0, 0, 1, 0, 0, 1, 1, 0.4, 0.6, 1, 1, 1], triangles: [0, 1, 2, 3, 5, 4] };
    for (const turned of [[3, 5, 4], [3, 4, 5]]) {
      patch.triangles.splice(3, 3, ...turned);
      const grid = new window.dermatome.stage.grid.constructor([patch], [1, 1]);
      const at = [grid.find(0.3, 0.3), grid.find(0.9, 0.9)];
      if (at[0]?.face !== 0 || at[1]?.face !== 1 || Math.min(...at[1].weights) < 0) return { turned, at };
    }
    return null;
  });
  assert.equal(found, null, JSON.stringify(found));
  await close(page);
});

await test('the page says when landmarks are those of the other hand', async () => {
  const page = await open(join(folder, 'landmarks.html'));
  const table = (order) => `taxel_id,atlas_taxel_id\n${hands.map(([own], k) => `${own},${hands[5 * Math.floor(k / 5) + order[k % 5]][1]}\n`).join('')}`;
  for (const [order, isOther] of [[[0, 1, 2, 3, 4], false], [[1, 0, 3, 2, 4], true]]) {
    await page.setInputFiles('#landmarks-file', { name: 'x.csv', mimeType: 'text/csv', buffer: Buffer.from(table(order)) });
    await page.waitForFunction((isOther) => document.documentElement.dataset.landmarks === '30' && document.getElementById('landmarks-options').textContent.includes('--mirror') === isOther, isOther);
    assert.equal((await page.textContent('#landmarks-needs')).includes('the other hand'), isOther);
    writeFileSync(join(folder, 'order.csv'), table(order));
    run('build', join(meshes, 'robot_hand.glb'), '-o', join(folder, 'mirrored'), '--atlas', join(folder, 'hand', 'map.glb'), '--landmarks', join(folder, 'order.csv'), ...(isOther ? ['--mirror'] : []));
  }
  await close(page);
});

await test('regions of the same name are proposed first, and no taxel on a seam', async () => {
  run('report', join(folder, 'named', 'map.glb'), '--atlas', join(folder, 'named', 'map.glb'), '-o', join(folder, 'regions.html'));
  const page = await open(join(folder, 'regions.html'));
  assert.match(await page.textContent('#landmarks-text'), /\(wrist: taxel/);
  await page.keyboard.press('Enter');
  assert.deepEqual(await page.evaluate(() => window.dermatome.landmarks.pairs.map(({ name, own, other }) => [name, own.taxel === other.taxel])), [['wrist', true]]);
  assert.doesNotMatch(await page.textContent('#landmarks-text'), /\(wrist: taxel/);
  await close(page);
  run('report', join(folder, 'glove', 'map.glb'), '--atlas', join(folder, 'glove', 'map.glb'), '-o', join(folder, 'gloves.html'));
  const gloves = await open(join(folder, 'gloves.html'));
  const taxel = await gloves.evaluate(() => { const p = window.dermatome.patches[0]; return p.taxelOf[p.places - 1]; });
  await gloves.evaluate((taxel) => window.dermatome.landmarks.ask({ patch: 0, taxel }, 'x'), taxel);
  assert.match(await gloves.textContent('#landmarks-wrong'), /lies on the seam.*click beside it/);
  await close(gloves);
});

await test('an address with numbers between frames, levels and taxels opens', async () => {
  for (const hash of ['#frame=0.5', '#level=0.5', '#taxel=0:0.5', '#frame=1e9&level=-3']) {
    const page = await open(join(folder, 'recording.html'), {}, hash);
    const [frame, level] = await page.evaluate(() => [window.dermatome.frame, window.dermatome.level]);
    assert.ok(Number.isInteger(frame) && Number.isInteger(level), `${hash}: frame ${frame}, level ${level}`);
    await close(page);
  }
});

await test('a page of patches with few levels begins on one that all have', async () => {
  const page = await open(maps.robot);
  const [level, least] = await page.evaluate(() => [window.dermatome.level, Math.min(...window.dermatome.patches.map((p) => p.fields.length))]);
  assert.equal(level, Math.min(2, least - 1));
  await close(page);
});

await test('pictures on one page keep the colours of their scales', async () => {
  const svg = (...words) => readFileSync((run('plot', join(folder, 'robot', 'map.glb'), '-o', join(folder, `${words.length}.svg`), ...words), join(folder, `${words.length}.svg`)), 'utf8');
  const ids = [svg('--show', 'angle'), svg('--show', 'area', '--level', '0')].map((text) => text.match(/linearGradient id="([^"]+)"/)[1]);
  assert.notEqual(ids[0], ids[1]);
});

await test('a recording plays, with its contacts', async () => {
  const page = await open(join(folder, 'recording.html'));
  assert.match(await page.textContent('#frame-text'), /contact/);
  await page.evaluate(() => window.dermatome.setUnfold(0.35));
  await settle(page);
  await page.screenshot({ path: join(folder, 'page.png') });
  const before = await page.inputValue('#frame');
  await page.evaluate(() => window.dermatome.setFrame(0));
  await page.focus('#map');
  await page.keyboard.press(' ');
  await page.waitForFunction(() => +document.getElementById('frame').value > 3, null, { timeout: 20000 });
  await page.keyboard.press(' ');
  assert.notEqual(before, '0');
  await close(page);
});

await test('events are marked on the time line and on the map, as the command writes them', async () => {
  run('touch', join(folder, 'forearm', 'map.glb'), '-o', join(folder, 'events.npz'), '--touches', '2', '--apart-mm', '60', '--presses', '3');
  run('report', join(folder, 'forearm', 'map.glb'), join(folder, 'events.npz'), '-o', join(folder, 'events.html'));
  const lines = run('render', join(folder, 'forearm', 'map.glb'), join(folder, 'events.npz'), '-o', join(folder, 'events.none.npz'), '--events', '-').trim().split('\n').map((line) => JSON.parse(line));
  const ended = lines.filter((event) => event.phase === 'end');
  const page = await open(join(folder, 'events.html'));
  const marks = page.locator('#events button');
  const words = await marks.allTextContents();
  assert.ok(words.length > 3, words.join());
  assert.deepEqual(words.sort(), ended.map((event) => event.event).sort());
  // Each mark lies where its event is on the time line, and in the line.
  const far = await page.evaluate(() => {
    const d = window.dermatome, { events, times } = d.data.header.recording, { clientWidth: width } = document.getElementById('events');
    const marks = [...document.querySelectorAll('#events button')];
    return events.map((event, k) => Math.max(Math.abs(marks[k].offsetLeft - (event.first / (times.length - 1)) * width), Math.abs(times[event.first] - event.begin) * 50, marks[k].offsetLeft + marks[k].offsetWidth - width));
  });
  assert.ok(far.every((x) => x < 6), far.join());
  // The pointer gives the numbers, a click goes there.
  await page.locator('#events button').first().hover();
  assert.match(await page.textContent('#event-text'), /\d s long.*area/);
  await page.locator('#events button').first().click();
  const first = await page.evaluate(() => window.dermatome.data.header.recording.events[0]);
  assert.equal(await page.inputValue('#frame'), `${Math.round((first.first + first.last) / 2)}`);
  assert.ok((await page.getAttribute('html', 'data-events')).split(',').includes(first.word));
  assert.ok(await page.locator('#events button.now').count() > 0);
  // What is drawn over the map is at the place of the event.
  const inked = await page.evaluate(() => {
    const d = window.dermatome, event = d.data.header.recording.events[0].contact, overlay = document.getElementById('overlay'), ratio = overlay.width / overlay.clientWidth;
    const count = () => {
      d.draw();
      const [x, y] = d.pixelsOf(true, event.patch, event.to, event.peak), { data } = overlay.getContext('2d').getImageData((x - 8) * ratio, (y - 8) * ratio, 16 * ratio, 16 * ratio);
      let dark = 0;
      for (let k = 0; k < data.length; k += 4) if (data[k + 3] > 200 && data[k] < 60 && data[k + 1] < 60) dark++;
      return dark;
    };
    d.setTheme('light');
    const here = count();
    d.setFrame(0);
    return [here, count()];
  });
  await page.mouse.move(400, 300);
  assert.ok(inked[0] > 10, inked.join());
  await page.focus('#map');
  await page.evaluate(() => window.dermatome.setFrame(0));
  await page.keyboard.press('e');
  assert.equal(await page.inputValue('#frame'), `${first.first}`);
  await page.locator('#events button').first().hover();
  await page.screenshot({ path: join(folder, 'events.png') });
  await close(page);
});

const covers = process.env.DERMATOME_DATA && join(process.env.DERMATOME_DATA, 'cyskin');
const measured = 'a measured recording of a real cover plays, with its contacts';
if (!covers || !existsSync(covers)) console.log(`skipped: ${measured}; DERMATOME_DATA names no folder with cyskin`);
else await test(measured, async () => {
  run('build', join(covers, 'curved_gesture_patch_isomap.json'), '-o', join(folder, 'cover'));
  run('report', join(folder, 'cover', 'map.glb'), join(covers, 'recordings', '2_finger_01.txt'), '-o', join(folder, 'cover.html'));
  const page = await open(join(folder, 'cover.html'));
  const frames = await page.evaluate(() => {
    const d = window.dermatome, says = [];
    for (let frame = 0; frame < d.data.header.recording.times.length; frame++) {
      d.setFrame(frame);
      says.push(document.getElementById('frame-text').textContent);
    }
    return says;
  });
  assert.ok(frames.length > 20 && frames.filter((said) => said.includes('2 contacts')).length > 3, frames.join('; '));
  assert.doesNotMatch(frames[0], /contact/);
  await close(page);
});

await test('a touch keeps the taxel under the finger', async () => {
  const page = await open(maps.forearm, { hasTouch: true, viewport: { width: 390, height: 844 } });
  const [x, y] = await page.evaluate(() => {
    document.getElementById('map').scrollIntoView({ block: 'center' });
    const d = window.dermatome, box = document.getElementById('stage').getBoundingClientRect();
    const [x, y] = d.view.toPixels(true, 0, [[500, 1]]);
    return [x + box.left, y + box.top];
  });
  await page.touchscreen.tap(x, y);
  await settle(page);
  assert.equal(await page.evaluate(() => document.documentElement.dataset.taxel), '0:500');
  assert.match(await page.textContent('#taxel'), /kept/);
  await close(page);
});

await test('hostile names stay text', async () => {
  run('convert', join(meshes, 'forearm.glb'), join(folder, 'hostile.csv'));
  const hostile = `<img src=x onerror=alert(1)></script><script>alert(2)</script>`;
  const csv = readFileSync(join(folder, 'hostile.csv'), 'utf8').split('\n');
  const column = csv[0].split(',').indexOf('patch');
  writeFileSync(join(folder, 'hostile.csv'), csv.map((line, k) => { const cells = line.split(','); if (k > 0 && cells.length > column) cells[column] = hostile; return cells.join(','); }).join('\n'));
  run('build', join(folder, 'hostile.csv'), '-o', join(folder, 'hostile'));
  run('report', join(folder, 'hostile', 'map.glb'), '--title', `%%DATA%%${hostile}`, '-o', join(folder, 'hostile.html'));
  const page = await open(join(folder, 'hostile.html'));
  await page.evaluate(() => { window.dermatome.pin({ patch: 0, taxel: 3 }); window.dermatome.setPaint('patch'); window.dermatome.draw(); });
  assert.equal(await page.locator('img').count(), 0);
  assert.equal(await page.textContent('h1'), `%%DATA%%${hostile}`);
  assert.ok((await page.textContent('#tree')).includes(hostile));
  assert.ok((await page.textContent('#numbers')).includes(hostile));
  await close(page);
});

await test('without WebGL the picture and the numbers are there', async () => {
  const plain = await chromium.launch({ executablePath, args: ['--no-sandbox', '--disable-gpu', '--disable-3d-apis'] });
  const page = await plain.newPage();
  await page.goto(pathToFileURL(maps.forearm).href);
  await page.waitForSelector('html[data-ready=flat]');
  assert.ok(await page.locator('#picture svg').isVisible());
  assert.ok(await page.locator('#numbers table').isVisible());
  await plain.close();
});

await test('390 pixels need no sideways scrolling, and print shows the picture', async () => {
  const page = await open(join(folder, 'recording.html'), { viewport: { width: 390, height: 844 } });
  assert.equal(await page.evaluate(() => document.documentElement.scrollWidth), 390);
  await page.screenshot({ path: join(folder, 'phone.png'), fullPage: true });
  await page.evaluate(() => dispatchEvent(new Event('beforeprint')));
  await page.emulateMedia({ media: 'print' });
  assert.ok((await page.locator('#picture img').boundingBox()).width > 100);
  await close(page);
});

await test('readings are shown while they come, and to nobody else', async () => {
  const map = join(folder, 'forearm', 'map.glb');
  const live = spawn(program, ['report', map, '--live', '--quiet'], { stdio: ['pipe', 'pipe', 'inherit'] });
  // It may end before the last check.
  const exit = new Promise((done) => live.on('exit', done));
  const ids = Array.from({ length: 1000 }, (_, k) => k + 1);
  live.stdin.write(`time,${ids.join()}\n`);
  let frame = 0;
  const row = (touched) => `${(frame++ / 50).toFixed(2)},${ids.map((id) => (Math.abs(id - touched) < 4 ? 5 : 0)).join()}\n`;
  const timer = setInterval(() => live.stdin.write(row(-9)), 20);
  const address = await new Promise((done) => { let said = ''; live.stdout.on('data', (d) => { said += d; if (said.includes('\n')) done(said.trim()); }); });
  assert.match(address, /^http:\/\/127\.0\.0\.1:\d+\/[0-9a-f]{32}\/$/);
  const wrong = address.replace(/[0-9a-f]{32}/, '0'.repeat(32));
  assert.equal((await fetch(wrong)).status, 404);
  assert.equal((await fetch(address, { headers: { Origin: 'https://example.com' } })).status, 403);
  const page = await browser.newPage();
  const complaints = [];
  page.on('pageerror', (e) => complaints.push(`${e}`));
  page.on('console', (m) => { if (m.type() === 'error') complaints.push(m.text()); });
  await page.goto(address);
  await page.waitForFunction(() => +document.documentElement.dataset.frames > 5, null, { timeout: 30000 });
  assert.match(await page.textContent('#frame-text'), / s/);
  clearInterval(timer);
  const write = (count, touched) => { for (let k = 0; k < count; k++) live.stdin.write(row(touched)); };
  write(25, 500);
  write(75, -9);
  await page.waitForFunction(() => document.querySelectorAll('#events button').length > 0, null, { timeout: 10000 });
  const said = await page.$$eval('#events button', (marks) => marks.map((mark) => [mark.textContent, mark.getAttribute('aria-label'), mark.offsetLeft]));
  const press = said.find(([word]) => word === 'press');
  assert.ok(press, JSON.stringify(said));
  assert.match(press[1], /0\.\d+ s long/);
  // What goes on ends with the input.
  write(25, 700);
  live.stdin.end();
  await page.waitForSelector('html[data-live=ended]', { timeout: 10000 });
  assert.ok((await page.$$('#events button')).length > said.length, 'the last event');
  assert.equal(await exit, 0);
  assert.deepEqual(complaints, []);
  await page.close();
});

await test('a page of a thousand taxels is small', async () => {
  const size = statSync(maps.forearm).size;
  assert.ok(size < 900_000, `${size} bytes`);
});

await browser.close();
process.exit(failed ? 1 : 0);

/** The two chunks of a .glb. */
function glb(bytes) {
  const length = bytes.readUInt32LE(12);
  return { json: JSON.parse(bytes.subarray(20, 20 + length).toString()), binary: bytes.subarray(28 + length) };
}

/** The numbers of an accessor of VEC3. */
function accessor(json, binary, index) {
  const { bufferView, byteOffset = 0, count, componentType } = json.accessors[index];
  const view = json.bufferViews[bufferView], start = (view.byteOffset ?? 0) + byteOffset;
  const read = componentType === 5126 ? (k) => binary.readFloatLE(k) : (k) => binary.readUInt32LE(k);
  return Array.from({ length: 3 * count }, (_, k) => read(start + Math.floor(k / 3) * (view.byteStride ?? 12) + 4 * (k % 3)));
}
