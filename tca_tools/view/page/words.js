// Everything that the page says of waits, failures and spans of time, made from data. A wait is a WaitFor of
// tca_wire/waits.py, said as waits_in_words.py says it. Words are lists of parts: texts, and tasks as { text, number }.

import { wasHandled } from "./store.js";

const NAMED = 3; // of several
const MOST = 100; // of others that are counted, as in ends.py
const REACHED = {
  0: ["has", "ended"], 1: ["is", "being handled"], 2: ["has", "been handled"], 4: ["is", "being planned"],
  8: ["is", "planned"], 16: ["is", "being achieved"], 32: ["is", "achieved"],
};
const MOMENTS = {
  1: "start handling", 2: "end handling", 4: "start planning", 8: "end planning", 16: "start achieving", 32: "end achieving",
};
const TOGETHER = new Set(["constraint", "subtask", "task", "handler", "presence", "reply", "running"]); // told in one clause
const WAITS = "waits"; // may be left out
const LEADS_ON = new Set(["constraint", "subtask", "task", "parent", "reply"]); // kinds that say no more than what is waited for

// How much is left out where there is little room: nothing; for what a resource is taken; how that is said; that a query is
// waited for, not what it asks; all names but the first; why it is so.
const WHOLE = 0, NO_PURPOSE = 1, BY = 2, TERSE = 3, FIRST = 4, ALONE = 5;

function t(texts, ...values) {
  return texts.flatMap((text, place) => [text, values[place] ?? ""].flat()).filter((part) => part !== "");
}

export const plain = (parts) => parts.map((part) => part.text ?? part).join("");

export const numbered = ({ name, number }) => (number ? { text: `${name} {${number}}`, number } : name);

function joined(several, between) { return several.flatMap((parts, place) => (place ? [between, ...[parts].flat()] : parts)); }

// "a, b, c and 52 more"
function listed(names, more = 0, most = NAMED) {
  const rest = more + Math.max(names.length - most, 0), told = names.slice(0, most);
  if (rest) told.push(`${count(rest)} more`);
  return told.length > 1 ? [...joined(told.slice(0, -1), ", "), " and ", told.at(-1)] : told;
}

// --- numbers and times -----------------------------------------------------------------------------------------------

export const count = (number) => number.toLocaleString("en");

export const counted = (number, one) => `${count(number)} ${one}${number === 1 ? "" : "s"}`;

const two = (number) => String(number).padStart(2, "0");

// A moment: "12.300 s", "1:51:48.5".
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

// --- waits -----------------------------------------------------------------------------------------------------------

// What goes after "waits": "until a {1} and b {2} are achieved, and for legs".
export function waitsFor(waits, brief = WHOLE) { return joined(clauses(waits, brief).map(({ parts }) => parts), ", and "); }

// The same one by one, each with the waits of which it tells.
export function clauses(waits, brief = WHOLE) {
  const groups = new Map();
  for (const wait of waits) {
    const isPlain = TOGETHER.has(wait.kind) && !wait.because?.length;
    const key = isPlain ? `${wait.kind} ${wait.moment} ${wait.seconds}` : wait;
    groups.set(key, [...groups.get(key) ?? [], wait]);
  }
  return [...groups.values()].map((some) => ({ waits: some, parts: CLAUSES[some[0].kind](some, brief) }));
}

const CLAUSES = {
  constraint: until,
  subtask: until,
  task: until,
  parent: (waits) => t`until its parent ${names(waits)} ${reached(waits[0].moment)}`,
  listener: (waits) => t`until ${names(waits)}, the listener of a wiretap${by(waits[0].module)}, ${reached(waits[0].moment)}`,
  delay: ([{ seconds: end }]) => [end === undefined ? "until a delay is over" : `until ${seconds(end)}`],
  resource: ([wait], brief) => t`for ${place(wait)}${wait.more ? ` (or ${wait.more} more)` : ""}${kept(wait.because, brief)}`,
  handler: (waits) => handlers(waits),
  presence: (waits) => handlers(waits),
  reply: ([first, ...others], brief) => {
    const all = [first, ...others], what = brief >= TERSE ? "" : `the ${number(all) === 1 ? "reply" : "replies"} to `;
    return t`for ${what}${names(all, brief)}${whereabouts(first, brief)}`;
  },
  lock: ([wait], brief) => {
    const of = numbered({ name: `${wait.name || "lock"} of ${place(wait)}`, number: brief >= TERSE ? 0 : wait.number });
    return t`for the ${of}${kept(wait.because, brief)}`;
  },
  resume: ([wait]) => {
    const who = wait.module ? `suspended${by(wait.module)}` : "";
    return wait.number ? t`until ${numbered(wait)}${who && `, ${who},`} is resumed` : t`until it is resumed${who && ` (${who})`}`;
  },
  recovery: ([wait]) => t`until ${wait.number ? numbered(wait) : "somebody"} has dealt with ${wait.failure ?? "its failure"}`,
  condition: ([{ name, number: query, holds }]) => {
    if (!name) return ["until it is fired"];
    const last = holds === undefined ? "has not been tested" : holds ? "held" : "did not hold";
    return t`for its condition ${numbered({ name, number: query })}, which ${last}`;
  },
  running: (waits, brief) => {
    const several = number(waits) > 1, whose = waits[0].number ? t`the handler${several ? "s" : ""} of ${names(waits)}` : "its handler";
    const where = waits[0].module && !several ? ` in ${place(waits[0])}` : "";
    return t`until ${whose}${where} return${several ? "" : "s"}${waits[0].because ? t`, which waits ${waitsFor(waits[0].because, brief)}` : ""}`;
  },
  locked: ([wait]) => [`until ${wait.module} releases ${wait.resource}`],
  circle: (waits) => t`for itself, by way of ${names(waits)}`,
};

