// The page: what is shown, and how it is steered.

import { CATEGORIES, UNKNOWN, colour, figures, levelName, mix, paint, paintNames, recordingPaint, type Paint } from './colours';
import { load, type Contact, type Data, type EventRow, type Part, type RecordingHeader } from './data';
import { EventStrip } from './events';
import { Landmarks } from './landmarks';
import { addEvents, append, listen, type LiveFrame } from './live';
import type { Patch } from './patch';
import { crossesItself, patchNear, taxelsIn, toJson, type Region } from './regions';
import { Stage, type Taxel } from './stage';
import type { View } from './view';

const byId = <T extends HTMLElement>(id: string): T => document.getElementById(id) as T;
const text = (tag: string, content: string, className = ''): HTMLElement => {
  const element = document.createElement(tag);
  element.textContent = content;
  if (className) element.className = className;
  return element;
};

/** A box in the frame of a link, by its lower and its upper corner, in m. */
interface Box { link: number; low: number[]; high: number[] }
/** Frame of contacts by number: `[frame, track, event, patch, taxels, area, force, u, v, peak]`. */
const [TRACK, EVENT, PATCH, TAXELS, AREA, FORCE, U, V, PEAK] = [1, 2, 3, 4, 5, 6, 7, 8, 9];
const RELEASE = 2;

class Page {
  readonly stage: Stage;
  readonly patches: Patch[];
  readonly view: View;
  /** The landmarks that lead to another skin, if it is on the page. */
  readonly landmarks: Landmarks | null = null;
  private paints: Paint;
  private hovered: Taxel | null = null;
  private pinned: Taxel | null = null;
  private box: Box | null = null;
  /** The rectangle that is drawn to choose taxels, in pixels of the stage. */
  private frameDrawn: [number, number, number, number] | null = null;
  /** The polygons that name taxels, and the one that is drawn. */
  private readonly regions: Region[] = [];
  private drawing: Region | null = null;
  private level = 0;
  private frame = 0;
  private playing = false;
  private started = [0, 0];
  private readings: Uint8Array[] = [];
  private contacts: Contact[][] = [];
  /** What of the contacts of each frame is on other patches. */
  private parts: Part[][] = [];
  private events: EventStrip | null = null;
  /** The events of the frame that is shown. */
  private happening: EventRow[] = [];
  /** Whether a picture is on its way; at first that of the size observer. */
  private queued = true;
  private isRecolouring = true;
  private isRelighting = true;

  constructor(readonly data: Data) {
    const { header } = data;
    this.stage = new Stage(data, header, '');
    ({ patches: this.patches, view: this.view } = this.stage);
    if (header.atlas) this.landmarks = new Landmarks(data, this.stage, () => this.invalidate());
    if (header.recording && !header.recording.is_live) this.readRecording();
    this.paints = paint('plain', this.patches, 0, [], []);
    this.controls();
    this.tree();
    this.restore();
    this.setTheme(document.documentElement.dataset.theme ?? (matchMedia('(prefers-color-scheme: dark)').matches ? 'dark' : 'light'));
    // Called at once, before the first picture: nothing is drawn twice.
    if (header.recording?.is_live) this.listen(header.recording);
    new ResizeObserver(() => this.resize()).observe(this.stage.box);
  }

  // Drawing

  private resize(): void {
    this.stage.resize();
    this.landmarks?.stage.resize();
    this.queued = false;
    this.events?.layout();
    this.draw();
    document.documentElement.dataset.ready = 'yes';
  }

  private invalidate(): void {
    if (this.queued) return;
    this.queued = true;
    requestAnimationFrame(() => { if (this.queued) { this.queued = false; this.draw(); } });
  }

  private draw(): void {
    if (this.isRecolouring) this.recolour();
    if (this.isRelighting) this.light();
    this.view.draw();
    this.drawOverlay();
    this.landmarks?.draw();
  }

  private recolour(): void {
    this.isRecolouring = false;
    this.landmarks?.paint(this.paints.name, this.level);
    this.patches.forEach((patch, k) => {
      colour(this.paints, patch, k, this.level, this.view.colours(k));
      this.view.coloursChanged(k);
    });
  }

  private get chosen(): Taxel | null { return this.hovered ?? this.pinned; }

  /** Lights a taxel, or all of the field that it belongs to most, with the weights of its taxels. */
  private light(): void {
    this.isRelighting = false;
    const lit = this.lit();
    this.patches.forEach((patch, k) => {
      const colours = this.view.colours(k);
      for (let place = 0; place < patch.places; place++) colours[4 * place + 3] = this.isInBox(patch, place) ? 150 : 0;
      const members = lit?.patch === k ? lit.members : (lit?.beyond.find(([p]) => p === k)?.[1] ?? []);
      for (const [taxel, w] of members) for (const place of patch.placesOf(taxel)) colours[4 * place + 3] = Math.max(1, Math.round(255 * w));
      this.view.coloursChanged(k);
    });
    this.describe();
  }

  /** Of a field of the body `beyond` are the taxels on other patches. */
  private lit(): { patch: number; field: number; members: [number, number][]; beyond: [number, [number, number][]][] } | null {
    const at = this.chosen, level = this.level;
    if (!at) return null;
    const patch = this.patches[at.patch], [[field]] = patch.fieldsOf(level, at.taxel);
    const others = patch.sharing(level).filter((other) => other !== patch);
    const beyond = others.map((other): [number, [number, number][]] => [this.patches.indexOf(other), other.members(level, field)]);
    return { patch: at.patch, field, members: patch.members(level, field), beyond: beyond.filter(([, members]) => members.length > 0) };
  }

