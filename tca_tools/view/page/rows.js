// The rows of the chart: what lies in each, in which order they stand, how tall they are, and how many wait in one.

export const LANE = 18, THIN = 7, NAMED = 14, BETWEEN = 9; // pixels
const CURVE = 18;
const MOST_LANES = 12, MOST_HELD = 3;
const MOST_WAIT = 6, FIRST = 5; // of more that wait the first are drawn, and how many there are (as in `tca gantt`)
const FEW = 3, FIRST_OF_FEW = 2; // the same of what is no module's: it may stay for long
const HATCHED = 14; // pixels: of bars that wait and are mostly narrower the number is drawn, too

// Spans of one kind in a row, by their lanes: in none of these do two overlap.
class Lanes {
  constructor() {
    this.lists = [];
    this.begun = []; // when they did, in that order; and when they ended
    this.ended = [];
  }

  get length() { return this.lists.length; }

  put(span) {
    (this.lists[span.lane] ??= []).push(span);
    this.begun.push(span.start);
  }

  end(span) { this.ended.push(span.end); }

  // The most that go on at a time between each of these times and the next one. What is over as soon as it began counts
  // nowhere.
  peaks(times) {
    const { begun, ended } = this, found = [];
    let began = firstWith(begun, (time) => time > times[0]), over = firstWith(ended, (time) => time > times[0]);
    const goOn = (time) => { while (ended[over] <= time) over++; };
    for (let place = 1; place < times.length; place++) {
      const from = times[place - 1], until = times[place];
      while (begun[began] <= from) began++;
      goOn(from);
      let most = until > from ? began - over : 0;
      while (begun[began] < until) {
        goOn(begun[began]);
        most = Math.max(most, ++began - over);
      }
      found.push(most);
    }
    return found;
  }

  // Whether most of the time lies in spans that are shorter than `narrow`; what has not ended does at `now`.
  areNarrow(narrow, now) {
    const asked = [narrow, now, this.begun.length, this.ended.length].join();
    if (this.narrow?.asked === asked) return this.narrow.found;
    let all = 0, short = 0;
    for (const { start, end } of this.lists.flat()) {
      const length = Math.min(end, now) - start;
      all += length;
      if (length < narrow) short += length;
    }
    this.narrow = { asked, found: 2 * short > all };
    return this.narrow.found;
  }
}

// The first place of a list, from `start` on, from which the condition holds; it holds for all behind it.
export function firstWith(list, holds, start = 0) {
  let low = start, high = list.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (holds(list[middle])) high = middle; else low = middle + 1;
  }
  return low;
}

// A row of the chart; of no module's the module is "".
export function newRow(label, module) {
  const lanes = { handled: new Lanes(), queued: new Lanes(), held: new Lanes() };
  return { label, module, ...lanes, connected: [], failed: [], raised: [], changes: [], suspends: false };
}

// The rows in which there is anything, in the order in which they stand: those of a module together, the modules as they
// came; below them what is suspended, and what nobody handles.
export function inOrder(rows) {
  const shown = rows.filter((row) => row.handled.length || row.queued.length || row.held.length || row.connected.length);
  const modules = new Map();
  for (const row of shown) modules.set(row.module, [...modules.get(row.module) ?? [], row]);
  const others = modules.get("") ?? [];
  modules.delete("");
  return [...modules.values()].flat().concat(others.filter((row) => row.suspends), others.filter((row) => !row.suspends));
}

// Where each of them stands, from 0 on; and how tall they are together. `scale`: pixels a second where all of the run is
// seen, until now; it does not change as the reader zooms.
export function placed(rows, { scale, now }) {
  let top = 0;
  const layout = rows.map((row) => {
    const waiting = row.queued.length, isNobodys = !row.module; // there is nothing else in it
    const [most, first] = isNobodys ? [FEW, FIRST_OF_FEW] : [MOST_WAIT, FIRST], isLong = waiting > most, thin = isLong ? first : waiting;
    const isCurve = isLong || waiting > 1 && row.queued.areNarrow(HATCHED / scale, now); // one is nothing to compare
    const lanes = isNobodys ? 0 : Math.min(Math.max(row.handled.length, 1), MOST_LANES), step = isNobodys ? NAMED : THIN;
    const held = Math.min(row.held.length, MOST_HELD), curve = isCurve ? CURVE : 0, tall = lanes * LANE + thin * step + held * THIN + curve;
    const place = { row, top, bottom: top + tall, lanes, thin, held, step, curve };
    top += tall + BETWEEN;
    return place;
  });
  return { layout, tall: top };
}

// How many wait, where not all bars are drawn or can be seen: a curve, in each column of pixels the most that waited at a
// time in it, and the most of all that is in sight.
export function drawCurve(context, counts, { left, y, tall, ink, paper, how }) {
  const most = counts.reduce((one, other) => Math.max(one, other), 0);
  if (!most) return;
  context.fillStyle = ink;
  context.globalAlpha = 0.35;
  counts.forEach((count, x) => context.fillRect(left + x, y + tall * (1 - count / most), 1, tall * count / most));
  context.globalAlpha = 1;
  const text = `up to ${most.toLocaleString("en")} ${how}`, begin = left + 4;
  context.textAlign = "left";
  context.lineJoin = "round";
  context.lineWidth = 3;
  context.strokeStyle = paper; // around the letters: the curve is seen between and behind them
  context.strokeText(text, begin, y + tall / 2 + 0.5);
  context.lineWidth = 1;
  context.fillText(text, begin, y + tall / 2 + 0.5);
}
