// What the colours of the taxels say, with a scale and a legend in units.

import type { Patch } from './patch';

export type Rgb = [number, number, number];

/** A light low end: black lines and dots stay visible everywhere. */
const SEQUENTIAL: Rgb[] = [[246, 239, 214], [247, 201, 128], [238, 140, 92], [199, 76, 94], [125, 40, 104], [58, 22, 80]];
const DIVERGING: Rgb[] = [[33, 102, 172], [103, 169, 207], [209, 229, 240], [247, 247, 247], [253, 219, 199], [239, 138, 98], [178, 24, 43]];
/** Touch: the untouched skin is pale. */
const TOUCH: Rgb[] = [[226, 231, 238], [250, 205, 120], [243, 140, 60], [208, 52, 44], [120, 10, 40]];
/** Twelve pale colours that are told apart. */
export const CATEGORIES: Rgb[] = [
  [141, 188, 224], [247, 186, 120], [150, 208, 150], [236, 150, 150], [192, 170, 221], [204, 176, 160],
  [240, 176, 216], [214, 214, 130], [140, 212, 216], [176, 196, 222], [252, 216, 150], [176, 220, 176],
];
export const UNKNOWN: Rgb = [150, 152, 156];

export interface Paint {
  name: string;
  label: string;
  unit: string;
  values: Float32Array[] | null;
  /** `grey` is the category that has no colour. */
  categories: { of: ArrayLike<number>[]; names: string[]; grey: number } | null;
  ramp: Rgb[];
  lo: number;
  hi: number;
}

export function mix(ramp: Rgb[], x: number): Rgb {
  if (!(x === x)) return UNKNOWN;
  const at = Math.min(Math.max(x, 0), 1) * (ramp.length - 1);
  const k = Math.min(Math.floor(at), ramp.length - 2);
  return [0, 1, 2].map((c) => Math.round(ramp[k][c] + (at - k) * (ramp[k + 1][c] - ramp[k][c]))) as Rgb;
}

/** `level 2`, and above the levels of the patches `body.L0`. */
export function levelName(level: number, patches: Patch[]): string {
  const most = patches[0]?.most ?? 0;
  return level < most ? `level ${level}` : `body.L${level - most}`;
}

/** All that can be shown of these patches; `level` numbers the fields. */
export function paintNames(patches: Patch[], recording: string | null, hasRegions: boolean, hasModalities: boolean): [string, string][] {
  const names: [string, string][] = [];
  if (recording !== null) names.push(['recording', recording]);
  names.push(['field', 'receptive field'], ['angle', 'angle distortion s1/s2'], ['area', 'area on the map / on the skin'], ['receptive', 'receptive area']);
  for (const { name } of patches.flatMap((p) => p.values)) if (!names.some(([n]) => n === name)) names.push([name, name]);
  if (hasRegions) names.push(['region', 'region']);
  if (hasModalities) names.push(['modality', 'modality']);
  names.push(['presence', 'presence'], ['patch', 'patch'], ['plain', 'none']);
  return names;
}

export function paint(name: string, patches: Patch[], level: number, regions: string[], modalities: string[]): Paint {
  const none = { name, unit: '', values: null, categories: null, ramp: SEQUENTIAL, lo: 0, hi: 1 };
  const scale = (label: string, unit: string, values: Float32Array[], ramp = SEQUENTIAL): Paint => {
    const [lo, hi] = limits(values);
    return { ...none, label, unit, values, ramp, lo, hi };
  };
  switch (name) {
    case 'plain': return { ...none, label: '' };
    case 'patch': {
      const names = patches.map((p) => p.header.name);
      return { ...none, label: 'patch', categories: { of: patches.map((p, k) => new Uint8Array(p.places).fill(k % 12)), names, grey: -1 } };
    }
    case 'region':
      return { ...none, label: 'region', categories: { of: patches.map((p) => Uint16Array.from(p.taxelOf, (t) => p.region[t])), names: ['no region', ...regions], grey: 0 } };
    case 'modality':
      return { ...none, label: 'modality', categories: { of: patches.map((p) => Uint8Array.from(p.taxelOf, (t) => p.senses[t])), names: ['touch', ...modalities], grey: -1 } };
    case 'presence':
      return { ...none, label: 'presence', categories: { of: patches.map((p) => Uint8Array.from(p.taxelOf, (t) => [3, 0, 1, 2][p.presence[t]])), names: ['present', 'thermal pad', 'other sensor', 'absent'], grey: 3 } };
    case 'field': return { ...none, label: level === 0 ? 'at level 0 every taxel is its own field' : `receptive fields of ${levelName(level, patches)}` };
    case 'angle': return { ...scale('angle distortion s1/s2', '', patches.map((p) => p.byPlace(([a, b]) => Math.min(100, Math.abs(a / b))))), lo: 1 };
    case 'area': {
      const values = patches.map((p) => p.byPlace(([a, b]) => a * Math.abs(b)));
      const [lo, hi] = limits(values);
      const far = Math.max(hi - 1, 1 - lo, 0.01);
      return { ...none, label: 'area on the map / on the skin', values, ramp: DIVERGING, lo: 1 - far, hi: 1 + far };
    }
    case 'receptive': return scale('receptive area', 'mm²', patches.map((p) => Float32Array.from(p.taxelOf, (t) => 1e6 * p.areas[t])));
    default: {
      const unit = patches.flatMap((p) => p.values).find((v) => v.name === name)?.unit ?? '';
      return scale(name, unit, patches.map((p) => {
        const of = p.values.find((v) => v.name === name)?.of;
        return Float32Array.from(p.taxelOf, (t) => (of ? of[t] : NaN));
      }));
    }
  }
}

