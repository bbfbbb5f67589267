// The two views of one skin: which taxel is under the pointer, how they turn and move, and what is drawn over them.

import type { Data, SkinHeader } from './data';
import { Grid, nearest } from './grid';
import { Patch } from './patch';
import { View, type Rect } from './view';

export interface Taxel { patch: number; taxel: number }
type Rectangle = [number, number, number, number];

/** What the pointer does, in pixels of a view; a frame that is drawn is in pixels of the stage. */
export interface Steering {
  hover(at: Taxel | null): void;
  click(isMap: boolean, x: number, y: number): void;
  /** A rectangle was drawn with Ctrl. */
  choose?(isMap: boolean, rectangle: Rectangle): void;
  drawFrame?(rectangle: Rectangle | null): void;
  /** The views have another eye, and then keep it. */
  moved(): void;
  kept(): void;
}

export class Stage {
  readonly box: HTMLElement;
  readonly patches: Patch[];
  readonly view: View;
  /** Width and height of the sheet on which the maps of all patches lie, in m. */
  readonly sheet: [number, number];
  private readonly overlay: HTMLCanvasElement;
  private readonly boxes: [HTMLElement, HTMLElement];
  private gridMade: Grid | null = null;

  /** The views of these patches in the elements whose ids begin so. */
  constructor(data: Data, skin: SkinHeader, prefix: string) {
    const byId = <T extends HTMLElement>(id: string): T => document.getElementById(prefix + id) as T;
    this.box = byId('stage');
    this.overlay = byId('overlay');
    this.boxes = [byId('skin'), byId('map')];
    this.patches = skin.patches.map((patch) => new Patch(data, patch, skin.body));
    Patch.join(this.patches);
    this.sheet = [0, 1].map((a) => this.patches.reduce((most, p) => {
      for (let k = a; k < p.sheet.length; k += 2) if (p.sheet[k] > most) most = p.sheet[k];
      return most;
    }, 1e-9)) as [number, number];
    this.view = new View(byId<HTMLCanvasElement>('canvas'), this.patches, this.sheet);
  }

  get grid(): Grid { return (this.gridMade ??= new Grid(this.patches, this.sheet)); }

  resize(): void {
    const box = this.box.getBoundingClientRect();
    const [skin, map] = this.boxes.map((view): Rect => {
      const r = view.getBoundingClientRect();
      return { x: r.left - box.left, y: r.top - box.top, width: r.width, height: r.height };
    });
    Object.assign(this.view, { skin, map });
    const ratio = Math.min(2, devicePixelRatio || 1);
    this.view.resize(box.width, box.height, ratio);
    this.overlay.width = box.width * ratio;
    this.overlay.height = box.height * ratio;
  }

