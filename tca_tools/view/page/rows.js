// The rows of the chart: their spans, order and heights, and the curves of queue lengths.

export const LANE = 18, THIN = 7, NAMED = 14, BETWEEN = 9; // pixels
const CURVE = 18;
const MOST_LANES = 12, MOST_HELD = 3;
const MOST_WAIT = 6, FIRST = 5; // bars of a queue: a longer one gets a curve and only its first bars (as in `tca gantt`)
const FEW = 3, FIRST_OF_FEW = 2; // the same for a row without a module, whose bars may last long
const HATCHED = 14; // pixels: if most waiting bars are narrower, the curve is drawn, too

// Spans of one kind in a row, by lane. Spans of one lane do not overlap.
class Lanes {
  constructor() {
    this.lists = [];
    this.begun = []; // the sorted times of their starts, and of their ends
    this.ended = [];
  }

  get length() { return this.lists.length; }

  put(span) {
    (this.lists[span.lane] ??= []).push(span);
    this.begun.push(span.start);
  }

  end(span) { this.ended.push(span.end); }

  // The greatest number of open spans between each of these times and the next one. Spans of no length do not count.
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

  // Whether spans shorter than `narrow` have most of the total time. Open spans count until `now`.
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

// The first place of a list, from `start` on, for which the condition holds. It must then hold for all later places.
export function firstWith(list, holds, start = 0) {
  let low = start, high = list.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (holds(list[middle])) high = middle; else low = middle + 1;
  }
  return low;
}

// A row of the chart. `module` is "" for a row without a module.
export function newRow(label, module) {
  const lanes = { handled: new Lanes(), queued: new Lanes(), held: new Lanes() };
  return { label, module, ...lanes, connected: [], failed: [], raised: [], changes: [], suspends: false };
}

// The rows that are not empty, grouped by module in the order of joining. The rows of suspended tasks and of messages
// without a handler are last.
export function inOrder(rows) {
  const shown = rows.filter((row) => row.handled.length || row.queued.length || row.held.length || row.connected.length);
  const modules = new Map();
  for (const row of shown) modules.set(row.module, [...modules.get(row.module) ?? [], row]);
  const others = modules.get("") ?? [];
  modules.delete("");
  return [...modules.values()].flat().concat(others.filter((row) => row.suspends), others.filter((row) => !row.suspends));
}

// The place of each row, from 0 on, and the total height. `scale`: pixels a second if the whole run is shown; it does not
// change when the reader zooms.
export function placed(rows, { scale, now }) {
  let top = 0;
  const layout = rows.map((row) => {
    const waiting = row.queued.length, isWithoutModule = !row.module; // it has only waiting bars
    const [most, first] = isWithoutModule ? [FEW, FIRST_OF_FEW] : [MOST_WAIT, FIRST], isLong = waiting > most, queuedLanes = isLong ? first : waiting;
    const isCurve = isLong || waiting > 1 && row.queued.areNarrow(HATCHED / scale, now); // one bar needs no curve
    const handledLanes = isWithoutModule ? 0 : Math.min(Math.max(row.handled.length, 1), MOST_LANES);
    const queuedStep = isWithoutModule ? NAMED : THIN;
    const heldLanes = Math.min(row.held.length, MOST_HELD), curveHeight = isCurve ? CURVE : 0, tall = handledLanes * LANE + queuedLanes * queuedStep + heldLanes * THIN + curveHeight;
    const place = { row, top, bottom: top + tall, handledLanes, queuedLanes, heldLanes, queuedStep, curveHeight };
    top += tall + BETWEEN;
    return place;
  });
  return { layout, tall: top };
}

// Draw the queue length as a curve: in each column of pixels its maximum, and as text the maximum in sight.
export function drawCurve(context, counts, { left, y, tall, ink, paper, state }) {
  const most = counts.reduce((one, other) => Math.max(one, other), 0);
  if (!most) return;
  context.fillStyle = ink;
  context.globalAlpha = 0.35;
  counts.forEach((count, x) => context.fillRect(left + x, y + tall * (1 - count / most), 1, tall * count / most));
  context.globalAlpha = 1;
  const text = `up to ${most.toLocaleString("en")} ${state}`, begin = left + 4;
  context.textAlign = "left";
  context.lineJoin = "round";
  context.lineWidth = 3;
  context.strokeStyle = paper; // an outline around the letters
  context.strokeText(text, begin, y + tall / 2 + 0.5);
  context.lineWidth = 1;
  context.fillText(text, begin, y + tall / 2 + 0.5);
}
