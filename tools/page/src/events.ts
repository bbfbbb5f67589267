// Events on the time line: a mark with its word for each, in rows where they overlap.

import { CATEGORIES, figures } from './colours';
import type { EventRow, Header } from './data';

const WORDS = ['tap', 'press', 'hold', 'stroke', 'rub', 'hit', 'pat', 'grasp'];
const [ROWS, HIGH, LEAST_WIDTH] = [3, 15, 4];

export class EventStrip {
  private marks = new Map<EventRow, HTMLElement>();
  private readonly context = document.createElement('canvas').getContext('2d')!;
  private now = new Set<EventRow>();
  /** The event under the pointer. */
  hovered: EventRow | null = null;

  constructor(private readonly header: Header, private readonly box: HTMLElement, private readonly tip: HTMLElement, private readonly onPick: (event: EventRow) => void, private readonly onHover: () => void) {
    this.makeMarks();
  }

  /** Marks the events that there are now, where they are now. */
  update(): void {
    if (this.events.length === 0 && this.marks.size === 0) return;
    this.makeMarks();
    this.layout();
  }

  private makeMarks(): void {
    const old = this.marks;
    if (this.events.length === old.size && this.events.every((event) => old.has(event))) return;
    this.marks = new Map(this.events.map((event) => [event, old.get(event) ?? this.mark(event)]));
    if (this.hovered && !this.marks.has(this.hovered)) this.hover(null);
    this.box.replaceChildren(...this.marks.values());
    this.box.hidden = this.marks.size === 0;
  }

  private mark(event: EventRow): HTMLElement {
    const mark = document.createElement('button');
    mark.type = 'button';
    // The keys e and E walk through them: the way to the next control passes no mark.
    mark.tabIndex = -1;
    mark.textContent = event.word;
    mark.setAttribute('aria-label', this.numbers(event).map((row) => row.join(' ')).join(', '));
    const kind = WORDS.indexOf(event.word);
    if (kind >= 0) mark.style.background = `rgb(${CATEGORIES[kind].join()})`;
    mark.addEventListener('pointerenter', () => this.hover(event));
    mark.addEventListener('pointerleave', () => this.hover(null));
    mark.addEventListener('click', () => this.onPick(event));
    return mark;
  }

  private hover(event: EventRow | null): void {
    this.hovered = event;
    this.tip.hidden = !event;
    if (event) this.describe(event, this.marks.get(event)!);
    this.onHover();
  }

  private get events(): EventRow[] { return this.header.recording!.events; }

  /** Places the marks: the first row with room for the word, else for the mark, else the one that is free first. */
  layout(): void {
    const width = this.box.clientWidth, frames = Math.max(1, this.header.recording!.times.length - 1);
    const ends: number[] = [];
    this.context.font = '11px system-ui, "DejaVu Sans", sans-serif';
    this.events.forEach((event) => {
      const left = Math.min((event.first / frames) * width, width - LEAST_WIDTH), long = Math.max(LEAST_WIDTH, ((event.last - event.first) / frames) * width);
      const said = Math.max(long, this.context.measureText(event.word).width + 8), room = Math.min(said, width - left);
      const free = (needs: number): number => {
        for (let row = 0; row < ROWS; row++) if ((ends[row] ?? -1) <= left && left + needs <= width + 1) return row;
        return -1;
      };
      let row = free(said), isSaid = row >= 0;
      if (row < 0) { row = free(long); isSaid = row >= 0 && long >= said; }
      if (row < 0) row = ends.indexOf(Math.min(...ends));
      ends[row] = Math.max(ends[row] ?? 0, left + (isSaid ? room : long) + 1);
      const { style, classList } = this.marks.get(event)!;
      style.left = `${left}px`;
      style.width = `${long}px`;
      style.top = `${row * HIGH}px`;
      classList.toggle('silent', !isSaid);
      // A mark that is shorter than its word has the word at its right.
      classList.toggle('beside', said > long);
      style.paddingLeft = said > long ? `${long}px` : '4px';
    });
    this.box.style.height = `${HIGH * Math.max(1, ends.length)}px`;
  }

  /** The events at a frame, which their marks show. */
  at(frame: number): EventRow[] {
    const here = this.events.filter(({ first, last }) => first <= frame && frame <= last);
    for (const event of this.now) this.marks.get(event)?.classList.remove('now');
    for (const event of here) this.marks.get(event)!.classList.add('now');
    this.now = new Set(here);
    return here;
  }

  /** The frame where the next event begins, or the one before. */
  next(frame: number, isBack: boolean): number | null {
    const firsts = this.events.map((event) => event.first).filter((first) => (isBack ? first < frame : first > frame));
    return firsts.length ? (isBack ? Math.max(...firsts) : Math.min(...firsts)) : null;
  }

  private describe(event: EventRow, mark: HTMLElement): void {
    const list = document.createElement('dl');
    for (const [name, value] of this.numbers(event)) for (const [tag, said] of [['dt', name], ['dd', value]]) {
      const element = document.createElement(tag);
      element.textContent = said;
      list.append(element);
    }
    this.tip.replaceChildren(list);
    this.tip.style.left = `${Math.max(0, Math.min(mark.offsetLeft, this.box.clientWidth - this.tip.offsetWidth))}px`;
  }

  private numbers({ word, contacts, begin, duration, contact }: EventRow): [string, string][] {
    const rows: [string, string][] = [[word, `${begin.toFixed(2)} to ${(begin + duration).toFixed(2)} s, ${figures(duration)} s long`]];
    if (contacts.length) rows.push([contacts.length > 1 ? 'contacts' : 'contact', contacts.join(', ')]);
    if (!contact) return rows;
    const patch = this.header.patches[contact.patch];
    rows.push(['patch', patch.name]);
    if (contact.force) rows.push(['force', `${figures(contact.force[0])} N largest, ${figures(contact.force[1])} N mean`], ['impulse', `${figures(contact.force[2])} N s`]);
    rows.push(['area', `${figures(1e6 * contact.area)} mm², ${contact.taxels} ${contact.taxels === 1 ? 'taxel' : 'taxels'}`]);
    if (contact.direction !== null) {
      const speed = duration > 0 ? `, ${figures((1000 * contact.length) / duration)} mm/s` : '';
      rows.push(['path', `${figures(1000 * contact.length)} mm${speed}, towards ${Math.round((180 * contact.direction) / Math.PI)}° on the map`]);
    }
    return rows;
  }
}