  /** What is drawn over the views, without what was. */
  cleared(): CanvasRenderingContext2D {
    const c = this.overlay.getContext('2d')!, ratio = this.overlay.width / Math.max(1, this.overlay.clientWidth);
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, this.overlay.width, this.overlay.height);
    return c;
  }

  inside(isMap: boolean, x: number, y: number): boolean {
    const r = isMap ? this.view.map : this.view.skin;
    return x >= r.x && y >= r.y && x <= r.x + r.width && y <= r.y + r.height;
  }

  /** The pixels of a taxel in both views, each with whether it faces the viewer. */
  pixelsOf({ patch, taxel }: Taxel): { isMap: boolean; x: number; y: number; faces: boolean }[] {
    if (!this.view.isShown(patch)) return [];
    return [false, true].flatMap((isMap) => this.patches[patch].placesOf(taxel).map((place) => {
      const [x, y] = this.view.toPixels(isMap, patch, [[place, 1]]);
      return { isMap, x, y, faces: isMap || this.view.faces(patch, this.patches[patch].frame(taxel)[1]) };
    })).filter(({ isMap, x, y }) => this.inside(isMap, x, y));
  }

  /** Circles around a taxel in both views, in these widths and colours. */
  ring(c: CanvasRenderingContext2D, at: Taxel, strokes: [number, string][], radius = 8): void {
    for (const { x, y } of this.pixelsOf(at)) for (const [width, stroke] of strokes) {
      c.beginPath(); c.arc(x, y, radius, 0, 7); c.lineWidth = width; c.strokeStyle = stroke; c.stroke();
    }
  }

  scaleBar(c: CanvasRenderingContext2D, ink: string): void {
    const metres = this.view.metresPerPixel(true), { x, y, width, height } = this.view.map;
    const longest = metres * Math.min(160, 0.4 * width), power = 10 ** Math.floor(Math.log10(longest));
    const length = power * [5, 2, 1].find((k) => k * power <= longest)!;
    const px = length / metres, right = x + width - 14, at = y + height - 14;
    c.strokeStyle = c.fillStyle = ink; c.lineWidth = 1.5;
    c.beginPath(); c.moveTo(right - px, at - 4); c.lineTo(right - px, at); c.lineTo(right, at); c.lineTo(right, at - 4); c.stroke();
    c.font = '12px system-ui, "DejaVu Sans", sans-serif'; c.textAlign = 'right';
    c.fillText(`${+(1000 * length).toPrecision(3)} mm`, right, at - 8);
  }

  /** The taxel under a pixel of a view. */
  taxelAt(isMap: boolean, x: number, y: number): Taxel | null {
    const on = isMap ? this.view.mapAt(x, y) : this.view.sheetAt(x, y);
    if (!on) return null;
    let at = this.grid.find(on[0], on[1], isMap ? 1e-4 : 0.02);
    if (!at && isMap) {
      const m = this.view.metresPerPixel(true);
      for (const [dx, dy] of [[3, 0], [-3, 0], [0, 3], [0, -3]]) at ??= this.grid.find(on[0] + dx * m, on[1] + dy * m);
    }
    if (!at || !this.view.isShown(at.patch)) return null;
    const patch = this.patches[at.patch];
    return { patch: at.patch, taxel: patch.taxelOf[nearest(patch, at)] };
  }

  /** Follows the pointer in both views. */
  steer(steering: Steering): void {
    this.boxes.forEach((box, k) => this.pointers(box, k === 1, steering));
  }

  private pointers(box: HTMLElement, isMap: boolean, steering: Steering): void {
    const eye = isMap ? this.view.mapEye : this.view.skinEye, down = new Map<number, [number, number]>();
    let moved = 0, corner: [number, number] | null = null;
    const local = (e: MouseEvent): [number, number] => { const r = box.getBoundingClientRect(); return [e.clientX - r.left, e.clientY - r.top]; };
    const zoom = (factor: number, [x, y]: [number, number]): void => {
      const r = isMap ? this.view.map : this.view.skin, before = this.view.metresPerPixel(isMap);
      eye.zoom = Math.min(200, Math.max(0.2, eye.zoom * factor));
      const less = before - this.view.metresPerPixel(isMap);
      eye.x += (x - r.width / 2) * less;
      eye.y -= (y - r.height / 2) * less;
      this.view.dropIds();
      steering.moved();
    };
    box.addEventListener('wheel', (e) => { e.preventDefault(); zoom(Math.exp(-0.0015 * e.deltaY), local(e)); }, { passive: false });
    /** The rectangle from where the drag began, in pixels of the view. */
    const rectangle = ([x, y]: [number, number]): Rectangle =>
      [Math.min(x, corner![0]), Math.min(y, corner![1]), Math.max(x, corner![0]), Math.max(y, corner![1])];
    box.addEventListener('pointerdown', (e) => {
      box.setPointerCapture(e.pointerId);
      down.set(e.pointerId, local(e));
      moved = 0;
      if (steering.choose && (e.ctrlKey || e.metaKey)) corner = local(e);
    });
    box.addEventListener('pointermove', (e) => {
      const at = local(e), before = down.get(e.pointerId);
      if (corner) {
        const r = isMap ? this.view.map : this.view.skin, [left, top, right, bottom] = rectangle(at);
        steering.drawFrame?.([r.x + left, r.y + top, r.x + right, r.y + bottom]);
        return;
      }
      if (!before) { if (e.pointerType !== 'touch') steering.hover(this.taxelAt(isMap, ...at)); return; }
      const [dx, dy] = [at[0] - before[0], at[1] - before[1]];
      moved += Math.abs(dx) + Math.abs(dy);
      if (down.size === 2) {
        const other = [...down].find(([id]) => id !== e.pointerId)![1];
        zoom(Math.hypot(at[0] - other[0], at[1] - other[1]) / Math.max(1, Math.hypot(before[0] - other[0], before[1] - other[1])), other);
      } else if (isMap || e.shiftKey || e.buttons === 2) {
        const m = this.view.metresPerPixel(isMap);
        eye.x -= dx * m; eye.y += dy * m;
      } else {
        eye.azimuth -= 0.009 * dx;
        eye.elevation = Math.min(1.57, Math.max(-1.57, eye.elevation + 0.009 * dy));
      }
      down.set(e.pointerId, at);
      this.view.dropIds();
      steering.moved();
    });
    const up = (e: PointerEvent): void => {
      if (corner) {
        down.delete(e.pointerId);
        if (e.type === 'pointerup') steering.choose?.(isMap, rectangle(local(e)));
        corner = null;
        steering.drawFrame?.(null);
        return;
      }
      if (down.delete(e.pointerId) && e.type === 'pointerup' && moved < 5) steering.click(isMap, ...local(e));
      else steering.kept();
    };
    box.addEventListener('pointerup', up);
    box.addEventListener('pointercancel', up);
    box.addEventListener('pointerleave', () => steering.hover(null));
    box.addEventListener('contextmenu', (e) => e.preventDefault());
  }
}
