// Landmarks between two skins: the page asks for a place of the skin, a click on the atlas answers.

import { paint, colour } from './colours';
import type { Data } from './data';
import type { Patch } from './patch';
import { FEWEST, Registration, centreOf, farthest, type Pair } from './registration';
import { Stage, type Taxel } from './stage';
import { fromCsv, toCsv } from './table';

const byId = <T extends HTMLElement>(id: string): T => document.getElementById(id) as T;
const isOne = (a: Taxel | null, b: Taxel | null): boolean => !!a && !!b && a.patch === b.patch && a.taxel === b.taxel;

/** A place of the skin that is asked for, where it may be on the atlas, and what it is called. */
interface Question { own: Taxel; guess: Taxel | null; name: string }

export class Landmarks {
  readonly stage: Stage;
  pairs: Pair[] = [];
  private fit: Registration;
  private question: Question | null = null;
  /** Places that were asked for and passed over. */
  private readonly passed: Taxel[] = [];
  private hovered: { own: Taxel | null; other: Taxel | null } = { own: null, other: null };
  private shown: Pair | null = null;
  private isSaved = true;

  constructor(private readonly data: Data, private readonly own: Stage, private readonly changed: () => void) {
    const atlas = data.header.atlas!;
    document.body.classList.add('two');
    byId('other-stage').hidden = byId('landmarks').hidden = false;
    byId('skin-label').textContent = data.header.title;
    byId('other-label').textContent = `atlas: ${atlas.name}`;
    this.stage = new Stage(data, atlas, 'other-');
    this.fit = new Registration(own.patches, this.stage.patches, []);
    this.stage.steer({
      hover: (at) => { this.hovered.other = at; this.changed(); },
      click: (isMap, x, y) => this.answer(this.stage.taxelAt(isMap, x, y)),
      moved: () => this.changed(), kept: () => {},
    });
    byId('accept').addEventListener('click', () => this.accept());
    byId('skip').addEventListener('click', () => this.skip());
    byId('save-landmarks').addEventListener('click', () => this.save());
    const file = byId<HTMLInputElement>('landmarks-file');
    byId('read-landmarks').addEventListener('click', () => file.click());
    file.addEventListener('change', () => void file.files?.[0]?.text().then((text) => { this.read(text); file.value = ''; }));
    addEventListener('beforeunload', (e) => { if (!this.isSaved) e.preventDefault(); });
    this.update();
  }

  /** The level of the atlas that is shown for one of the skin: the same, or its coarsest. */
  private levelFor(level: number): number {
    const own = this.own.patches[0].most, { most, body } = this.stage.patches[0];
    return level < own || body.length === 0 ? Math.min(level, most - 1) : most + Math.min(level - own, body.length - 1);
  }

  /** Paints the atlas as the skin is painted, as far as it has the same values. */
  paint(name: string, of: number): void {
    const level = this.levelFor(of);
    const { patches, view } = this.stage, paints = paint(name === 'recording' ? 'plain' : name, patches, level, this.data.header.atlas!.regions, this.data.header.atlas!.modalities);
    view.level = level;
    patches.forEach((patch, k) => {
      colour(paints, patch, k, level, view.colours(k));
      view.coloursChanged(k);
    });
  }

  hover(at: Taxel | null): void { this.hovered.own = at; }

  /** A click on the skin asks for the place of its taxel. */
  clickOwn(isMap: boolean, x: number, y: number): void {
    const own = this.own.taxelAt(isMap, x, y);
    if (own) this.ask(own, this.nameOf(own));
  }

  key(key: string): boolean {
    if (key === 'Enter') this.accept();
    else if (key === 'n') this.skip();
    else return false;
    return true;
  }

  private ask(own: Taxel, name: string): void {
    const { header, ids } = this.own.patches[own.patch];
    if (this.own.patches[own.patch].isOnSeam(own.taxel)) { this.say(`Taxel ${ids[own.taxel]} of ${header.name} lies on the seam, where the map has two banks: click beside it.`); return; }
    this.question = { own, name, guess: this.fit.predict(own) };
    this.shown = null;
    this.say('');
  }