const number = (waits) => waits.reduce((sum, { more = 0 }) => sum + 1 + more, 0);

function names(waits, brief = WHOLE) {
  return listed(waits.map(numbered), waits.reduce((sum, { more = 0 }) => sum + more, 0), brief >= FIRST ? 1 : NAMED);
}

function until(waits, brief) {
  const delay = waits[0].seconds ? `${duration(waits[0].seconds)} after ` : "";
  return t`until ${delay}${names(waits, brief)} ${reached(waits[0].moment, number(waits))}`;
}

// "is achieved", "have been handled"
function reached(moment = 0, several = 1) {
  const [verb, rest] = REACHED[moment];
  return `${several === 1 ? verb : { is: "are", has: "have" }[verb]} ${rest}`;
}

function handlers(waits) {
  const all = listed(waits.map(({ name }) => name), waits.reduce((sum, { more = 0 }) => sum + more, 0));
  return number(waits) === 1 ? t`for a module that handles ${all}` : t`for modules that handle ${all}`;
}

// A module's resource: only the module's name where both are named alike.
function place({ module = "", resource = "" }) { return ["", module].includes(resource) ? module : `${module} / ${resource}`; }

// Who asked for something. Commands of the command line are modules of such names as "tca kill#7".
export function by(who) {
  if (!who) return "";
  return who.slice(0, 4) === "tca " ? ` by the command '${who.split("#")[0]}'` : ` by ${who}`;
}

// What keeps others out of a resource: ", busy with walk {3} and 2 more", ", which panel has locked".
function kept(because = [], brief = WHOLE) {
  if (brief >= ALONE) return [];
  const running = because.filter(({ kind }) => kind === "running"), others = because.filter(({ kind }) => kind !== "running");
  const parts = running.length ? [t`busy with ${names(running, brief)}`] : [];
  for (const one of others) parts.push(keeper(one, brief, !running.length));
  return parts.length ? [", ", ...joined(parts, ", and ")] : [];
}

function keeper({ kind, name, module, because }, brief, isFirst) {
  const verb = name === "reservation" ? "reserve" : "lock", done = `${verb}${verb === "lock" ? "ed" : "d"}`;
  if (kind === "handler") return ["which has no handler now"];
  if (kind === "locked" && brief >= BY) return [`${done} by ${module}`];
  const how = because?.[0]?.kind === "running" ? "while handling" : "for";
  const whose = because?.length && brief < NO_PURPOSE ? t` ${how} ${numbered(because[0])}` : [];
  return kind === "locked" ? t`which ${module} has ${done}${whose}` : t`which ${module} waits to ${verb}${isFirst ? "" : " first"}${whose}`;
}

// Where a query is: ", which no module handles"; and who has not answered one that many were asked.
function whereabouts({ because, answered = 0 }, brief) {
  if (!because?.length || brief >= ALONE) return [];
  return [", which ", ...because.length > 1 || answered ? notAnswered(because, answered, brief) : whereIs(because[0], brief)];
}

function whereIs(where, brief) {
  if (where.kind === "handler") return ["no module handles"];
  if (where.kind === "resource") return t`is queued ${CLAUSES.resource([where], brief)}`;
  return t`${place(where)} handles${where.because?.length ? t` and waits ${waitsFor(where.because, brief)}` : ""}`;
}

function notAnswered(because, answered, brief) {
  const all = because.length, told = answered ? ` (${answered} of ${answered + all} ${has(answered)})` : "";
  const who = because.map((where) => plain(where.kind === "resource" ? t`${place(where)} (queued${kept(where.because, brief)})` : [place(where)]));
  return t`${listed(who)} ${has(all)} not answered${told}`;
}

