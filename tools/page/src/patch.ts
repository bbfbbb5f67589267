// One patch: its places in space, between and on the map, its fields, and what is known of its taxels.

import { Matrix4, Quaternion, Vector3 } from 'three';
import type { Data, Numbers, PatchHeader, Rows } from './data';

export interface Fields {
  vertices: number;
  /** Up to three fields of each taxel, planar, and their weights. */
  indices: Numbers | null;
  weights: Float32Array | null;
  origins: Numbers | null;
  /** Pairs of places of level 0. */
  edges: Uint32Array;
  edgeCount: number;
  /** Colour number of each field: neighbours differ. */
  shades: Uint8Array | null;
}

export interface Values { name: string; unit: string; of: Float32Array }

export class Patch {
  readonly header: PatchHeader;
  readonly taxels: number;
  readonly places: number;
  readonly faces: number;
  readonly triangles: Uint32Array;
  readonly taxelOf: Uint32Array;
  readonly ids: Numbers;
  readonly presence: Numbers;
  /** The region of each taxel, from 1 on; 0 is none. */
  readonly region: Numbers;
  readonly areas: Float32Array;
  readonly sheet: Float32Array;
  /** Places at the times 0, 1/4, 1/2 and 3/4, in the frame of the link. */
  readonly keys: Float32Array[];
  readonly values: Values[];
  readonly fields: Fields[];
  /** Those of the levels of the whole body, whose fields are numbered over all patches. */
  readonly body: Fields[];
  /** What the taxels sense, 0 for what `presence` says. */
  readonly senses: Numbers;
  /** All patches, and the number of levels of the one that has most. */
  private peers: Patch[] = [this];
  most = 0;
  readonly pose: Matrix4;
  /** From the common sheet to the frame of the link. */
  readonly flat: Matrix4;
  /** From the frame of the link to the common sheet. */
  readonly toSheet: Matrix4;
  /** The middle of the map, in the frame of the link and on the sheet. */
  readonly middle: Vector3;
  readonly edges: Uint32Array;
  readonly spacing: number;

  constructor(data: Data, header: PatchHeader, body: number[]) {
    this.header = header;
    const [dx, dy] = header.offset;
    this.sheet = data.points(header.places, header.map);
    this.places = this.sheet.length / 2;
    const lo = new Vector3(Infinity, Infinity, 0), hi = new Vector3(-Infinity, -Infinity, 0);
    for (let k = 0; k < this.places; k++) {
      this.sheet[2 * k] += dx;
      this.sheet[2 * k + 1] += dy;
      const at = new Vector3(this.sheet[2 * k], this.sheet[2 * k + 1], 0);
      lo.min(at);
      hi.max(at);
    }
    const space = data.points(header.positions, header.space);
    this.taxels = space.length / 3;
    const extra = data.array(header.unsplit).numbers;
    this.taxelOf = new Uint32Array(this.places);
    for (let k = 0; k < this.places; k++) this.taxelOf[k] = k < this.taxels ? k : extra[k - this.taxels];
    const skin = new Float32Array(3 * this.places);
    for (let k = 0; k < this.places; k++) for (let a = 0; a < 3; a++) skin[3 * k + a] = space[3 * this.taxelOf[k] + a];
    const triangles = data.array(header.triangles);
    this.faces = triangles.count;
    this.triangles = new Uint32Array(3 * this.faces);
    for (let f = 0; f < this.faces; f++) for (let c = 0; c < 3; c++) this.triangles[3 * f + c] = triangles.numbers[c * this.faces + f];
    this.ids = data.array(header.ids).numbers;
    this.presence = data.array(header.presence).numbers;
    this.region = data.array(header.region).numbers;
    this.areas = scaled(data.array(header.areas.data).numbers, header.areas.lo, header.areas.hi);
    this.values = header.values.map((v) => ({ name: v.name, unit: v.unit, of: scaled(data.array(v.data).numbers, v.lo, v.hi) }));
    this.pose = affine(header.pose);
    this.flat = affine(header.sheet).multiply(new Matrix4().makeTranslation(-dx, -dy, 0));
    this.toSheet = this.flat.clone().invert();
    this.middle = lo.add(hi).multiplyScalar(0.5).applyMatrix4(this.flat);
    this.keys = [skin, ...this.between(data, skin)];
    this.fields = header.levels.map((level) => {
      const edges = data.array(level.edges);
      const pairs = new Uint32Array(2 * edges.count);
      for (let e = 0; e < edges.count; e++) { pairs[2 * e] = edges.numbers[e]; pairs[2 * e + 1] = edges.numbers[edges.count + e]; }
      const direct = level.direct ? rows(data, level.direct, 255) : null;
      return {
        vertices: level.vertices, edges: pairs, edgeCount: edges.count,
        origins: direct ? data.array(level.origins).numbers : null,
        indices: direct?.indices ?? null,
        weights: direct?.weights ?? null,
        shades: null,
      };
    });
    this.body = header.body.map((direct, k) => ({ vertices: body[k], edges: new Uint32Array(), edgeCount: 0, origins: null, ...rows(data, direct, 255), shades: null }));
    this.senses = data.array(header.senses).numbers;
    this.edges = this.fields[0].edges;
    let sum = 0;
    for (let e = 0; e < this.edges.length; e += 2) sum += Math.hypot(...[0, 1, 2].map((a) => skin[3 * this.edges[e] + a] - skin[3 * this.edges[e + 1] + a]));
    this.spacing = sum / Math.max(1, this.edges.length / 2);
  }

