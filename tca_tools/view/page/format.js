// Times, colours and elements: how things look in every part of the page.

export const NUMBER = /\{\d+\}/;
const STEPS = [60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 28800, 43200, 86400];

export function seconds(time, digits = 3) {
  if (!Number.isFinite(time)) return "…";
  if (Math.abs(time) < 600) return `${time.toFixed(digits)} s`;
  const whole = Math.floor(time), hours = Math.floor(whole / 3600), minutes = Math.floor(whole / 60) % 60;
  const places = digits < 3 && hours ? 0 : 1; // where there is little room, and much time
  const rest = (Math.floor((time - Math.floor(time / 60) * 60) * 10) / 10).toFixed(places).padStart(places ? 4 : 2, "0");
  return hours ? `${hours}:${String(minutes).padStart(2, "0")}:${rest}` : `${minutes}:${rest}`;
}

export function length(time) {
  if (time < 9.995e-4) return `${(time * 1e6).toFixed(0)} µs`; // 1000 of a unit are one of the next
  if (time < 0.9995) return `${(time * 1e3).toFixed(time < 0.01 ? 2 : 0)} ms`;
  return time < 600 ? `${time.toFixed(2)} s` : seconds(time);
}

// How long something has gone on at the moment that is shown: an element that `count` keeps up.
let shown = 0;

// As tca tree says it: "3.40 s", "12:05 min", "33:09:06 h".
function lasting(time) {
  if (time < 120) return length(Math.max(time, 0));
  const [hours, minutes, rest] = [3600, 60, 1].map((one) => Math.floor(time / one)), two = (number) => String(number % 60).padStart(2, "0");
  return minutes < 120 ? `${minutes}:${two(rest)} min` : `${hours}:${two(minutes)}:${two(rest)} h`;
}

export function age(since, before = "") {
  const made = element("span", { class: "age" });
  Object.assign(made.dataset, { since, before });
  tell(made);
  return made;
}

// With what goes before it, if anything does: then nothing is said while there is nothing to say.
function tell(made) {
  const { since, before } = made.dataset, time = shown - since;
  made.textContent = before && time < 5e-4 ? "" : `${before}${lasting(time)}`;
}

// ", for 3.40 s": how long the same keeps something waiting; and " (8.80 s in all)" if it waited for something else before.
export function ages({ since, begun }) {
  const isAll = since !== null && since - begun < 5e-4;
  return [since === null ? "" : age(since, ", for "), isAll ? "" : element("span", { class: "in-all" }, " (", age(begun), " in all)")];
}

// The same in less room: ", for 8.80 s in all".
export function agesInAll({ since, begun }) {
  return since !== null && since - begun < 5e-4 ? age(since, ", for ") : element("span", {}, age(begun, ", for "), " in all");
}

export function count(time) {
  shown = time;
  for (const made of document.querySelectorAll(".age")) tell(made);
}

// As much of a note as has room: who holds something before what he does meanwhile, and before all of its name; then
// what comes first. Between words, if it must be cut. `widthOf` measures a text.
export function abridged(text, room, widthOf) {
  const hasRoom = (one) => widthOf(one) <= room;
  const held = text.replaceAll(/(?: while handling|(?<=(?:locked|reserved)(?: it)?) for) [^,]*?\{\d+\}/g, "");
  const brief = held.replaceAll(/, (?:which|but) ([^,]+?) has (locked|reserved)(?: it)?/g, ", $2 by $1"), bare = brief.replace(/^waits /, "");
  const asked = unsaid(bare), found = [text, held, brief, bare, fewer(bare), asked, fewer(asked)].find(hasRoom);
  if (found !== undefined) return found;
  const short = unnamed(asked), [, what, holder] = /^(.*)(, (?:(?:locked|reserved) by|busy with) .*)$/.exec(short) ?? [];
  if (hasRoom(short)) return short;
  return (holder && cutBehind(what, 2, holder, hasRoom)) ?? cutBehind(asked, 1, "", hasRoom) ?? `${asked.split(" ")[0]} …`;
}

// A lock that is waited for without what its place is called again, and without its own number: what is busy there says more.
function unnamed(text) {
  return text.replace(/(\bof ([^{},]*)) \{\d+\}, but \2 is (?=busy with )/, "$1, ");
}

// A wait for a reply as one for the question: what becomes of that says more.
function unsaid(text) {
  return text.replaceAll(/\bfor the reply to (?=\S)/g, "for ");
}

// A wait for many with the name of the first one: "until bake {3} and 26 more are achieved".
function fewer(text) {
  const count = (_, first, others, more) => `${first} and ${others.split(", ").length - 1 + Number(more ?? 0)} more`;
  return text.replaceAll(/(\buntil [^{},]*\{\d+\})((?:, [^{},]*\{\d+\})+)(?: and (\d+) more)?(?= (?:are|have) )/g, count);
}