  private drawOverlay(): void {
    const c = this.stage.cleared();
    const style = getComputedStyle(document.documentElement);
    const [ink, accent, back] = ['--ink', '--accent', '--view'].map((name) => style.getPropertyValue(name).trim());
    this.stage.scaleBar(c, ink);
    if (this.paints.name === 'recording') this.drawContacts(c, accent, back);
    if (this.paints.name === 'recording') this.drawEvents(c, ink, back);
    if (this.frameDrawn) {
      const [left, top, right, bottom] = this.frameDrawn;
      c.lineWidth = 1.5; c.strokeStyle = accent; c.strokeRect(left, top, right - left, bottom - top);
    }
    this.drawRegions(c, accent, back);
    this.landmarks?.drawOwn(c, ink, accent, back);
    const at = this.chosen;
    if (!at || !this.view.isShown(at.patch)) return;
    this.stage.ring(c, at, [[5, back], [2.2, accent]]);
  }

  /** Centres of contacts with their numbers, and where they came from. */
  private drawContacts(c: CanvasRenderingContext2D, accent: string, back: string): void {
    const now = this.contacts[this.frame] ?? [];
    for (const contact of now.filter((of) => of[EVENT] !== RELEASE)) {
      const parts = (this.parts[this.frame] ?? []).filter(([, track]) => track === contact[TRACK]);
      const own = contact[AREA] - parts.reduce((sum, [, , , area]) => sum + area, 0);
      const trail: Contact[] = [];
      for (let f = this.frame; f >= Math.max(0, this.frame - 60); f--) {
        const before = this.contacts[f]?.find((of) => of[TRACK] === contact[TRACK] && of[PATCH] === contact[PATCH]);
        if (!before) break;
        trail.push(before);
      }
      for (const isMap of [false, true]) {
        const points = trail.map((of) => this.pixelsOf(isMap, of[PATCH], [of[U], of[V]], of[PEAK])).filter((p): p is [number, number] => !!p);
        if (points.length === 0 || !this.view.isShown(contact[PATCH])) continue;
        c.lineJoin = 'round';
        for (const [width, stroke] of [[4, back], [2, accent]] as [number, string][]) {
          c.beginPath(); points.forEach(([x, y], k) => (k ? c.lineTo(x, y) : c.moveTo(x, y)));
          c.lineWidth = width; c.strokeStyle = stroke; c.stroke();
        }
        const [x, y] = points[0];
        const radiusOf = (area: number): number => Math.max(6, Math.sqrt(area / Math.PI) / this.view.metresPerPixel(isMap));
        const radius = radiusOf(own);
        c.beginPath(); c.arc(x, y, radius, 0, 7); c.stroke();
        for (const [, , patch, area, peak] of parts) {
          const at = this.view.isShown(patch) ? this.view.toPixels(isMap, patch, [[peak, 1]]) : null;
          if (at) { c.beginPath(); c.arc(...at, radiusOf(area), 0, 7); c.stroke(); }
        }
        c.font = '600 12px system-ui, sans-serif'; c.textAlign = 'left';
        c.lineWidth = 3; c.strokeStyle = back; c.strokeText(`${contact[TRACK]}`, x + radius + 3, y - radius);
        c.fillStyle = accent; c.fillText(`${contact[TRACK]}`, x + radius + 3, y - radius);
      }
    }
  }

  /** Words at the places of the events of this frame and of the one that is pointed at, with the way of those that move. */
  private drawEvents(c: CanvasRenderingContext2D, ink: string, back: string): void {
    const hovered = this.events?.hovered ?? null;
    const shown = hovered && !this.happening.includes(hovered) ? [...this.happening, hovered] : this.happening;
    for (const isMap of [false, true]) {
      // Words of one place stand below each other.
      const said: [number, number][] = [];
      for (const { word, contact } of shown) {
        if (!contact || !this.view.isShown(contact.patch)) continue;
        const to = this.pixelsOf(isMap, contact.patch, contact.to, contact.peak), from = this.pixelsOf(isMap, contact.patch, contact.from, contact.peak);
        if (!to || !this.stage.inside(isMap, ...to)) continue;
        const [x, y] = to, angle = from ? Math.atan2(y - from[1], x - from[0]) : 0;
        const hasWay = contact.direction !== null && from && Math.hypot(x - from[0], y - from[1]) > 8;
        c.lineJoin = 'round';
        for (const [width, stroke] of [[5, back], [2, ink]] as [number, string][]) {
          c.beginPath();
          if (hasWay) {
            c.moveTo(...from); c.lineTo(x, y);
            for (const turn of [-0.5, 0.5]) { c.moveTo(x, y); c.lineTo(x - 9 * Math.cos(angle + turn), y - 9 * Math.sin(angle + turn)); }
          } else { c.moveTo(x - 5, y); c.lineTo(x + 5, y); c.moveTo(x, y - 5); c.lineTo(x, y + 5); }
          c.lineWidth = width; c.strokeStyle = stroke; c.stroke();
        }
        let below = y + 22;
        while (said.some(([left, top]) => Math.abs(left - x) < 40 && Math.abs(top - below) < 14)) below += 14;
        said.push([x, below]);
        c.font = '600 13px system-ui, "DejaVu Sans", sans-serif'; c.textAlign = 'center';
        c.lineWidth = 4; c.strokeStyle = back; c.strokeText(word, x, below);
        c.fillStyle = ink; c.fillText(word, x, below);
      }
    }
  }

  /** The pixel of a place on the map of a patch; that of a taxel, if the place is on no triangle. */
  private pixelsOf(isMap: boolean, patch: number, [u, v]: [number, number], peak: number): [number, number] | null {
    const of = this.patches[patch], [dx, dy] = of.header.offset, at = this.stage.grid.find(u + dx, v + dy, 1e-2);
    const places: [number, number][] = at && at.patch === patch ? [0, 1, 2].map((k) => [of.triangles[3 * at.face + k], at.weights[k]]) : [[peak, 1]];
    return this.view.toPixels(isMap, patch, places);
  }

