// Which triangle lies at a point of the sheet: cells with the triangles that touch them.

import type { Patch } from './patch';

export interface Place { patch: number; face: number; weights: [number, number, number] }

export class Grid {
  private readonly cell: number;
  private readonly width: number;
  private readonly height: number;
  private readonly starts: Uint32Array;
  private readonly patchOf: Uint16Array;
  private readonly faceOf: Uint32Array;

  constructor(private readonly patches: Patch[], size: [number, number]) {
    const faces = patches.reduce((sum, p) => sum + p.faces, 0);
    this.cell = Math.max(Math.sqrt((size[0] * size[1]) / Math.max(1, faces)) * 1.2, 1e-9);
    this.width = Math.floor(size[0] / this.cell) + 1;
    this.height = Math.floor(size[1] / this.cell) + 1;
    this.starts = new Uint32Array(this.width * this.height + 1);
    this.each((cell) => { this.starts[cell + 1]++; });
    for (let k = 0; k < this.width * this.height; k++) this.starts[k + 1] += this.starts[k];
    const ends = this.starts.slice();
    this.patchOf = new Uint16Array(this.starts[this.starts.length - 1]);
    this.faceOf = new Uint32Array(this.patchOf.length);
    this.each((cell, patch, face) => { const at = ends[cell]++; this.patchOf[at] = patch; this.faceOf[at] = face; });
  }

  private each(visit: (cell: number, patch: number, face: number) => void): void {
    this.patches.forEach((p, patch) => {
      const s = p.sheet, t = p.triangles;
      for (let face = 0; face < p.faces; face++) {
        const a = 2 * t[3 * face], b = 2 * t[3 * face + 1], c = 2 * t[3 * face + 2];
        const x0 = this.column(Math.min(s[a], s[b], s[c])), x1 = this.column(Math.max(s[a], s[b], s[c]));
        const y0 = this.row(Math.min(s[a + 1], s[b + 1], s[c + 1])), y1 = this.row(Math.max(s[a + 1], s[b + 1], s[c + 1]));
        for (let y = y0; y <= y1; y++) for (let x = x0; x <= x1; x++) visit(y * this.width + x, patch, face);
      }
    });
  }

  private column(x: number): number { return Math.min(this.width - 1, Math.max(0, Math.floor(x / this.cell))); }
  private row(y: number): number { return Math.min(this.height - 1, Math.max(0, Math.floor(y / this.cell))); }

  find(x: number, y: number, slack = 1e-4): Place | null {
    const cell = this.row(y) * this.width + this.column(x);
    let best: Place | null = null, most = -slack;
    for (let k = this.starts[cell]; k < this.starts[cell + 1]; k++) {
      const p = this.patches[this.patchOf[k]], s = p.sheet, f = 3 * this.faceOf[k];
      const a = 2 * p.triangles[f], b = 2 * p.triangles[f + 1], c = 2 * p.triangles[f + 2];
      const ax = s[a] - x, ay = s[a + 1] - y, bx = s[b] - x, by = s[b + 1] - y, cx = s[c] - x, cy = s[c + 1] - y;
      const u = bx * cy - by * cx, v = cx * ay - cy * ax, w = ax * by - ay * bx, sum = u + v + w;
      // The sum is negative where the triangle is flipped.
      const least = Math.min(u / sum, v / sum, w / sum);
      if (least >= most) { most = least; best = { patch: this.patchOf[k], face: this.faceOf[k], weights: [u / sum, v / sum, w / sum] }; }
    }
    return best;
  }
}

/** The corner of a face with the largest weight. */
export function nearest(patch: Patch, at: Place): number {
  const k = at.weights.indexOf(Math.max(...at.weights));
  return patch.triangles[3 * at.face + k];
}
