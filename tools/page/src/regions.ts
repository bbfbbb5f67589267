// Polygons on the map that name taxels, as `--regions` of the command reads them.

import type { Patch } from './patch';

type Point = [number, number];

/** A polygon on the map of a patch, in m. */
export interface Region { patch: number; name: string; corners: Point[] }

/** Which side of the line from `a` to `b` a point is on. */
const side = (a: Point, b: Point, p: Point): number => (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);

/** Whether two sides of a closed polygon that share no corner meet. */
export function crossesItself(corners: Point[]): boolean {
  const n = corners.length, at = (k: number): Point => corners[k % n];
  for (let i = 0; i < n; i++) for (let j = i + 2; j < n; j++) {
    if (i === 0 && j === n - 1) continue;
    const [a, b, c, d] = [at(i), at(i + 1), at(j), at(j + 1)];
    if (side(a, b, c) * side(a, b, d) <= 0 && side(c, d, a) * side(c, d, b) <= 0) return true;
  }
  return false;
}

/** The taxels in a polygon, by the even-odd rule. */
export function taxelsIn(patch: Patch, corners: Point[]): number {
  const [dx, dy] = patch.header.offset, n = corners.length, found = new Set<number>();
  for (let place = 0; place < patch.places; place++) {
    const x = patch.sheet[2 * place] - dx, y = patch.sheet[2 * place + 1] - dy;
    let isIn = false;
    for (let k = 0; k < n; k++) {
      const [a, b] = [corners[k], corners[(k + 1) % n]];
      if (a[1] > y !== b[1] > y && x < a[0] + ((y - a[1]) / (b[1] - a[1])) * (b[0] - a[0])) isIn = !isIn;
    }
    if (isIn) found.add(patch.taxelOf[place]);
  }
  return found.size;
}

/** The patch whose map is nearest to a point of the sheet. */
export function patchNear(patches: Patch[], isShown: (patch: number) => boolean, [x, y]: Point): number | null {
  let best: number | null = null, least = Infinity;
  patches.forEach((patch, k) => {
    if (!isShown(k)) return;
    for (let p = 0; p < patch.places; p++) {
      const d = Math.hypot(patch.sheet[2 * p] - x, patch.sheet[2 * p + 1] - y);
      if (d < least) [least, best] = [d, k];
    }
  });
  return best;
}

/** The content of a file that `--regions` reads. */
export function toJson(patches: Patch[], regions: Region[]): string {
  const short = (x: number): number => +x.toFixed(5);
  const lines = regions.map(({ patch, name, corners }) => JSON.stringify({ patch: patches[patch].header.name, region: name, uv: corners.map((c) => c.map(short)) }));
  return `[${lines.join(',\n ')}]\n`;
}
