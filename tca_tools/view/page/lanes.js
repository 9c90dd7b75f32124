// Spans of time in lanes, in each of which nothing overlaps, as the other charts lay them (see gantt/bars.py). Of a run
// that goes on many are open at a time, all that wait in a queue, and their ends come later.

import { Counts } from "./counts.js";

export class Lanes {
  constructor() {
    this.lists = []; // of spans, by lane
    this.counts = new Counts();
    this.changes = 0; // how often one began or ended
    this.room = 1; // lanes for which there are leaves: a power of two
    this.earliest = new Float64Array(2).fill(Infinity); // a tree: of each half of the lanes under a node the earliest end; the leaves are behind
  }

  get length() { return this.lists.length; }

  // Into the first lane in which nothing else goes on.
  put(span) {
    span.lanes = this;
    span.lane = this.#firstFree(span.start);
    if (span.lane === this.lists.length) this.lists.push([]);
    if (span.lane >= this.room) this.#grow();
    this.lists[span.lane].push(span);
    this.#count(span.start, 1);
    this.ended(span);
  }

  // A span's end is known, or another one than before.
  ended(span) {
    const { end } = span;
    if (end < Infinity && !span.isCounted) {
      span.isCounted = true;
      this.#count(end, -1);
    }
    if (span !== this.lists[span.lane].at(-1)) return; // another one has begun behind it: that counts
    let node = this.room + span.lane;
    for (this.earliest[node] = end; node > 1;) {
      node >>= 1;
      this.earliest[node] = Math.min(this.earliest[2 * node], this.earliest[2 * node + 1]);
    }
  }

  #count(time, change) {
    this.counts.add(time, change);
    this.changes++;
  }

  // How many go on at a time.
  count(time) { return this.counts.at(time); }

  // The most that go on at a time between two.
  most(from, until) { return this.counts.most(from, until); }

  // Whether most of the time lies in spans that are shorter than `narrow`; what has not ended does at `now`.
  areNarrow(narrow, now) {
    const asked = [narrow, now, this.changes].join();
    if (this.narrow?.asked === asked) return this.narrow.found;
    let all = 0, short = 0;
    for (const list of this.lists) {
      for (const { start, end } of list) {
        const length = Math.min(end, now) - start;
        all += length;
        if (length < narrow) short += length;
      }
    }
    this.narrow = { asked, found: 2 * short > all };
    return this.narrow.found;
  }

  #firstFree(time) {
    if (this.earliest[1] > time) return this.lists.length;
    let node = 1;
    while (node < this.room) node = this.earliest[2 * node] <= time ? 2 * node : 2 * node + 1;
    return node - this.room;
  }

  #grow() {
    const { earliest, room } = this;
    this.room = 2 * room;
    this.earliest = new Float64Array(4 * room).fill(Infinity);
    this.earliest.set(earliest.subarray(room), 2 * room);
    for (let node = this.room - 1; node > 0; node--) this.earliest[node] = Math.min(this.earliest[2 * node], this.earliest[2 * node + 1]);
  }
}

// How many wait, where not all bars are drawn or can be seen: a curve, in each column the most that waited at a time in it,
// and the most of all that is in sight. `timeAt` tells no times that are not.
export function drawLength(context, lanes, { left, right, y, tall, timeAt, ink, paper, how }) {
  const counts = Array.from({ length: Math.max(Math.ceil(right - left), 0) }, (_, x) => lanes.most(timeAt(left + x), timeAt(left + x + 1)));
  const most = counts.reduce((one, other) => Math.max(one, other), 0);
  if (!most) return;
  context.fillStyle = ink;
  context.globalAlpha = 0.35;
  counts.forEach((count, x) => context.fillRect(left + x, y + tall * (1 - count / most), 1, tall * count / most));
  context.globalAlpha = 1;
  const text = `up to ${most.toLocaleString("en")} ${how}`, wide = context.measureText(text).width;
  const begin = left + beside(counts, most, wide);
  context.textAlign = "left";
  context.lineJoin = "round";
  context.lineWidth = 3;
  context.strokeStyle = paper; // around the letters: the curve is seen between and behind them
  context.strokeText(text, begin, y + tall / 2 + 0.5);
  context.lineWidth = 1;
  context.fillText(text, begin, y + tall / 2 + 0.5);
}

// Where the number of a curve stands: left of the first highest place, or right of it the nearest place where the curve
// is low, within the row, or left of it; over the curve only where there is none.
function beside(counts, most, wide) {
  const peak = counts.indexOf(most), needed = wide + 12, last = counts.length - wide - 4;
  const isHigh = (count) => count > most / 4, left = peak - wide - 6;
  if (left >= 4 && !counts.slice(left, peak - 1).some(isHigh)) return left;
  for (let x = peak, free = 0; x < counts.length; x++) {
    free = isHigh(counts[x]) ? 0 : free + 1;
    if (free >= needed) return x - needed + 7;
  }
  for (let x = peak - 1, free = 0; x >= 0; x--) {
    free = isHigh(counts[x]) ? 0 : free + 1;
    if (free >= needed) return x + 6;
  }
  return Math.max(Math.min(left, last), 4);
}
