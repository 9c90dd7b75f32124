// Times, counts and links in words, and descriptions of the chart's spans. The server composes all other sentences.

import { wasHandled } from "./store.js";

export const numbered = (name, number) => (number ? `${name} {${number}}` : name);

export const counted = (number, one) => `${number.toLocaleString("en")} ${one}${number === 1 ? "" : "s"}`;

const two = (number) => String(number).padStart(2, "0");

// A time: "12.300 s", "1:51:48.5".
export function seconds(time, digits = 3) {
  if (!Number.isFinite(time)) return "…";
  if (Math.abs(time) < 600) return `${time.toFixed(digits)} s`;
  const whole = Math.floor(time), hours = Math.floor(whole / 3600), minutes = Math.floor(whole / 60) % 60;
  const places = digits < 3 && hours ? 0 : 1; // where there is little room, and much time
  const rest = (Math.floor((time - Math.floor(time / 60) * 60) * 10) / 10).toFixed(places).padStart(places ? 4 : 2, "0");
  return hours ? `${hours}:${two(minutes)}:${rest}` : `${minutes}:${rest}`;
}

// How long something took, as in measures.py: "742 µs", "12.3 ms", "1.5 s", "12:05 min", "33:09:06 h".
export function duration(time) {
  if (!(time >= 5e-7)) return "0 s";
  for (const [unit, size] of [["µs", 1e-6], ["ms", 1e-3]]) {
    if (time < 999.5 * size) return `${Number((time / size).toPrecision(3))} ${unit}`;
  }
  if (time < 119.5) return `${Number(time.toPrecision(3))} s`;
  const whole = Math.round(time), minutes = Math.floor(whole / 60);
  return minutes < 120 ? `${minutes}:${two(whole % 60)} min` : `${Math.floor(minutes / 60)}:${two(minutes % 60)}:${two(whole % 60)} h`;
}

// Split a text of the server at its tasks, such as "name {7}". `nameOf` returns a task's name: other braces are the user's.
export function parted(text, nameOf) {
  const [first, ...pieces] = text.split("{"), parts = [first];
  for (const piece of pieces) {
    const [digits] = piece.split("}", 1), name = `${nameOf(Number(digits))} `, before = parts.pop();
    if (before.slice(-name.length) === name) {
      parts.push(before.slice(0, -name.length), { text: `${name}{${digits}}`, number: Number(digits) }, piece.slice(digits.length + 1));
    } else {
      parts.push(`${before}{${piece}`);
    }
  }
  return parts;
}

const VERBS = { handling: "handled by", queued: "queued for", held: "has", suspended: "suspended", waiting: "waits in" };

// Describe a span as known at a time. Later events are marked as later.
export function spanWords({ span: one, wait, row, failure, change }, store, time) {
  const shown = wait ?? one, later = ((failure ?? change)?.time ?? shown.start) > time ? "later: " : "";
  if (failure) {
    const handled = wasHandled(failure, time) ? ", and handled" : "";
    return `${later}a failure was raised on ${called(one)}, beside its handler, at ${seconds(failure.time)}${handled}`;
  }
  if (change) return `${later}${change.text}`;
  if (wait) return `${later}${subjectOf(one, store)} in ${row.label} waits for ${called(wait)}${spanTimes(wait, "", store, time)}`;
  const where = one.kind === "suspended" ? one.by : ` ${row.label}`, handled = wasHandled(one.failure, time) ? ", and handled" : "";
  const how = one.outcome && one.outcome !== "done" ? `: ${one.outcome}${handled}` : "";
  const ahead = one.kind === "handling" && store.previewOf(store.byId.get(one.message), time);
  return `${later}${subjectOf(one, store)}${ahead ? ` (${ahead})` : ""} ${VERBS[one.kind]}${where}${spanTimes(one, how, store, time)}`;
}

const called = ({ name, message }) => numbered(name, message);

function subjectOf(one, store) {
  return one.message && one.kind === "held" ? `${one.name}, handling ${numbered(store.byId.get(one.message)?.name ?? "message", one.message)},` : called(one);
}

// The start, end, duration and outcome of a span. If it is open at `time`, its end is marked as later.
function spanTimes({ start, end }, how, store, time) {
  const isWhole = end <= time || start > time, last = `${seconds(end)} (${duration(Math.min(end, store.end) - start)})`;
  if (isWhole && end < Infinity) return `${how}: ${seconds(start)} – ${last}`;
  const soFar = `: since ${seconds(start)} (${duration((isWhole ? store.end : time) - start)} so far)`;
  return end === Infinity ? soFar : `${soFar}; later${how}: until ${last}`;
}
