// What the chart asks of spans of time: what one says, how full a lane is, where in it something lies.

import { length, seconds } from "./format.js";
import { wasHandled } from "./store.js";

const VERBS = { handling: "handled by", queued: "queued for", held: "has", suspended: "suspended", waiting: "waits in" };

// What is known of it at a time; what is to come is said to come later.
export function describe({ span, wait, row, failure }, store, time) {
  const one = wait ?? span, later = (failure?.time ?? one.start) > time ? "later: " : "";
  if (failure) return `${later}a failure was raised on ${span.name} {${span.message}}, beside its handler, at ${seconds(failure.time)}${wasHandled(failure, time) ? ", and handled" : ""}`;
  if (wait) return `${later}${what(span, store)} in ${row.label} waits for ${wait.name} {${wait.message}}${went(wait, "", store, time)}`;
  const where = span.kind === "suspended" ? span.by : ` ${row.label}`, handled = wasHandled(span.failure, time) ? ", and handled" : "";
  const how = span.outcome && span.outcome !== "done" ? `: ${span.outcome}${handled}` : "";
  return `${later}${what(span, store)} ${VERBS[span.kind]}${where}${went(span, how, store, time)}`;
}

function what(span, store) {
  const holder = store.byId.get(span.message)?.name ?? "message";
  return !span.message ? span.name : span.kind === "held" ? `${span.name}, handling ${holder} {${span.message}},` : `${span.name} {${span.message}}`;
}

// From when until when, and how it ended; of what goes on at a time that apart.
function went({ start, end }, how, store, time) {
  const isWhole = end <= time || start > time, until = `${seconds(end)} (${length(Math.min(end, store.end) - start)})`;
  if (isWhole && end < Infinity) return `${how}: ${seconds(start)} – ${until}`;
  const soFar = `: since ${seconds(start)} (${length((isWhole ? store.end : time) - start)} so far)`;
  return end === Infinity ? soFar : `${soFar}; later${how}: until ${until}`;
}

// Which part of some seconds the spans of a lane between two places take.
export function share(lane, from, to, seconds) {
  const sums = (lane.sums ??= [0]); // of the lengths of all before each place
  while (sums.length <= to) {
    const span = lane[sums.length - 1];
    if (span.end === Infinity) return 1;
    sums.push(sums[sums.length - 1] + span.end - span.start);
  }
  return Math.min((sums[to] - sums[from]) / seconds, 1);
}

// Whether a bar is light, since its handler waits, in more than half of a stretch of time.
export function isLight({ kind, waits }, from, to) {
  let light = 0;
  for (const wait of waits) light += Math.max(Math.min(wait.end, to) - Math.max(wait.start, from), 0);
  return kind === "waiting" || light > (to - from) / 2;
}