  /** The three surfaces between skin and map: those of the level that has key frames, carried to level 0. */
  private between(data: Data, skin: Float32Array): Float32Array[] {
    const { header, places } = this;
    const count = data.header.arrays[header.keys][2];
    const keys = [0, 1, 2].map((k) => data.points(header.keys, header.between, 3 * k));
    if (!header.key_rows) return keys;
    const { indices, weights } = rows(data, header.key_rows, 255);
    const origins = data.array(header.key_origins).numbers;
    const most = header.most_turn;
    const turns = data.points(header.turns, { lo: [-most, -most, -most], size: [2 * most, 2 * most, 2 * most] });
    const flat = new Float32Array(3 * places);
    const at = new Vector3();
    for (let k = 0; k < places; k++) at.set(this.sheet[2 * k], this.sheet[2 * k + 1], 0).applyMatrix4(this.flat).toArray(flat, 3 * k);
    const mean = (of: Float32Array, place: number, through: Numbers | null, out: Vector3): Vector3 => {
      out.set(0, 0, 0);
      for (let c = 0; c < 3; c++) {
        const w = weights[c * places + place];
        if (w === 0) continue;
        const key = indices[c * places + place];
        const j = 3 * (through ? through[key] : key);
        out.x += w * of[j]; out.y += w * of[j + 1]; out.z += w * of[j + 2];
      }
      return out;
    };
    const out = [0, 1, 2].map(() => new Float32Array(3 * places));
    const [turn, off0, off1, sum, moved, axis] = [0, 1, 2, 3, 4, 5].map(() => new Vector3());
    const q = new Quaternion();
    if (turns.length / 3 !== count) throw new Error('one turn for each place');
    for (let place = 0; place < places; place++) {
      mean(turns, place, null, turn);
      const angle = turn.length();
      if (angle > 0) axis.copy(turn).divideScalar(angle); else axis.set(1, 0, 0);
      off0.fromArray(skin, 3 * place).sub(mean(skin, place, origins, sum));
      off1.fromArray(flat, 3 * place).sub(mean(flat, place, origins, sum));
      off1.applyQuaternion(q.setFromAxisAngle(axis, -angle));
      for (let k = 0; k < 3; k++) {
        const t = (k + 1) / 4;
        moved.copy(off0).multiplyScalar(1 - t).addScaledVector(off1, t).applyQuaternion(q.setFromAxisAngle(axis, t * angle));
        mean(keys[k], place, null, sum).add(moved).toArray(out[k], 3 * place);
      }
    }
    return out;
  }

  /** Makes all patches of a skin known to each other. */
  static join(patches: Patch[]): void {
    const most = Math.max(...patches.map((p) => p.fields.length));
    for (const patch of patches) { patch.peers = patches; patch.most = most; }
  }