const has = (several) => (several === 1 ? "has" : "have");

// --- in the end ------------------------------------------------------------------------------------------------------

// What it is, by its number, and why it waits for nothing else: "calibrate {343}, which no module handles, and for 2 others".
export function end({ thing, number: task, which, others = 0 }, brief = WHOLE) {
  return [{ text: thing, number: task }, brief >= ALONE ? "" : `, which ${which}`, others ? `, and for ${more(others)}` : ""];
}

const more = (others) => (others < MOST ? counted(others, "other") : `${MOST} or more others`);

// The same behind a wait for that alone: "no module handles that"; else all of it.
function lastly([only, other], last) {
  const isThat = only && !other && LEADS_ON.has(only.kind) && !only.more && !only.because && only.number === last.number;
  return isThat ? [last.that, last.others ? `; in the end also for ${more(last.others)}` : ""] : t`in the end for ${end(last)}`;
}

// --- rows of the tree ------------------------------------------------------------------------------------------------

// What is said of a task: what comes before its waits and behind them, or all there is where it waits for nothing.
function around({ failure, killed, waits, ahead = [], suspended }, state) {
  const failed = failure ? failureLine(failure) : "", coming = ahead.join("; ");
  if (state === "killed" || state === "ending") {
    const why = state === "ending" && failed ? failed : `killed${killed ? `: ${killed}` : ""}`;
    return { before: waits.length ? `${why}; ` : why, behind: "" };
  }
  if (waits.length) {
    const isTold = waits.some(({ kind }) => kind === "recovery");
    return { before: failed && !isTold ? `${failed}; ` : "", behind: coming ? ` (${coming})` : "" };
  }
  if (failed) return { before: `${state}: ${failed}`, behind: "" };
  if (suspended) return { before: `still runs, though ${plain([numbered(suspended)])} is suspended`, behind: "" };
  return { before: coming || state, behind: "" };
}

// As much of a note as has room, the best first: [what keeps the task, what it comes to in the end]; `names` says how many
// tasks that names, `isWhole` whether it still says why. The end is left whole before the rest is; where both have no
// room, the end alone is what a reader needs. `hasRoom` is asked of two texts.
export function abridged(note, state, hasRoom) {
  const { before, behind } = around(note, state), waits = withFailure(note), { end: last, how } = note;
  const text = (brief, verb = "") => t`${before}${waits.length ? [verb, ...waitsFor(waits, brief)] : []}${brief > WHOLE ? "" : behind}`;
  const made = (what, lastly_, isWhole = true) => ({ parts: [plain(what), plain(lastly_)], names: namesIn(what) + namesIn(lastly_), isWhole });
  const brief = last ? t`in the end for ${end(last, ALONE)}` : [], ends = last ? [lastly(waits, last), brief] : [brief];
  const bare = how === WAITS ? "" : `${how} `, verbs = waits.length ? [`${how} `, bare] : [""];
  const levels = last ? [BY, TERSE, FIRST] : [NO_PURPOSE, BY, TERSE, FIRST];
  const found = [
    ...ends.flatMap((one) => verbs.map((verb) => [text(WHOLE, verb), one])),
    ...levels.flatMap((level) => (last ? [bare] : verbs).map((verb) => [text(level, verb), brief])),
  ].find(([what, lastly_]) => hasRoom(plain(what), plain(lastly_)));
  if (found) return made(...found);
  const holder = !last && waits.length === 1 && ["resource", "lock"].includes(waits[0].kind) ? kept(waits[0].because, FIRST) : [];
  if (holder.length) { // it is told before all of the name of what it holds
    const what = cut(t`for ${place(waits[0])}`, 1, (one) => hasRoom(one + plain(holder), ""));
    if (what) return made([...what, ...holder], []);
  }
  const short = cut(text(TERSE), last ? 2 : 1, (one) => hasRoom(one, plain(brief)));
  if (!last) return made(short ?? [`${plain(text(TERSE)).split(" ")[0]} …`], [], false);
  if (namesIn(short ?? [])) return made(short, brief, !waits.some(({ because }) => because));
  const alone = [t`in the end for ${end(last)}`, t`for ${end(last)}`, brief, t`for ${end(last, ALONE)}`];
  return made([], alone.find((one) => hasRoom("", plain(one))) ?? alone.at(-1));
}

const namesIn = (parts) => parts.filter((part) => part.number).length;

// All of it, for the mouse.
export function whole(note, state) {
  const { before, behind } = around(note, state), waits = withFailure(note);
  const text = waits.length ? plain(t`${before}${note.how} ${waitsFor(waits)}${behind}`) : before;
  const failed = note.failure ? [note.failure.name, note.failure.text].filter(Boolean).join(": ") : "";
  const told = failed && !["recovering", "ending"].includes(state) ? [failed] : [text, failed];
  if (before === state && !waits.length) told.shift();
  return [...told, note.end ? plain(lastly(waits, note.end)) : ""].filter(Boolean).join("\n\n");
}