  /** Polygons on the map; the one that is drawn is open. */
  private drawRegions(c: CanvasRenderingContext2D, accent: string, back: string): void {
    for (const region of [...this.regions, ...(this.drawing ? [this.drawing] : [])]) {
      if (region.corners.length === 0) continue;
      const [dx, dy] = this.patches[region.patch].header.offset;
      c.save();
      c.beginPath(); c.rect(this.view.map.x, this.view.map.y, this.view.map.width, this.view.map.height); c.clip();
      c.beginPath();
      for (const [u, v] of region.corners) c.lineTo(...this.view.mapPixel(u + dx, v + dy));
      if (region !== this.drawing) c.closePath();
      for (const [width, stroke] of [[4, back], [2, accent]] as [number, string][]) { c.lineWidth = width; c.strokeStyle = stroke; c.stroke(); }
      for (const [u, v] of region.corners) { const [x, y] = this.view.mapPixel(u + dx, v + dy); c.fillStyle = accent; c.fillRect(x - 3, y - 3, 6, 6); }
      c.restore();
    }
  }

  // What is said

  private describe(): void {
    const box = byId('taxel'), at = this.chosen;
    box.replaceChildren();
    document.documentElement.dataset.taxel = at ? `${at.patch}:${at.taxel}` : '';
    const lit = this.lit(), count = lit ? lit.beyond.reduce((sum, [, members]) => sum + members.length, lit.members.length) : 0;
    document.documentElement.dataset.lit = `${count}`;
    if (!at) {
      box.append(text('p', 'Point at the skin or the map. Click to keep a taxel, Esc to let it go.'));
      return;
    }
    const patch = this.patches[at.patch], list = document.createElement('dl');
    const row = (name: string, value: string): void => { list.append(text('dt', name), text('dd', value)); };
    const mm = (x: number): string => (1000 * x).toFixed(1).replace('-', '\u2212');
    const [position, normal] = patch.frame(at.taxel);
    const presence = ['absent', 'present', 'thermal pad', 'other sensor'][patch.presence[at.taxel]];
    row('id', `${patch.ids[at.taxel]}${presence === 'present' ? '' : `, ${presence}`}${at === this.pinned ? ' (kept)' : ''}`);
    row('patch', `${patch.header.name}, ${this.data.header.links[patch.header.link].name}`);
    if (patch.senses[at.taxel] > 0) row('senses', this.data.header.modalities[patch.senses[at.taxel] - 1].replace(/\+/g, ', '));
    if (patch.region[at.taxel] > 0) row('region', this.data.header.regions[patch.region[at.taxel] - 1]);
    row('position', `${position.toArray().map(mm).join(', ')} mm`);
    row('normal', normal.toArray().map((x) => x.toFixed(2).replace('-', '\u2212')).join(', '));
    const places = patch.placesOf(at.taxel), [dx, dy] = patch.header.offset;
    row(places.length > 1 ? `on the map, ${places.length} places` : 'on the map', places.map((p) => `${mm(patch.sheet[2 * p] - dx)}, ${mm(patch.sheet[2 * p + 1] - dy)}`).join(' and ') + ' mm');
    for (const value of patch.values) row(value.name, `${figures(value.of[at.taxel])} ${value.unit}`);
    row('area', `${figures(1e6 * patch.areas[at.taxel])} mm²`);
    if (lit && patch.fieldsAt(this.level).weights) {
      const of = patch.fieldsOf(this.level, at.taxel);
      row('fields', of.map(([f, w]) => `${f}: ${w.toFixed(2)}`).join(', '));
      const heaviest = [...lit.members].sort((a, b) => b[1] - a[1]).slice(0, 12);
      if (lit.beyond.length > 0) row('of the body', levelName(this.level, this.patches) + lit.beyond.map(([p, members]) => `, ${members.length} taxels on ${this.patches[p].header.name}`).join(''));
      row(`field ${lit.field}`, `${lit.members.length} taxels: ` + heaviest.map(([t, w]) => `${patch.ids[t]}: ${w.toFixed(2)}`).join(', ') + (lit.members.length > 12 ? ', …' : ''));
    }
    if (this.paints.name === 'recording') {
      row(this.data.header.recording!.channel, `${figures(this.paints.values![at.patch][at.taxel])} ${this.data.header.recording!.unit}`);
    }
    box.append(list);
  }

  private legend(): void {
    const canvas = byId<HTMLCanvasElement>('legend'), c = canvas.getContext('2d')!, { width, height } = canvas;
    const says = byId('legend-text');
    c.clearRect(0, 0, width, height);
    says.replaceChildren();
    const p = this.paints;
    canvas.style.display = p.values ? '' : 'none';
    if (p.values) {
      const bins = new Float64Array(70);
      p.values.forEach((of, k) => of.forEach((x, place) => {
        if (place < this.patches[k].taxels && x === x) bins[Math.min(69, Math.max(0, Math.floor((70 * (x - p.lo)) / (p.hi - p.lo))))]++;
      }));
      // A root, so that few touched taxels show beside many that are not.
      const most = Math.sqrt(Math.max(1, ...bins));
      bins.forEach((n, k) => {
        c.fillStyle = `rgb(${mix(p.ramp, (k + 0.5) / 70).join()})`;
        const x = (k * width) / 70, high = (Math.sqrt(n) / most) * (height - 22);
        c.fillRect(x, height - 14, width / 70 + 1, 14);
        c.fillStyle = getComputedStyle(document.documentElement).getPropertyValue('--soft');
        c.fillRect(x, height - 18 - high, width / 70 - 1, high);
      });
      const unit = p.unit ? ` ${p.unit}` : '';
      says.append(text('span', `${figures(p.lo)}${unit}`), text('span', p.label), text('span', `${figures(p.hi)}${unit}`));
    } else if (p.categories) {
      p.categories.names.forEach((name, k) => {
        if (!name) return;
        const span = document.createElement('span'), swatch = text('span', '', 'swatch');
        swatch.style.background = `rgb(${(k === p.categories!.grey ? UNKNOWN : CATEGORIES[k % 12]).join()})`;
        span.append(swatch, name);
        says.append(span);
      });
    } else says.append(text('span', p.label));
  }