  /** What a level of the slider shows: its own, or its coarsest, and above those of all patches a level of the body. */
  fieldsAt(level: number): Fields {
    return level < this.most ? this.fields[Math.min(level, this.fields.length - 1)] : this.body[Math.min(level - this.most, this.body.length - 1)];
  }

  /** The patches that share the fields of a level with this one. */
  sharing(level: number): Patch[] { return level < this.most ? [this] : this.peers; }

  /** The fields of a taxel on a level, with their weights. */
  fieldsOf(level: number, taxel: number): [number, number][] {
    const { indices, weights } = this.fieldsAt(level);
    if (!indices || !weights) return [[taxel, 1]];
    const found: [number, number][] = [];
    for (let c = 0; c < 3; c++) {
      const w = weights[c * this.taxels + taxel];
      if (w > 0) found.push([indices[c * this.taxels + taxel], w]);
    }
    return found.sort((a, b) => b[1] - a[1]);
  }

  /** The taxels of a field with their weights. */
  members(level: number, field: number): [number, number][] {
    const { indices, weights } = this.fieldsAt(level);
    if (!indices || !weights) return [[field, 1]];
    const found: [number, number][] = [];
    for (let c = 0; c < 3; c++) for (let k = 0; k < this.taxels; k++) {
      const at = c * this.taxels + k;
      if (indices[at] === field && weights[at] > 0) found.push([k, weights[at]]);
    }
    return found.sort((a, b) => a[0] - b[0]);
  }

  /** A colour number for each field, so that neighbours differ. */
  shades(level: number): Uint8Array {
    const fields = this.fieldsAt(level), sharing = this.sharing(level);
    if (fields.shades) return fields.shades;
    const shades = new Uint8Array(fields.vertices).fill(255);
    const near: Set<number>[] = Array.from({ length: fields.vertices }, () => new Set());
    for (const patch of sharing) for (let k = 0; k < patch.taxels; k++) {
      const of = patch.fieldsOf(level, k).map(([f]) => f);
      for (const a of of) for (const b of of) if (a !== b) near[a].add(b);
    }
    for (let f = 0; f < fields.vertices; f++) {
      const taken = new Set([...near[f]].map((g) => shades[g]));
      let free = f % 6;
      for (let n = 0; n < 12 && taken.has(free); n++) free = (free + 1) % 12;
      shades[f] = free;
    }
    for (const patch of sharing) patch.fieldsAt(level).shades = shades;
    return shades;
  }

  /** The largest singular values of the map of a face. */
  stretch(face: number): [number, number] {
    const p = this.keys[0], s = this.sheet;
    const [a, b, c] = [0, 1, 2].map((k) => this.triangles[3 * face + k]);
    const e = (of: Float32Array, n: number, i: number, j: number): number[] => Array.from({ length: n }, (_, k) => of[n * j + k] - of[n * i + k]);
    const [e1, e2, d1, d2] = [e(p, 3, a, b), e(p, 3, a, c), e(s, 2, a, b), e(s, 2, a, c)];
    const base = Math.hypot(...e1);
    const along = e1.reduce((sum, x, k) => sum + x * e2[k], 0) / base;
    const high = Math.sqrt(Math.max(0, e2.reduce((sum, x) => sum + x * x, 0) - along * along));
    const [xx, xy] = d1.map((x) => x / base);
    const [yx, yy] = d2.map((y, k) => (y - (k ? xy : xx) * along) / high);
    const turn = Math.hypot(xx + yy, xy - yx) / 2, mirror = Math.hypot(xx - yy, xy + yx) / 2;
    return [turn + mirror, turn - mirror];
  }

  /** A mean over the faces around each place, weighted by their areas on the skin. */
  byPlace(of: (stretch: [number, number]) => number): Float32Array {
    const sums = new Float32Array(this.places), areas = new Float32Array(this.places);
    const p = this.keys[0];
    const [x, y, z] = [0, 1, 2].map(() => new Vector3());
    for (let f = 0; f < this.faces; f++) {
      const corners = [0, 1, 2].map((k) => this.triangles[3 * f + k]);
      x.fromArray(p, 3 * corners[0]);
      const area = y.fromArray(p, 3 * corners[1]).sub(x).cross(z.fromArray(p, 3 * corners[2]).sub(x)).length();
      const value = of(this.stretch(f));
      if (!(area > 0) || !Number.isFinite(value)) continue;
      for (const c of corners) { sums[c] += area * value; areas[c] += area; }
    }
    return sums.map((sum, k) => (areas[k] > 0 ? sum / areas[k] : NaN));
  }