  private accept(): void { this.answer(this.question?.guess ?? null); }

  private skip(): void {
    if (this.question) this.passed.push(this.question.own);
    this.propose();
    this.say('');
  }

  /** Makes a pair of the place that is asked for and a taxel of the atlas. */
  private answer(other: Taxel | null): void {
    const { question } = this;
    if (!other || !question) return;
    const patch = this.stage.patches[other.patch], id = patch.ids[other.taxel];
    const used = this.pairs.findIndex((pair) => isOne(pair.other, other) && !isOne(pair.own, question.own));
    if (patch.isOnSeam(other.taxel)) { this.say(`Taxel ${id} of the atlas lies on the seam, where its map has two banks: click beside it.`); return; }
    if (used >= 0) { this.say(`Taxel ${id} of the atlas is landmark ${used + 1} already: click another one.`); return; }
    const pair = { name: question.name, own: question.own, other }, again = this.pairs.findIndex((known) => isOne(known.own, question.own));
    if (again >= 0) this.pairs[again] = { ...pair, name: this.pairs[again].name }; else this.pairs.push(pair);
    this.isSaved = false;
    this.update();
  }

  private remove(pair: Pair): void {
    this.pairs.splice(this.pairs.indexOf(pair), 1);
    this.isSaved = this.pairs.length === 0;
    this.update();
  }

  private update(wrong = ''): void {
    this.fit = new Registration(this.own.patches, this.stage.patches, this.pairs);
    this.shown = null;
    this.propose();
    this.say(wrong);
  }

  /** The next place to ask for: a region of both skins, else the taxel that is farthest from all landmarks of a patch that needs one. */
  private propose(): void {
    this.question = this.nextRegion() ?? this.nextFarthest();
    if (this.question) this.question.guess ??= this.fit.predict(this.question.own);
  }

  private nextRegion(): Question | null {
    const { regions } = this.data.header, theirs = this.data.header.atlas!.regions;
    const regionOf = ({ patch, taxel }: Taxel): number => this.own.patches[patch].region[taxel];
    const known = new Set([...this.pairs.map((pair) => pair.own), ...this.passed].map(regionOf));
    for (const [k, name] of regions.entries()) {
      const same = theirs.indexOf(name);
      if (same < 0 || known.has(k + 1)) continue;
      const [own, guess] = [centreOf(this.own.patches, k + 1), centreOf(this.stage.patches, same + 1)];
      if (own && guess) return { own, guess, name };
    }
    return null;
  }

  private nextFarthest(): Question | null {
    const marked = [...this.pairs.map((pair) => pair.own), ...this.passed];
    const of = (k: number): number[] => marked.filter((at) => at.patch === k).map((at) => at.taxel);
    const shown = this.own.patches.map((_, k) => k).filter((k) => this.own.view.isShown(k));
    // Patches that have begun first, then those that have none, then where most is unknown.
    const lacking = shown.filter((k) => this.lacks(k)).sort((a, b) => Math.sign(of(b).length) - Math.sign(of(a).length) || a - b);
    const found = (lacking.length > 0 ? lacking.slice(0, 1) : shown).map((patch) => ({ patch, at: farthest(this.own.patches[patch], of(patch)) }));
    const best = found.filter(({ at: [taxel] }) => taxel >= 0).sort((a, b) => b.at[1] - a.at[1])[0];
    if (!best || best.at[1] === 0) return null;
    const own = { patch: best.patch, taxel: best.at[0] };
    return { own, guess: null, name: this.nameOf(own) };
  }

  private nameOf({ patch, taxel }: Taxel): string {
    const of = this.own.patches[patch], region = of.region[taxel];
    const base = region > 0 ? this.data.header.regions[region - 1] : of.header.name, names = new Set(this.pairs.map((pair) => pair.name));
    for (let k = 1; ; k++) { const name = region > 0 && k === 1 ? base : `${base} ${k}`; if (!names.has(name)) return name; }
  }

