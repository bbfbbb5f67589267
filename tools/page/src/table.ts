// The table of landmarks that `--landmarks` of the command reads.

import type { Patch } from './patch';
import type { Pair } from './registration';
import type { Taxel } from './stage';

const quoted = (text: string): string => (/[",\r\n]/.test(text) || text !== text.trim() ? `"${text.replaceAll('"', '""')}"` : text);

/** Whether several taxels have one id. */
function isAmbiguous(patches: Patch[]): boolean {
  const seen = new Set<number>();
  for (const patch of patches) for (const id of patch.ids) { if (seen.has(id)) return true; seen.add(id); }
  return false;
}

/** A row for each landmark; with the names of patches where ids alone do not tell taxels apart. */
export function toCsv(own: Patch[], other: Patch[], pairs: Pair[]): string {
  const columns: [string, (pair: Pair) => string][] = [
    ['taxel_id', ({ own: at }) => `${own[at.patch].ids[at.taxel]}`],
    ['atlas_taxel_id', ({ other: at }) => `${other[at.patch].ids[at.taxel]}`],
    ['name', ({ name }) => quoted(name)],
  ];
  if (isAmbiguous(own)) columns.push(['patch', ({ own: at }) => quoted(own[at.patch].header.name)]);
  if (isAmbiguous(other)) columns.push(['atlas_patch', ({ other: at }) => quoted(other[at.patch].header.name)]);
  const line = (cell: ([name, of]: [string, (pair: Pair) => string]) => string): string => `${columns.map(cell).join(',')}\n`;
  return line(([name]) => name) + pairs.map((pair) => line(([, of]) => of(pair))).join('');
}

/** The cells of the lines of a table, with quotes, between the first of these signs that its first line has. */
function cellsOf(text: string): string[][] {
  const rows: string[][] = [], first = text.split('\n', 1)[0], sign = [',', ';', '\t'].find((each) => first.includes(each));
  let [row, cell, isQuoted] = [[] as string[], '', false];
  const end = (): void => { row.push(cell.trim()); cell = ''; };
  for (let k = 0; k < text.length; k++) {
    const c = text[k];
    if (isQuoted) { if (c !== '"') cell += c; else if (text[k + 1] === '"') { cell += '"'; k++; } else isQuoted = false; }
    else if (c === '"') isQuoted = true;
    else if (c === sign) end();
    else if (c === '\n') { end(); rows.push(row); row = []; }
    else if (c !== '\r') cell += c;
  }
  if (cell || row.length > 0) { end(); rows.push(row); }
  return rows;
}

/** The landmarks of a table, without a name where it gives none, and what is wrong with rows that are none. */
export function fromCsv(own: Patch[], other: Patch[], text: string): { pairs: Pair[]; wrong: string[] } {
  const [head = [], ...rows] = cellsOf(text.replace(/^\uFEFF/, '')), small = head.map((name) => name.toLowerCase());
  const column = (name: string): number => (head.includes(name) ? head.indexOf(name) : small.indexOf(name));
  const [id, otherId] = [column('taxel_id') < 0 ? column('id') : column('taxel_id'), column('atlas_taxel_id')];
  if (id < 0 || otherId < 0) return { pairs: [], wrong: ['The table needs the columns taxel_id and atlas_taxel_id.'] };
  const pairs: Pair[] = [], wrong: string[] = [];
  rows.forEach((row, k) => {
    if (row.every((cell) => cell === '')) return;
    const taxel = (patches: Patch[], whose: string, cell: string, patch: string | undefined): Taxel | null => {
      const found = patches.flatMap((p, n) => (patch && p.header.name !== patch ? [] : [...p.ids].flatMap((x, t) => (`${x}` === cell ? [{ patch: n, taxel: t }] : []))));
      if (found.length === 1 && !patches[found[0].patch].isOnSeam(found[0].taxel)) return found[0];
      wrong.push(`Line ${k + 2}: ${found.length === 1 ? `taxel ${cell} of ${whose} lies on the seam.` : `${found.length} taxels of ${whose} have the id ${cell}.`}`);
      return null;
    };
    const [at, to] = [taxel(own, 'the skin', row[id], row[column('patch')]), taxel(other, 'the atlas', row[otherId], row[column('atlas_patch')])];
    if (at && to) pairs.push({ own: at, other: to, name: row[column('name')] ?? '' });
  });
  if (rows.length === 0) wrong.push('The table has no row.');
  return { pairs, wrong };
}