  private tree(): void {
    const { links } = this.data.header, root = byId('tree'), lists: HTMLElement[] = [];
    const used = new Set<number>();
    for (const p of this.patches) for (let at: number | null = p.header.link; at !== null; at = links[at].parent) used.add(at);
    links.forEach((link, k) => {
      lists.push(document.createElement('ul'));
      if (!used.has(k)) return;
      const item = text('li', '', 'of-link');
      item.append(text('span', link.name, 'link'), lists[k]);
      if (link.parent !== null) lists[link.parent].append(item);
      else { const list = document.createElement('ul'); list.append(item); root.append(list); }
    });
    this.patches.forEach((patch, k) => {
      const item = document.createElement('li'), label = document.createElement('label'), box = document.createElement('input');
      box.type = 'checkbox';
      box.checked = true;
      box.addEventListener('change', () => { this.view.show(k, box.checked); this.sayOptions(); this.invalidate(); });
      label.append(box, ` ${patch.header.name} `, text('small', `${patch.taxels}`));
      item.append(label);
      lists[patch.header.link].insertBefore(item, lists[patch.header.link].querySelector(':scope > .of-link'));
    });
    const total = (of: (p: Patch) => number): number => this.patches.reduce((sum, p) => sum + of(p), 0);
    byId('counts').textContent = `${this.patches.length} ${this.patches.length === 1 ? 'patch' : 'patches'}, ${total((p) => p.taxels)} taxels, ${total((p) => p.faces)} triangles, ${Math.max(...this.patches.map((p) => p.fields.length))} levels`;
  }

  // What is chosen

  private isInBox(patch: Patch, place: number): boolean {
    const { box } = this;
    return !!box && patch.header.link === box.link && [0, 1, 2].every((a) => {
      const x = patch.keys[0][3 * place + a];
      return x >= box.low[a] && x <= box.high[a];
    });
  }

  /** The box around the taxels of a link that are seen within a rectangle of a view, in its pixels. */
  private choose(isMap: boolean, left: number, top: number, right: number, bottom: number): void {
    const step = Math.max(2, (right - left) / 150, (bottom - top) / 150), found = new Set<string>();
    let link: number | null = null;
    const low = [Infinity, Infinity, Infinity], high = low.map((x) => -x);
    for (let y = top; y <= bottom; y += step) for (let x = left; x <= right; x += step) {
      const at = this.stage.taxelAt(isMap, x, y);
      if (!at || found.has(`${at.patch}:${at.taxel}`)) continue;
      const patch = this.patches[at.patch];
      link ??= patch.header.link;
      if (patch.header.link !== link) continue;
      found.add(`${at.patch}:${at.taxel}`);
      // Tenths of a millimetre outwards, so that the numbers are short.
      for (let a = 0; a < 3; a++) {
        const place = 1e4 * patch.keys[0][3 * at.taxel + a];
        low[a] = Math.min(low[a], Math.floor(place) / 1e4);
        high[a] = Math.max(high[a], Math.ceil(place) / 1e4);
      }
    }
    this.setBox(link === null ? null : { link, low, high });
  }

  private setBox(box: Box | null): void {
    this.box = box;
    this.isRelighting = true;
    this.sayOptions();
    this.invalidate();
  }