  private lacks(patch: number): boolean {
    const { count, onALine } = this.fit.count(patch);
    return count < FEWEST || onALine;
  }

  // What is said

  private say(wrong: string): void {
    byId('landmarks-wrong').textContent = wrong;
    const { question } = this, told = byId('landmarks-text');
    told.textContent = 'There is no place left to ask for: click one on the skin.';
    if (question) {
      const { header, ids } = this.own.patches[question.own.patch];
      const where = `Where is the marked place of the skin (${question.name}: taxel ${ids[question.own.taxel]} of ${header.name}) on the atlas? `;
      const guess = question.guess ? 'Click it there, or press Enter for the dashed circle, where the page expects it. ' : 'Click it there. ';
      told.textContent = `${where}${guess}A click on the skin asks for another place.`;
    }
    byId<HTMLButtonElement>('accept').disabled = !question?.guess;
    byId<HTMLButtonElement>('save-landmarks').disabled = this.pairs.length === 0;
    this.list();
    this.needs();
    const options = byId('landmarks-options');
    options.hidden = this.pairs.length === 0;
    const words = ['--atlas ATLAS/map.glb', '--landmarks landmarks.csv', ...(this.fit.isMirrored ? ['--mirror'] : [])];
    options.querySelector('code')!.replaceChildren(...words.flatMap((word) => { const whole = document.createElement('span'); whole.textContent = word; return [whole, ' ']; }));
    document.documentElement.dataset.landmarks = `${this.pairs.length}`;
    this.changed();
  }

  private list(): void {
    const rows = this.fit.misses().map((miss, k) => {
      const pair = this.pairs[k], row = document.createElement('li'), name = document.createElement('input'), remove = document.createElement('button');
      const small = document.createElement('small'), number = document.createElement('span');
      number.textContent = `${k + 1}`;
      name.value = pair.name;
      name.setAttribute('aria-label', 'name of the landmark');
      name.addEventListener('input', () => { pair.name = name.value; this.isSaved = false; });
      remove.type = 'button';
      remove.textContent = '×';
      remove.setAttribute('aria-label', `remove landmark ${k + 1}`);
      remove.addEventListener('click', (e) => { e.stopPropagation(); this.remove(pair); });
      const [own, other] = [this.own.patches[pair.own.patch], this.stage.patches[pair.other.patch]];
      small.textContent = `${own.ids[pair.own.taxel]} → ${other.ids[pair.other.taxel]}${miss === null ? '' : `, off by ${(1000 * miss).toFixed(1)} mm`}`;
      small.title = `taxel ${own.ids[pair.own.taxel]} of ${own.header.name}, ${other.ids[pair.other.taxel]} of ${other.header.name}${miss === null ? '' : '; off from where the other landmarks put it'}`;
      row.classList.toggle('now', pair === this.shown);
      row.append(number, name, remove, small);
      row.addEventListener('click', () => this.show(pair, row));
      return row;
    });
    byId('landmarks-list').replaceChildren(...rows);
  }

  /** Turns both skins to a pair. */
  private show(pair: Pair, row: HTMLElement): void {
    this.shown = pair;
    for (const [stage, at] of [[this.own, pair.own], [this.stage, pair.other]] as [Stage, Taxel][]) stage.view.turnTo(at.patch, stage.patches[at.patch].frame(at.taxel)[1]);
    for (const other of byId('landmarks-list').children) other.classList.toggle('now', other === row);
    this.changed();
  }