  private normals: Float32Array | null = null;

  /** Position (m) and unit normal of a taxel in the frame of the link. */
  frame(taxel: number): [Vector3, Vector3] {
    const p = this.keys[0], normals = (this.normals ??= this.allNormals());
    return [new Vector3().fromArray(p, 3 * taxel), new Vector3().fromArray(normals, 3 * taxel)];
  }

  private allNormals(): Float32Array {
    const p = this.keys[0], sums = new Float32Array(3 * this.taxels);
    const [x, y, z] = [0, 1, 2].map(() => new Vector3());
    for (let f = 0; f < this.faces; f++) {
      const corners = [0, 1, 2].map((k) => this.triangles[3 * f + k]);
      x.fromArray(p, 3 * corners[0]);
      y.fromArray(p, 3 * corners[1]).sub(x).cross(z.fromArray(p, 3 * corners[2]).sub(x));
      for (const c of corners) for (let a = 0; a < 3; a++) sums[3 * this.taxelOf[c] + a] += y.getComponent(a);
    }
    for (let t = 0; t < this.taxels; t++) x.fromArray(sums, 3 * t).normalize().toArray(sums, 3 * t);
    return sums;
  }

  private seam: Uint8Array | null = null;

  /** Whether a taxel has several places on the map. */
  isOnSeam(taxel: number): boolean {
    if (!this.seam) {
      this.seam = new Uint8Array(this.taxels);
      for (let k = this.taxels; k < this.places; k++) this.seam[this.taxelOf[k]] = 1;
    }
    return this.seam[taxel] === 1;
  }

  /** The distance of each taxel from the nearest of some, along edges, in m. */
  distances(from: number[]): Float64Array {
    const found = new Float64Array(this.taxels).fill(Infinity), { edges, taxelOf } = this, at = this.keys[0];
    const near: number[][] = Array.from({ length: this.taxels }, () => []);
    for (let e = 0; e < edges.length; e += 2) {
      const [a, b] = [taxelOf[edges[e]], taxelOf[edges[e + 1]]];
      near[a].push(b);
      near[b].push(a);
    }
    // Rounds over those whose distance fell, until none does.
    let queue = from;
    for (const t of from) found[t] = 0;
    while (queue.length > 0) {
      const next = new Set<number>();
      for (const a of queue) for (const b of near[a]) {
        const d = found[a] + Math.hypot(at[3 * a] - at[3 * b], at[3 * a + 1] - at[3 * b + 1], at[3 * a + 2] - at[3 * b + 2]);
        if (d < found[b]) { found[b] = d; next.add(b); }
      }
      queue = [...next];
    }
    return found;
  }

  /** All places of a taxel: several on a seam. */
  placesOf(taxel: number): number[] {
    const places = [taxel];
    for (let k = this.taxels; k < this.places; k++) if (this.taxelOf[k] === taxel) places.push(k);
    return places;
  }
}

/** Indices and weights with the weight that is not stored: the first, which is the largest. */
function rows(data: Data, header: Rows, whole: number): { indices: Numbers; weights: Float32Array } {
  const { numbers: rest, count } = data.array(header.weights);
  const weights = new Float32Array(3 * count);
  for (let k = 0; k < count; k++) {
    weights[count + k] = rest[k] / whole;
    weights[2 * count + k] = rest[count + k] / whole;
    weights[k] = (whole - rest[k] - rest[count + k]) / whole;
  }
  return { indices: data.array(header.indices).numbers, weights };
}

function scaled(numbers: Numbers, lo: number, hi: number): Float32Array {
  return Float32Array.from(numbers, (x) => lo + ((hi - lo) * x) / 65535);
}

function affine(m: number[]): Matrix4 {
  return new Matrix4().set(m[0], m[3], m[6], m[9], m[1], m[4], m[7], m[10], m[2], m[5], m[8], m[11], 0, 0, 0, 1);
}