  /** The options of `dermatome build` that take what is chosen. */
  private sayOptions(): void {
    const word = (name: string): string => (/^[\w.+-]+$/.test(name) ? name : `'${name.replaceAll("'", "'\\''")}'`);
    const pattern = (name: string): string => word(name.replace(/[*?[]/g, '[$&]'));
    const shown = this.patches.filter((_, k) => this.view.isShown(k)), options: string[] = [];
    if (shown.length < this.patches.length) options.push(...shown.map((p) => `--patch ${pattern(p.header.name)}`));
    if (this.box) {
      const { link, low, high } = this.box, pose = this.patches.find((p) => p.header.link === link)!.pose;
      const isWorld = pose.equals(pose.clone().identity()), numbers = [...low, ...high].map((x) => `${+x.toFixed(4)}`).join();
      options.push(`--box ${isWorld ? '' : `${word(this.data.header.links[link].name)}:`}${numbers}`);
    }
    byId('options').hidden = options.length === 0;
    byId('options-text').textContent = options.join(' ');
  }

  private async copyOptions(): Promise<void> {
    const said = byId('options-text');
    // A page that is opened from a file may have no clipboard.
    if (navigator.clipboard) await navigator.clipboard.writeText(said.textContent ?? '');
    else { getSelection()!.selectAllChildren(said); document.execCommand('copy'); }
    byId('copy').textContent = 'copied';
    setTimeout(() => { byId('copy').textContent = 'copy'; }, 1200);
  }

  // Regions

  /** Begins a polygon, or gives it up. */
  private drawRegion(on: boolean): void {
    this.drawing = on ? { patch: 0, name: `region ${this.regions.length + 1}`, corners: [] } : null;
    if (on) byId('map').focus();
    this.sayRegions('');
  }

  /** Adds the corner at a pixel of the map; the first one again closes the polygon. */
  private addCorner(x: number, y: number): void {
    const { drawing } = this, at = this.view.mapAt(x, y);
    if (!drawing) return;
    if (drawing.corners.length === 0) drawing.patch = patchNear(this.patches, (k) => this.view.isShown(k), at) ?? 0;
    const [dx, dy] = this.patches[drawing.patch].header.offset, first = drawing.corners[0];
    const near = first && Math.hypot(first[0] + dx - at[0], first[1] + dy - at[1]) < 9 * this.view.metresPerPixel(true);
    if (near) { this.closeRegion(); return; }
    drawing.corners.push([at[0] - dx, at[1] - dy]);
    this.sayRegions('');
  }

  private closeRegion(): void {
    const { drawing } = this;
    if (!drawing) return;
    if (drawing.corners.length < 3) { this.sayRegions('A polygon has three corners or more.'); return; }
    if (crossesItself(drawing.corners)) { this.sayRegions('The polygon crosses itself: Backspace takes its last corner away.'); return; }
    this.regions.push(drawing);
    this.drawing = null;
    this.sayRegions('');
  }

  private sayRegions(wrong: string): void {
    const list = byId('regions'), { drawing } = this;
    list.replaceChildren();
    for (const region of this.regions) {
      const item = document.createElement('li'), name = document.createElement('input'), remove = text('button', '×') as HTMLButtonElement;
      name.value = region.name;
      name.setAttribute('aria-label', 'name of the region');
      name.addEventListener('input', () => { region.name = name.value; });
      remove.type = 'button';
      remove.setAttribute('aria-label', 'remove the region');
      remove.addEventListener('click', () => { this.regions.splice(this.regions.indexOf(region), 1); this.sayRegions(''); });
      const patch = this.patches[region.patch], count = taxelsIn(patch, region.corners);
      item.append(name, ' ', remove, text('small', ` ${patch.header.name}, ${count} ${count === 1 ? 'taxel' : 'taxels'}`));
      list.append(item);
    }
    byId('draw-region').textContent = drawing ? 'stop drawing' : 'draw a region';
    byId('save-regions').hidden = this.regions.length === 0;
    const says = drawing ? 'Click corners on the map; the first corner again, or Enter, closes the polygon. Backspace takes the last one away.' : '';
    byId('regions-text').textContent = wrong || says;
    this.invalidate();
  }

  private saveRegions(): void {
    const link = document.createElement('a');
    link.href = URL.createObjectURL(new Blob([toJson(this.patches, this.regions)], { type: 'application/json' }));
    link.download = 'regions.json';
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }

  // Steering

  setUnfold(x: number): void {
    this.view.unfold = Math.min(1, Math.max(0, x));
    byId<HTMLInputElement>('unfold').value = `${Math.round(1000 * this.view.unfold)}`;
    const u = this.view.unfold, says = u === 0 ? 'the skin in space' : u === 1 ? 'the map' : `${Math.round(100 * u)} % unfolded`;
    byId('unfold-text').textContent = says;
    byId<HTMLInputElement>('unfold').setAttribute('aria-valuetext', says);
    byId('skin-label').textContent = u > 0 ? says : this.landmarks ? this.data.header.title : 'skin';
    this.view.dropIds();
    if (this.landmarks) { this.landmarks.stage.view.unfold = u; this.landmarks.stage.view.dropIds(); }
    this.invalidate();
    this.keep();
  }

  setLevel(level: number): void {
    const { body } = this.data.header, own = this.patches[0]?.most ?? 1, most = own + body.length - 1;
    this.level = this.view.level = Math.min(most, Math.max(0, Math.round(level)));
    const count = this.level < own ? this.patches.reduce((sum, p) => sum + p.fieldsAt(this.level).vertices, 0) : body[this.level - own];
    const says = `${levelName(this.level, this.patches)}: ${count} ${this.level === 0 ? 'taxels' : count === 1 ? 'field' : 'fields'}`;
    const slider = byId<HTMLInputElement>('level');
    slider.max = `${most}`;
    slider.value = `${this.level}`;
    slider.setAttribute('aria-valuetext', says);
    byId('level-text').textContent = says;
    if (this.paints.name === 'field') this.setPaint('field'); else { this.isRecolouring = this.isRelighting = true; this.invalidate(); }
    if (this.paints.name === 'recording') this.setFrame(this.frame);
    this.keep();
  }

  setPaint(name: string): void {
    const recording = this.data.header.recording;
    this.paints = name === 'recording' && recording
      ? recordingPaint(recording.channel, recording.unit, untouched(recording), recording.hi, this.patches)
      : paint(name, this.patches, this.level, this.data.header.regions, this.data.header.modalities);
    byId<HTMLSelectElement>('colour').value = name;
    if (name === 'recording') this.setFrame(this.frame);
    this.isRecolouring = this.isRelighting = true;
    this.legend();
    this.invalidate();
    this.keep();
  }

  private readRecording(): void {
    const { recording } = this.data.header;
    this.readings = recording!.values.map((index) => this.data.array(index).numbers as Uint8Array);
    this.contacts = recording!.times.map(() => []);
    for (const contact of recording!.contacts) this.contacts[contact[0]].push(contact);
    this.parts = recording!.times.map(() => []);
    for (const part of recording!.parts ?? []) this.parts[part[0]].push(part);
    const pick = (event: EventRow): void => { this.play(false); this.setFrame(Math.round((event.first + event.last) / 2)); this.keep(); };
    this.events = new EventStrip(this.data.header, byId('events'), byId('event-text'), pick, () => this.invalidate());
  }

  /** Shows frames that the server sends. */
  private listen(recording: RecordingHeader): void {
    this.events = new EventStrip(this.data.header, byId('events'), byId('event-text'), () => {}, () => this.invalidate());
    listen((frame) => this.showLive(recording, frame), (events) => {
      addEvents(recording, events);
      this.events!.update();
      document.documentElement.dataset.live = 'ended';
      byId('frame-text').textContent += ', ended';
    });
    byId('play').hidden = true;
    byId('frame').hidden = true;
  }

  private live: Float32Array | null = null;

  private showLive(recording: RecordingHeader, frame: LiveFrame): void {
    this.live = append(recording, frame);
    this.contacts = recording.times.map(() => []);
    this.contacts[recording.times.length - 1] = frame.contacts;
    this.parts = [];
    this.parts[recording.times.length - 1] = frame.parts ?? [];
    this.events!.update();
    this.paints.lo = this.paints.name === 'recording' ? untouched(recording) : this.paints.lo;
    if (this.paints.name === 'recording' && this.paints.hi !== recording.hi) { this.paints.hi = recording.hi; this.legend(); }
    this.setFrame(recording.times.length - 1);
    if (frame.dropped > 0) byId('frame-text').textContent += `, ${frame.dropped} frames skipped`;
    document.documentElement.dataset.frames = `${+(document.documentElement.dataset.frames ?? 0) + 1}`;
  }

  setFrame(frame: number): void {
    const { recording } = this.data.header;
    if (!recording || recording.times.length === 0) return;
    const count = recording.times.length;
    this.frame = Math.min(count - 1, Math.max(0, Math.round(frame)));
    if (this.paints.name === 'recording') {
      const step = (recording.hi - recording.lo) / 254;
      const read: Float32Array[] = [];
      let first = 0;
      this.patches.forEach((patch, k) => {
        const of = this.readings[k];
        const taxels = this.live ? this.live.subarray(first, first + patch.taxels) : new Float32Array(patch.taxels);
        first += patch.taxels;
        if (!this.live) for (let t = 0; t < patch.taxels; t++) { const x = of[this.frame * patch.taxels + t]; taxels[t] = x === 0 ? NaN : recording.lo + (x - 1) * step; }
        read.push(taxels);
      });
      const shown = this.blurred(read, recording.is_amount);
      this.patches.forEach((patch, k) => {
        const values = this.paints.values![k];
        for (let p = 0; p < patch.places; p++) values[p] = shown[k][patch.taxelOf[p]];
      });
      this.isRecolouring = this.isRelighting = true;
      if (!this.playing && !this.live) this.legend();
    }
    const time = recording.times[this.frame], now = this.contacts[this.frame]?.filter((c) => c[EVENT] !== RELEASE) ?? [];
    const force = recording.force ? `, ${figures(now.reduce((sum, c) => sum + (c[FORCE] ?? 0), 0))} N` : '';
    byId('frame-text').textContent = `${time.toFixed(2)} s${now.length ? `, ${now.length} contact${now.length > 1 ? 's' : ''} (${now.reduce((n, c) => n + c[TAXELS], 0)} taxels)${force}` : ''}`;
    byId<HTMLInputElement>('frame').value = `${this.frame}`;
    this.happening = this.events?.at(this.frame) ?? [];
    document.documentElement.dataset.events = this.happening.map((event) => event.word).join();
    this.curve();
    this.invalidate();
  }

  /** What the fields of the level know of readings, on the taxels of each patch: fields have the mean or the sum of theirs. */
  private blurred(read: Float32Array[], isAmount: boolean): Float32Array[] {
    const fields = this.patches.map((patch) => patch.fieldsAt(this.level));
    const blank = (vertices: number): [Float32Array, Float32Array] => [new Float32Array(vertices), new Float32Array(vertices)];
    // Fields of the body are those of all patches.
    const body = this.level < (this.patches[0]?.most ?? 0) ? null : blank(fields[0].vertices);
    const sums = fields.map(({ vertices }) => body ?? blank(vertices));
    this.patches.forEach((patch, k) => {
      const { indices, weights } = fields[k], [sum, area] = sums[k], n = patch.taxels;
      if (weights) for (let c = 0; c < 3; c++) for (let t = 0; t < n; t++) {
        const w = weights[c * n + t], x = read[k][t];
        if (w === 0 || x !== x) continue;
        const f = indices![c * n + t], a = w * patch.areas[t];
        // An amount is shown per taxel, so that one scale serves all levels.
        sum[f] += isAmount ? w * x : a * x;
        area[f] += isAmount ? w : a;
      }
    });
    return this.patches.map((patch, k) => {
      const { indices, weights } = fields[k], [sum, area] = sums[k], n = patch.taxels;
      if (!weights) return read[k];
      const out = new Float32Array(n);
      for (let c = 0; c < 3; c++) for (let t = 0; t < n; t++) { const w = weights[c * n + t]; if (w > 0) { const f = indices![c * n + t]; out[t] += area[f] > 0 ? (w * sum[f]) / area[f] : NaN; } }
      return out;
    });
  }

  /** The sums of all frames, drawn once, and what they were drawn for. */
  private readonly sums = document.createElement('canvas');
  private sumsOf = '';

  private curve(): void {
    const canvas = byId<HTMLCanvasElement>('curve'), { totals, times } = this.data.header.recording!;
    const width = Math.max(2, canvas.clientWidth), height = 28, theme = document.documentElement.dataset.theme;
    const style = getComputedStyle(document.documentElement), key = [width, theme, times.length, times[0]].join();
    if (key !== this.sumsOf) {
      this.sumsOf = key;
      const least = totals.reduce((a, x) => Math.min(a, x), Infinity), most = totals.reduce((a, x) => Math.max(a, x - least), 1e-30);
      [this.sums.width, this.sums.height] = [canvas.width, canvas.height] = [width, height];
      const c = this.sums.getContext('2d')!;
      c.fillStyle = style.getPropertyValue('--line');
      c.beginPath(); c.moveTo(0, height);
      totals.forEach((x, k) => c.lineTo((k / Math.max(1, times.length - 1)) * width, height - ((x - least) / most) * (height - 2)));
      c.lineTo(width, height); c.fill();
    }
    const c = canvas.getContext('2d')!;
    c.clearRect(0, 0, width, height);
    c.drawImage(this.sums, 0, 0);
    c.fillStyle = style.getPropertyValue('--accent');
    c.fillRect((this.frame / Math.max(1, times.length - 1)) * (width - 2), 0, 2, height);
  }

  private play(on: boolean): void {
    const { recording } = this.data.header;
    if (!recording || recording.times.length < 2) return;
    const { times, cuts } = recording;
    this.playing = on;
    byId('play').textContent = on ? '❚❚' : '▶';
    byId('play').setAttribute('aria-label', on ? 'pause' : 'play');
    if (!on) { this.legend(); this.keep(); return; }
    if (this.frame >= times.length - 1) this.frame = 0;
    this.started = [performance.now(), times[this.frame]];
    const next = (): void => {
      if (!this.playing) return;
      const now = performance.now(), at = this.started[1] + (now - this.started[0]) / 1000;
      let frame = this.frame;
      while (frame < times.length - 1 && !cuts.includes(frame + 1) && times[frame + 1] <= at) frame++;
      // A pause is not waited for, and after times that go back no frame is skipped: the clock is set anew.
      if (frame === this.frame && cuts.includes(frame + 1)) this.started = [now, times[++frame]];
      if (frame !== this.frame) this.setFrame(frame);
      if (frame >= times.length - 1) this.play(false); else requestAnimationFrame(next);
    };
    requestAnimationFrame(next);
  }

  private animation = 0;
  private toggleUnfold(): void {
    const from = this.view.unfold, to = from < 0.5 ? 1 : 0;
    cancelAnimationFrame(this.animation);
    if (matchMedia('(prefers-reduced-motion: reduce)').matches) { this.setUnfold(to); return; }
    const start = performance.now();
    const step = (): void => {
      const t = Math.min(1, (performance.now() - start) / 2600);
      this.setUnfold(from + (to - from) * t);
      if (t < 1) this.animation = requestAnimationFrame(step);
    };
    step();
  }

  private hover(at: Taxel | null): void {
    if (at?.patch === this.hovered?.patch && at?.taxel === this.hovered?.taxel) return;
    this.hovered = at;
    this.landmarks?.hover(at);
    this.isRelighting = true;
    this.invalidate();
  }

  private pin(at: Taxel | null): void {
    this.pinned = at;
    this.isRelighting = true;
    this.invalidate();
    this.keep();
  }

  /** From the kept taxel to its neighbour in a direction of the map. */
  private walk(dx: number, dy: number): void {
    if (!this.pinned) return;
    const patch = this.patches[this.pinned.patch], from = this.pinned.taxel, s = patch.sheet;
    let best = -1, most = 0.3;
    for (let e = 0; e < patch.edges.length; e += 2) for (const [a, b] of [[patch.edges[e], patch.edges[e + 1]], [patch.edges[e + 1], patch.edges[e]]]) {
      if (patch.taxelOf[a] !== from) continue;
      const x = s[2 * b] - s[2 * a], y = s[2 * b + 1] - s[2 * a + 1], along = (x * dx + y * dy) / (Math.hypot(x, y) || 1);
      if (along > most) { most = along; best = patch.taxelOf[b]; }
    }
    if (best >= 0) { this.hovered = null; this.pin({ patch: this.pinned.patch, taxel: best }); }
  }

  private controls(): void {
    const { recording } = this.data.header;
    const select = byId<HTMLSelectElement>('colour');
    for (const [name, label] of paintNames(this.patches, recording ? `${recording.channel}${recording.unit ? ` (${recording.unit})` : ''}` : null, this.data.header.regions.length > 0, this.data.header.modalities.length > 0)) {
      const option = text('option', label) as HTMLOptionElement;
      option.value = name;
      select.append(option);
    }
    select.addEventListener('change', () => this.setPaint(select.value));
    byId<HTMLInputElement>('unfold').addEventListener('input', (e) => this.setUnfold(+(e.target as HTMLInputElement).value / 1000));
    byId<HTMLInputElement>('level').addEventListener('input', (e) => this.setLevel(+(e.target as HTMLInputElement).value));
    if (recording) {
      byId('time').hidden = false;
      const slider = byId<HTMLInputElement>('frame');
      slider.max = `${recording.times.length - 1}`;
      slider.addEventListener('input', () => { this.play(false); this.setFrame(+slider.value); this.keep(); });
      byId('play').addEventListener('click', () => this.play(!this.playing));
    }
    byId('theme').addEventListener('click', () => this.setTheme(document.documentElement.dataset.theme === 'dark' ? 'light' : 'dark'));
    byId('copy').addEventListener('click', () => void this.copyOptions());
    byId('draw-region').addEventListener('click', () => this.drawRegion(!this.drawing));
    byId('save-regions').addEventListener('click', () => this.saveRegions());
    byId('help-button').addEventListener('click', () => byId<HTMLDialogElement>('help').showModal());
    this.stage.steer({
      hover: (at) => this.hover(at),
      click: (isMap, x, y) => { if (isMap && this.drawing) this.addCorner(x, y); else if (this.landmarks) this.landmarks.clickOwn(isMap, x, y); else this.pin(this.stage.taxelAt(isMap, x, y)); },
      choose: (isMap, rectangle) => this.choose(isMap, ...rectangle),
      drawFrame: (rectangle) => { this.frameDrawn = rectangle; this.invalidate(); },
      moved: () => this.invalidate(),
      kept: () => this.keep(),
    });
    addEventListener('keydown', (e) => this.key(e));
    addEventListener('beforeprint', () => this.print());
  }

  private key(e: KeyboardEvent): void {
    const target = e.target as HTMLElement, isField = ['INPUT', 'BUTTON'].includes(target.tagName);
    if (e.ctrlKey || e.metaKey || e.altKey) return;
    // Keys are the field's while one types, and letters choose in a list.
    if (target.matches('input:not([type="range"], [type="checkbox"]), select, textarea')) return;
    const arrows: Record<string, [number, number]> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    if (e.key in arrows && target.classList.contains('view')) this.walk(...arrows[e.key]);
    else if (e.key === 'u') this.toggleUnfold();
    else if (e.key === '+' || e.key === '=') this.setLevel(this.level - 1);
    else if (e.key === '-') this.setLevel(this.level + 1);
    else if (e.key === ' ' && !isField) this.play(!this.playing);
    else if (!this.live && (e.key === 'e' || e.key === 'E')) { const frame = this.events?.next(this.frame, e.key === 'E'); if (frame != null) { this.play(false); this.setFrame(frame); this.keep(); } }
    else if (e.key === 'f' || e.key === 'r') { this.view.reset(); this.landmarks?.stage.view.reset(); this.invalidate(); this.keep(); }
    else if (e.key === 'Enter' && this.drawing && !isField) this.closeRegion();
    else if (e.key === 'Backspace' && this.drawing && !isField) { this.drawing.corners.pop(); this.sayRegions(''); }
    else if (!isField && this.landmarks?.key(e.key)) this.invalidate();
    else if (e.key === 'Escape') { if (this.drawing) this.drawRegion(false); this.hovered = null; this.setBox(null); this.pin(null); }
    else if (e.key === '?') byId<HTMLDialogElement>('help').showModal();
    else return;
    e.preventDefault();
  }

  private setTheme(theme: string): void {
    document.documentElement.dataset.theme = theme;
    const isDark = theme === 'dark';
    for (const { view } of [this.stage, ...(this.landmarks ? [this.landmarks.stage] : [])]) view.setTheme({ background: isDark ? '#1b1f26' : '#ffffff', ink: isDark ? [0.02, 0.03, 0.05] : [0.1, 0.12, 0.17], accent: isDark ? '#ff4f8f' : '#d4266a' });
    this.legend();
    if (this.data.header.recording) this.curve();
    this.invalidate();
  }

  /** The print shows what the screen shows. */
  private print(): void {
    const image = new Image();
    image.alt = 'skin and map';
    image.src = this.view.image();
    byId('picture').replaceChildren(image);
    byId<HTMLDetailsElement>('numbers').open = true;
  }

  // The state in the address

  private timer = 0;
  private keep(): void {
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => {
      const { skinEye: s, mapEye: m } = this.view, round = (x: number): number => +x.toPrecision(4);
      const state: Record<string, string> = {
        unfold: `${round(this.view.unfold)}`, level: `${this.level}`, colour: this.paints.name, frame: `${this.frame}`,
        taxel: this.pinned ? `${this.pinned.patch}:${this.pinned.taxel}` : '',
        skin: [s.azimuth, s.elevation, s.x, s.y, s.zoom].map(round).join(), map: [m.x, m.y, m.zoom].map(round).join(),
      };
      history.replaceState(null, '', `#${new URLSearchParams(state)}`);
    }, 250);
  }