// The same of a note, in two parts, what keeps a task and what it comes to in the end: that is left whole before the note
// is, but for why it stands. Where both have no room the end alone is what a reader needs: what is next is found by the
// arrows, and in the pane.
export function withEnd(text, end, alone, room, widthOf) {
  if (!end) return [abridged(text, room, widthOf), ""];
  const hasRoom = (parts) => widthOf(parts.join("; ")) <= room, bare = text.replace(/^waits /, "");
  const [, named, , others] = /^(.*?)(, which .*?)?(, and for \d+ (?:or more )?others?)?$/.exec(end), brief = named + (others ?? "");
  const found = [[text, end], [bare, end], [text, brief], [bare, brief], [fewer(bare), brief], [fewer(unsaid(bare)), brief]].find(hasRoom);
  const left = room - widthOf(`; ${brief}`);
  if (found) return found;
  const kept = abridged(text, left, widthOf), isThat = end !== alone; // the end says "that" of what is named last
  if (left >= widthOf("until its next one …") && (!isThat || NUMBER.test(kept))) return [kept, brief];
  const last = alone.replace(/, which .*?(?=(?:, and for \d+ (?:or more )?others?)?$)/, ""), short = [alone, last].map((one) => one.replace(/^in the end /, ""));
  const only = [alone, short[0], last, short[1]].find((one) => hasRoom(["", one]));
  return ["", only ?? cutBehind(short[1], 2, "", (one) => hasRoom(["", one])) ?? short[1]];
}

// A text without as many of its last words as it takes to have room, with `end` behind it; but with the first `least`.
function cutBehind(text, least, end, hasRoom) {
  const words = text.split(" ");
  while (words.length > least) {
    words.pop();
    const made = `${words.join(" ").replace(/(?:,| and| for)+$/, "")} …${end}`;
    if (hasRoom(made)) return made;
  }
  return undefined;
}

// Measures texts in the letters of an element.
export function ruler(like) {
  const context = document.createElement("canvas").getContext("2d"), { fontWeight, fontSize, fontFamily } = getComputedStyle(like);
  context.font = `${fontWeight} ${fontSize} ${fontFamily}`;
  return (text) => context.measureText(text).width;
}

// Round times between start and end, about `most` of them, with labels.
export function ticks(start, end, most) {
  const shortest = (end - start) / Math.max(most, 1);
  if (!(shortest > 0)) return [];
  let step = STEPS.find((one) => one >= shortest) ?? 86400 * Math.ceil(shortest / 86400);
  if (shortest <= 30) {
    const power = 10 ** Math.floor(Math.log10(shortest));
    step = power * ([1, 2, 5, 10].find((factor) => factor * power >= shortest * (1 - 1e-9)) ?? 10);
    if (step === 50) step = 30;
  }
  const digits = step < 1 ? Math.min(9, Math.ceil(-Math.log10(step) - 1e-9)) : 0, found = [];
  for (let number = Math.ceil(start / step - 1e-9); number * step <= end + step * 1e-9; number++) found.push({ time: number * step });
  const isLong = found.length > 0 && found.at(-1).time >= 600;
  return found.map(({ time }) => ({ time, label: onAxis(time, digits, isLong) }));
}

// As the clock says it, as exactly as the axis needs; all of one axis in seconds, or in minutes.
function onAxis(time, digits, isLong) {
  if (!isLong) return `${time.toFixed(digits)} s`;
  const minutes = Math.floor(Number(time.toFixed(digits)) / 60), hours = Math.floor(minutes / 60);
  const rest = Math.max(time - minutes * 60, 0).toFixed(digits).padStart(digits ? digits + 3 : 2, "0");
  return hours ? `${hours}:${String(minutes % 60).padStart(2, "0")}:${rest}` : `${minutes}:${rest}`;
}

export function css(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

// An element with text and children; text is never read as HTML.
export function element(kind, { text, ...properties } = {}, ...children) {
  const made = document.createElement(kind);
  if (text !== undefined) made.textContent = text;
  for (const [name, value] of Object.entries(properties)) {
    if (name === "class") made.className = value;
    else if (name in made) made[name] = value;
    else made.setAttribute(name, value);
  }
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

// A canvas as large as it is shown, cleared, measured in CSS pixels.
export function prepared(canvas) {
  const width = canvas.clientWidth, height = canvas.clientHeight, scale = window.devicePixelRatio || 1;
  if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
  }
  const context = canvas.getContext("2d");
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

// How many waits far one looks for what is waited for in the end: all, once nothing has changed for a while.
export const CALM = 1000; // milliseconds
export function near(changed) { return performance.now() - changed < CALM ? 500 : Infinity; }

// Calls `work` soon, and once however often it is asked for meanwhile.
export function soon(work, milliseconds) {
  let timer = null;
  return () => {
    if (timer !== null) return;
    timer = setTimeout(() => { timer = null; work(); }, milliseconds);
  };
}

// As much of a text on a canvas as is so wide.
export function clipped(context, text, width) {
  if (context.measureText(text).width <= width) return text;
  let cut = text;
  while (cut.length > 1 && context.measureText(`${cut}…`).width > width) cut = cut.slice(0, -1);
  return `${cut}…`;
}