function withFailure({ waits, failure }) {
  return failure ? waits.map((wait) => (wait.kind === "recovery" ? { ...wait, failure: failureLine(failure) } : wait)) : waits;
}

// As many of the first words as have room; undefined, if fewer than `least` do.
function cut(parts, least, hasRoom) {
  const words = plain(parts).split(" ");
  while (words.length > least) {
    words.pop();
    if (["and", "for"].includes(words.at(-1))) continue;
    const text = words.join(" "), length = text.length - (text.at(-1) === "," ? 1 : 0);
    if (hasRoom(`${text.slice(0, length)} …`, "")) return [...firstLetters(parts, length), " …"];
  }
  return undefined;
}

function firstLetters(parts, length) {
  const found = [];
  for (const part of parts) {
    const text = part.text ?? part;
    found.push(text.length <= length ? part : text.slice(0, Math.max(length, 0)));
    length -= text.length;
  }
  return found;
}

// --- failures and what is to come ------------------------------------------------------------------------------------

// In a line: of a traceback, what comes before it.
export function failureLine({ name, text }) {
  const [first, ...rest] = [name, text].filter(Boolean).join(": ").trim().split("\n");
  return first + (rest.some((line) => line.trim()) ? " …" : "");
}

// "start achieving not before 3 s after step {3} end achieving"
export function constraint({ moment, before, delay, number: task, name, isOwn }) {
  const after = MOMENTS[moment];
  if (!before) return `${after} not before ${seconds(delay)}`;
  return `${after} not before ${delay ? `${duration(delay)} after ` : ""}${isOwn ? "its own" : numbered({ name, number: task }).text} ${MOMENTS[before]}`;
}

// A text that the server made, in parts: a task stands in it as "name {7}". `nameOf` knows the tasks.
export function parted(text, nameOf) {
  const [first, ...pieces] = text.split("{"), parts = [first];
  for (const piece of pieces) {
    const [digits] = piece.split("}", 1), name = nameOf(Number(digits)), before = parts.pop();
    if (name === undefined) {
      parts.push(`${before}{${piece}`);
      continue;
    }
    const start = before.length - (before.slice(-name.length - 1) === `${name} ` ? name.length + 1 : 0);
    parts.push(before.slice(0, start), { text: `${before.slice(start)}{${digits}}`, number: Number(digits) }, piece.slice(digits.length + 1));
  }
  return parts;
}

// --- spans of the chart ----------------------------------------------------------------------------------------------

const VERBS = { handling: "handled by", queued: "queued for", held: "has", suspended: "suspended", waiting: "waits in" };

// What is known of it at a time; what is to come is said to come later.
export function spanWords({ span: one, wait, row, failure }, store, time) {
  const shown = wait ?? one, later = (failure?.time ?? shown.start) > time ? "later: " : "";
  if (failure) {
    const dealt = wasHandled(failure, time) ? ", and handled" : "";
    return `${later}a failure was raised on ${numbered(taskOf(one)).text}, beside its handler, at ${seconds(failure.time)}${dealt}`;
  }
  if (wait) return `${later}${what(one, store)} in ${row.label} waits for ${numbered(taskOf(wait)).text}${went(wait, "", store, time)}`;
  const where = one.kind === "suspended" ? by(one.by) : ` ${row.label}`, dealt = wasHandled(one.failure, time) ? ", and handled" : "";
  const how = one.outcome && one.outcome !== "done" ? `: ${one.outcome}${dealt}` : "";
  return `${later}${what(one, store)} ${VERBS[one.kind]}${where}${went(one, how, store, time)}`;
}

const taskOf = ({ name, message }) => ({ name, number: message });

function what(one, store) {
  const holder = { name: store.byId.get(one.message)?.name ?? "message", number: one.message };
  return one.message && one.kind === "held" ? `${one.name}, handling ${numbered(holder).text},` : plain([numbered(taskOf(one))]);
}

// From when until when, and how it ended; of what goes on at a time that apart.
function went({ start, end: over }, how, store, time) {
  const isWhole = over <= time || start > time, last = `${seconds(over)} (${duration(Math.min(over, store.end) - start)})`;
  if (isWhole && over < Infinity) return `${how}: ${seconds(start)} – ${last}`;
  const soFar = `: since ${seconds(start)} (${duration((isWhole ? store.end : time) - start)} so far)`;
  return over === Infinity ? soFar : `${soFar}; later${how}: until ${last}`;
}