  /** Which patches need more landmarks, and whether they are those of the other hand. */
  private needs(): void {
    const lacking = this.own.patches.flatMap((patch, k) => {
      const { count, onALine } = this.fit.count(k);
      if (onALine) return [`${patch.header.name}: all on a line`];
      return count < FEWEST ? [`${patch.header.name}: ${count} of ${FEWEST}`] : [];
    });
    const says = lacking.length > 0 ? [`Each patch needs ${FEWEST} landmarks or more, not on a line. Still too few: ${lacking.join('; ')}.`] : ['Each patch has enough landmarks; more make the map better.'];
    if (this.fit.isMirrored) says.push('The landmarks fit the mirror image of the atlas: this is the other hand, and build needs --mirror.');
    byId('landmarks-needs').replaceChildren(...says.map((said, k) => {
      const line = document.createElement('li');
      line.className = k > 0 || lacking.length > 0 ? 'lacks' : '';
      line.textContent = said;
      return line;
    }));
  }

  // What is drawn

  draw(): void {
    const style = getComputedStyle(document.documentElement), [ink, accent, back] = ['--ink', '--accent', '--view'].map((name) => style.getPropertyValue(name).trim());
    this.stage.view.draw();
    const c = this.stage.cleared();
    this.stage.scaleBar(c, ink);
    this.marks(c, this.stage, (pair) => pair.other, ink, back);
    const { question, hovered } = this;
    const expected = hovered.own && !isOne(hovered.own, question?.own ?? null) ? this.fit.predict(hovered.own) : null;
    if (expected) for (const { x, y } of this.stage.pixelsOf(expected)) {
      c.beginPath(); c.moveTo(x - 6, y); c.lineTo(x + 6, y); c.moveTo(x, y - 6); c.lineTo(x, y + 6);
      for (const [width, stroke] of [[4, back], [1.6, accent]] as [number, string][]) { c.lineWidth = width; c.strokeStyle = stroke; c.stroke(); }
    }
    if (question?.guess) { c.setLineDash([4, 3]); this.stage.ring(c, question.guess, [[5, back], [2.2, accent]]); c.setLineDash([]); }
    if (hovered.other) this.stage.ring(c, hovered.other, [[3, back], [1.4, ink]], 6);
  }

  /** What is drawn over the skin: its landmarks, and the place that is asked for. */
  drawOwn(c: CanvasRenderingContext2D, ink: string, accent: string, back: string): void {
    this.marks(c, this.own, (pair) => pair.own, ink, back);
    if (!this.question) return;
    this.own.ring(c, this.question.own, [[5, back], [2.2, accent]]);
    for (const { x, y, faces } of this.own.pixelsOf(this.question.own)) if (faces) { c.fillStyle = accent; c.beginPath(); c.arc(x, y, 3, 0, 7); c.fill(); }
  }

  private marks(c: CanvasRenderingContext2D, stage: Stage, side: (pair: Pair) => Taxel, ink: string, back: string): void {
    this.pairs.forEach((pair, k) => {
      for (const { x, y, faces } of stage.pixelsOf(side(pair))) {
        c.globalAlpha = faces ? 1 : 0.25;
        c.beginPath(); c.arc(x, y, pair === this.shown ? 6 : 4, 0, 7);
        c.lineWidth = 2; c.strokeStyle = back; c.stroke(); c.fillStyle = ink; c.fill();
        c.font = '600 12px system-ui, "DejaVu Sans", sans-serif'; c.textAlign = 'left';
        c.lineWidth = 3; c.strokeText(`${k + 1}`, x + 6, y - 5); c.fillText(`${k + 1}`, x + 6, y - 5);
      }
      c.globalAlpha = 1;
    });
  }

  // Files

  private get sides(): [Patch[], Patch[]] { return [this.own.patches, this.stage.patches]; }

  private save(): void {
    const link = document.createElement('a');
    link.href = URL.createObjectURL(new Blob([toCsv(...this.sides, this.pairs)], { type: 'text/csv' }));
    link.download = 'landmarks.csv';
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    this.isSaved = true;
  }

  private read(text: string): void {
    const { pairs, wrong } = fromCsv(...this.sides, text);
    if (pairs.length > 0) {
      this.pairs = [];
      for (const pair of pairs) this.pairs.push({ ...pair, name: pair.name || this.nameOf(pair.own) });
      this.isSaved = true;
    }
    this.update(wrong.join(' '));
  }
}
