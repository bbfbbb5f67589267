// Frames and events that the server of `report --live` sends.

import type { Contact, EventRow, Part, RecordingHeader } from './data';

type LiveEvent = Omit<EventRow, 'first' | 'last'>;
export interface LiveFrame { time: number; values: string; contacts: Contact[]; parts?: Part[]; dropped: number; events: LiveEvent[] }

/** Frames that the time line has. */
const FRAMES = 600;

/** Calls `show` at each picture with the newest frame and all events since the last one, and `end` after the last frame. */
export function listen(show: (frame: LiveFrame) => void, end: (events: LiveEvent[]) => void): void {
  const source = new EventSource('frames');
  let newest: LiveFrame | null = null;
  const flush = (): void => {
    if (newest) show(newest);
    newest = null;
  };
  source.addEventListener('message', (e) => {
    const waiting = newest, frame = JSON.parse(e.data as string) as LiveFrame;
    newest = { ...frame, events: [...(waiting?.events ?? []), ...frame.events] };
    if (!waiting) requestAnimationFrame(flush);
  });
  const ended = (events: LiveEvent[]): void => {
    source.close();
    flush();
    end(events);
  };
  source.addEventListener('end', (e) => ended((JSON.parse((e as MessageEvent).data as string) as { events: LiveEvent[] }).events));
  source.addEventListener('error', () => ended([]));
}

/** Adds a frame to the time line, which the oldest leaves with its events; returns its readings. */
export function append(recording: RecordingHeader, frame: LiveFrame): Float32Array {
  const values = new Float32Array(Uint8Array.from(atob(frame.values), (c) => c.charCodeAt(0)).buffer);
  let total = 0, hi = recording.hi, lo = recording.totals.length ? recording.lo : Infinity;
  for (const x of values) if (x === x) { total += x; hi = Math.max(hi, x); lo = Math.min(lo, x); }
  recording.lo = lo;
  // The scale grows in steps, so that colours keep their meaning for a while.
  if (hi > recording.hi) recording.hi = hi * 1.2;
  recording.times.push(frame.time);
  recording.totals.push(total);
  if (recording.times.length > FRAMES) {
    recording.times.shift();
    recording.totals.shift();
    for (const event of recording.events) { event.first = Math.max(0, event.first - 1); event.last--; }
    recording.events = recording.events.filter((event) => event.last >= 0);
  }
  addEvents(recording, frame.events);
  return values;
}

/** Adds events that are known with the newest frame, at the frames of their begins and ends. */
export function addEvents({ times, events }: RecordingHeader, ended: LiveEvent[]): void {
  const known = Math.max(0, times.length - 1);
  const backTo = (from: number, time: number): number => {
    let at = from;
    while (at > 0 && times[at] > time && times[at - 1] <= times[at]) at--;
    return at;
  };
  for (const event of ended) {
    const isGap = event.word === 'gap', last = isGap ? known : backTo(known, event.begin + event.duration);
    events.push({ ...event, first: isGap ? Math.max(0, known - 1) : backTo(last, event.begin), last });
  }
}
