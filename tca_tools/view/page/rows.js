// Which rows the chart has, and how tall they are: those of a module stand together, what is no module's below them.

export const LANE = 18, THIN = 7, NAMED = 14, BETWEEN = 9;
const CURVE = 18;
const MOST_LANES = 12, MOST_HELD = 3;
const MOST_WAIT = 6, FIRST = 5; // of more that wait the first are drawn, and how many there are (as in gantt/queues.py)
const FEW = 3, FIRST_OF_FEW = 2; // the same of what is no module's: it may stay for long
const HATCHED = 14; // pixels: of bars that wait and are mostly narrower the number is drawn, too

// The rows in which there is anything, in the order in which they stand; the modules as they came.
export function inOrder({ rows, suspended }) {
  const of = new Map();
  for (const row of [...rows.filter(({ module }) => module), suspended, ...rows.filter(({ module }) => !module)]) {
    if (!of.has(row.module)) of.set(row.module, []);
    of.get(row.module).push(row);
  }
  return [...of.values()].flat().filter((row) => row.handled.length || row.queued.length || row.held.length || row.connected.length);
}

// Where each of them stands, from 0 on; and how tall they are together. `scale`: pixels a second where all of the run is
// seen, until now; it does not change as the reader zooms.
export function placed(rows, { scale, now }) {
  let top = 0;
  const layout = rows.map((row) => {
    const waiting = row.queued.length, isNobodys = !row.module; // there is nothing else in it
    const [most, first] = isNobodys ? [FEW, FIRST_OF_FEW] : [MOST_WAIT, FIRST], isLong = waiting > most, thin = isLong ? first : waiting;
    const isCurve = isLong || row.queued.most(-Infinity, now) > 1 && row.queued.areNarrow(HATCHED / scale, now); // one is nothing to compare
    const lanes = isNobodys ? 0 : Math.min(Math.max(row.handled.length, 1), MOST_LANES), step = isNobodys ? NAMED : THIN;
    const held = Math.min(row.held.length, MOST_HELD), curve = isCurve ? CURVE : 0, tall = lanes * LANE + thin * step + held * THIN + curve;
    const place = { row, top, bottom: top + tall, lanes, thin, held, step, curve };
    top += tall + BETWEEN;
    return place;
  });
  return { layout, tall: top };
}