  private restore(): void {
    const state = new URLSearchParams(location.hash.slice(1));
    const numbers = (name: string, count: number): number[] | null => {
      const found = (state.get(name) ?? '').split(',').map(Number);
      return state.has(name) && found.length === count && found.every(Number.isFinite) ? found : null;
    };
    const [skin, map] = [numbers('skin', 5), numbers('map', 3)];
    if (skin) [this.view.skinEye.azimuth, this.view.skinEye.elevation, this.view.skinEye.x, this.view.skinEye.y] = skin;
    if (skin && skin[4] > 0) this.view.skinEye.zoom = skin[4];
    if (map) [this.view.mapEye.x, this.view.mapEye.y] = map;
    if (map && map[2] > 0) this.view.mapEye.zoom = map[2];
    const names = [...byId<HTMLSelectElement>('colour').options].map((o) => o.value), wanted = state.get('colour') ?? '';
    // All patches have this level.
    const common = Math.min(...this.patches.map((p) => p.fields.length)) - 1;
    this.setLevel(numbers('level', 1)?.[0] ?? (this.data.header.recording || this.landmarks ? 0 : Math.min(2, common)));
    this.setPaint(names.includes(wanted) ? wanted : this.data.header.recording ? 'recording' : this.landmarks ? (this.data.header.regions.length > 0 ? 'region' : 'plain') : common > 0 ? 'field' : 'angle');
    this.setFrame(numbers('frame', 1)?.[0] ?? this.firstTouch());
    this.setUnfold(numbers('unfold', 1)?.[0] ?? 0);
    const [patch, taxel] = (state.get('taxel') ?? '').split(':').map(Number);
    if (state.get('taxel') && this.patches[patch] && Number.isInteger(taxel) && taxel >= 0 && taxel < this.patches[patch].taxels) this.pin({ patch, taxel });
  }

  /** The frame with most touch: a recording mostly begins with none. */
  private firstTouch(): number {
    const totals = this.data.header.recording?.totals ?? [];
    return totals.reduce((best, x, k) => (x > totals[best] ? k : best), 0);
  }
}

/** The value of the pale end: zero, where readings are about it, or the least of raw counts. */
function untouched({ lo, hi }: RecordingHeader): number { return hi > 0 && lo < 0.5 * hi ? 0 : lo; }

function explain(message: string): void {
  document.body.classList.add('flat');
  const box = byId('message');
  box.hidden = false;
  box.textContent = message;
  byId<HTMLDetailsElement>('numbers').open = true;
  document.documentElement.dataset.ready = 'flat';
}

async function start(): Promise<void> {
  if (!document.createElement('canvas').getContext('webgl2')) {
    explain('This browser shows no WebGL 2: here are the map and its numbers.');
    return;
  }
  try {
    const data = await load(byId('data'));
    const page = new Page(data);
    (window as unknown as { dermatome: Page }).dermatome = page;
  } catch (error) {
    explain(`The views cannot be shown: ${error instanceof Error ? error.message : error}`);
    console.error(error);
  }
}

void start();