export function recordingPaint(label: string, unit: string, lo: number, hi: number, patches: Patch[]): Paint {
  return { name: 'recording', label, unit, values: patches.map((p) => new Float32Array(p.places)), categories: null, ramp: TOUCH, lo, hi };
}

/** Colours of the places of a patch, by a paint. */
export function colour(paint: Paint, patch: Patch, index: number, level: number, out: Uint8Array): void {
  const set = (place: number, rgb: Rgb): void => { for (let c = 0; c < 3; c++) out[4 * place + c] = rgb[c]; };
  if (paint.values) {
    const values = paint.values[index];
    const table = Array.from({ length: 256 }, (_, k) => mix(paint.ramp, k / 255));
    const scale = 255 / Math.max(paint.hi - paint.lo, 1e-30);
    for (let k = 0; k < patch.places; k++) {
      const x = values[k];
      set(k, x === x ? table[Math.min(255, Math.max(0, Math.round((x - paint.lo) * scale)))] : UNKNOWN);
    }
  } else if (paint.categories) {
    for (let k = 0; k < patch.places; k++) set(k, paint.categories.of[index][k] === paint.categories.grey ? UNKNOWN : CATEGORIES[paint.categories.of[index][k] % 12]);
  } else if (paint.name === 'field' && patch.fieldsAt(level).weights) {
    const shades = patch.shades(level);
    const { indices, weights } = patch.fieldsAt(level);
    for (let k = 0; k < patch.places; k++) {
      const t = patch.taxelOf[k];
      const rgb: Rgb = [0, 0, 0];
      // Cubes keep the fields apart, and still show where they overlap.
      const cubes = [0, 1, 2].map((c) => weights![c * patch.taxels + t] ** 3), sum = cubes[0] + cubes[1] + cubes[2];
      cubes.forEach((w, c) => {
        if (w > 0) for (let a = 0; a < 3; a++) rgb[a] += (w / sum) * CATEGORIES[shades[indices![c * patch.taxels + t]]][a];
      });
      set(k, rgb);
    }
  } else {
    for (let k = 0; k < patch.places; k++) set(k, patch.presence[patch.taxelOf[k]] === 1 ? [205, 215, 227] : UNKNOWN);
  }
}

/** All but a hundredth at either end. */
function limits(values: Float32Array[]): [number, number] {
  const all: number[] = [];
  const total = values.reduce((sum, v) => sum + v.length, 0);
  const step = Math.max(1, Math.floor(total / 20000));
  for (const v of values) for (let k = 0; k < v.length; k += step) if (Number.isFinite(v[k])) all.push(v[k]);
  all.sort((a, b) => a - b);
  if (all.length === 0) return [0, 1];
  const lo = all[Math.floor(0.005 * (all.length - 1))], hi = all[Math.ceil(0.995 * (all.length - 1))];
  return hi > lo ? [lo, hi] : [lo - 0.5 * Math.abs(lo || 1), hi + 0.5 * Math.abs(hi || 1)];
}

/** A number with three figures. */
export function figures(x: number): string {
  if (!Number.isFinite(x)) return '–';
  const text = Math.abs(x) >= 100 || x === 0 ? x.toFixed(0) : x.toPrecision(3);
  return text.replace(/^-/, '\u2212');
}
