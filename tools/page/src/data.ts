// The data of a page: a header and arrays, packed by crates/files/src/page/pack.rs of the library.

export interface Box { lo: number[]; size: number[] }
export interface Rows { indices: number; weights: number }
export interface LevelHeader { vertices: number; edges: number; origins: number; direct: Rows | null }
export interface ValuesHeader { name: string; unit: string; lo: number; hi: number; data: number }
export interface PatchHeader {
  name: string; link: number; taxels: number; filled: number;
  pose: number[]; sheet: number[]; offset: number[];
  space: Box; map: Box; between: Box; most_turn: number;
  positions: number; places: number; triangles: number; unsplit: number; ids: number; presence: number; senses: number; region: number; areas: ValuesHeader;
  keys: number; turns: number; key_origins: number; key_rows: Rows | null;
  values: ValuesHeader[]; levels: LevelHeader[];
  /** Its taxels in terms of the fields of each level of the whole body. */
  body: Rows[];
}
/** frame, track, event, patch, taxels, area, force, u, v, peak taxel */
export type Contact = number[];
/** What of a contact is on another patch: frame, track, patch, area, peak taxel */
export type Part = number[];
/** An event that has ended, in m, s and N, from its first to its last frame; a gap has no contact. */
export interface EventRow {
  word: string; contacts: number[]; begin: number; duration: number; first: number; last: number;
  contact: { patch: number; from: [number, number]; to: [number, number]; force: [number, number, number] | null; area: number; length: number; direction: number | null; taxels: number; peak: number } | null;
}
export interface RecordingHeader {
  channel: string; unit: string; is_amount: boolean; lo: number; hi: number; force: boolean;
  times: number[]; cuts: number[]; totals: number[]; values: number[]; contacts: Contact[]; parts?: Part[]; events: EventRow[]; threshold: number | null; is_live: boolean;
}
export interface SkinHeader {
  links: { name: string; parent: number | null }[]; patches: PatchHeader[]; regions: string[];
  /** What taxels sense besides touch, counted from 1 on. */
  modalities: string[];
  /** The number of fields of each level of the whole body. */
  body: number[];
}
export interface Header extends SkinHeader {
  version: string; title: string; recording: RecordingHeader | null; arrays: [number, number, number][];
  /** The skin that landmarks lead to. */
  atlas: (SkinHeader & { name: string }) | null;
}
export type Numbers = Uint8Array | Uint16Array | Uint32Array;

export class Data {
  readonly header: Header;
  private readonly bytes: Uint8Array;
  private readonly starts: number[] = [];

  constructor(bytes: Uint8Array) {
    const length = new DataView(bytes.buffer, bytes.byteOffset).getUint32(0, true);
    this.header = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + length))) as Header;
    this.bytes = bytes;
    let at = 4 + length;
    for (const [planes, width, count] of this.header.arrays) {
      this.starts.push(at);
      at += planes * width * count;
    }
  }

  /** The numbers of an array, one plane after the other. */
  array(index: number): { numbers: Numbers; planes: number; count: number } {
    const [planes, width, count] = this.header.arrays[index];
    const numbers = width === 1 ? new Uint8Array(planes * count) : width === 2 ? new Uint16Array(planes * count) : new Uint32Array(planes * count);
    for (let plane = 0; plane < planes; plane++) {
      const from = this.starts[index] + plane * width * count;
      let last = 0;
      for (let k = 0; k < count; k++) {
        let zigzag = 0;
        for (let byte = 0; byte < width; byte++) zigzag |= this.bytes[from + byte * count + k] << (8 * byte);
        zigzag >>>= 0;
        last = (last + ((zigzag >>> 1) ^ -(zigzag & 1))) | 0;
        numbers[plane * count + k] = last;
      }
    }
    return { numbers, planes, count };
  }

  /** Points that are stored as shares of a box, x, y, z of one after the other. */
  points(index: number, box: Box, first = 0): Float32Array {
    const { numbers, count } = this.array(index);
    const axes = box.lo.length;
    const out = new Float32Array(count * axes);
    for (let axis = 0; axis < axes; axis++) {
      const step = box.size[axis] / 65535;
      const from = (first + axis) * count;
      for (let k = 0; k < count; k++) out[k * axes + axis] = box.lo[axis] + step * numbers[from + k];
    }
    return out;
  }
}

export async function load(element: HTMLElement): Promise<Data> {
  const text = (element.textContent ?? '').trim();
  const packed = fromBase64(text);
  const stream = new Blob([packed as BlobPart]).stream().pipeThrough(new DecompressionStream('gzip'));
  return new Data(new Uint8Array(await new Response(stream).arrayBuffer()));
}

function fromBase64(text: string): Uint8Array {
  const native = (Uint8Array as unknown as { fromBase64?: (text: string) => Uint8Array }).fromBase64;
  if (native) return native.call(Uint8Array, text);
  const binary = atob(text);
  return Uint8Array.from(binary, (c) => c.charCodeAt(0));
}
