// Elements, canvases, timers and ages, for all parts of the page.

import { duration } from "./words.js";

// Create an element with a text and children. Text is never read as HTML.
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

// The coloured mark of a state: round for a goal.
export function dot(colour, isGoal = false) {
  const made = element("span", { class: isGoal ? "dot goal" : "dot" });
  made.style.background = colour;
  return made;
}

// The value of a CSS variable.
export function css(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

// Clear a canvas, and set its resolution to its size on the screen. Returns its context and size in CSS pixels.
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

// A text on a canvas, cut with "…" if it is wider than `width`.
export function clipped(context, text, width) {
  if (context.measureText(text).width <= width) return text;
  let cut = text;
  while (cut.length > 1 && context.measureText(`${cut}…`).width > width) cut = cut.slice(0, -1);
  return `${cut}…`;
}

// A function that measures the width of texts in the font of `model`, an element.
export function ruler(model) {
  const context = document.createElement("canvas").getContext("2d"), { fontWeight, fontSize, fontFamily } = getComputedStyle(model);
  context.font = `${fontWeight} ${fontSize} ${fontFamily}`;
  return (text) => context.measureText(text).width;
}

// A function that calls `work` after a delay, and only once for all calls before that.
export function soon(work, milliseconds) {
  let timer = null;
  return () => {
    if (timer !== null) return;
    timer = setTimeout(() => { timer = null; work(); }, milliseconds);
  };
}

// --- ages: how long something has lasted --------------------------------------------------------------------------------

const SHORTEST_AGE = 5e-4; // seconds: shorter ages are not shown
let now = 0; // the time shown

// An element that shows how long something has lasted at the time shown.
export function age(since, before = "", after = "") {
  const made = element("span", { class: "age" });
  Object.assign(made.dataset, { since, before, after });
  showAge(made);
  return made;
}

function showAge(made) {
  const { since, before, after } = made.dataset, time = now - since;
  made.textContent = before && time < SHORTEST_AGE ? "" : `${before}${duration(time)}${after}`;
}

// ", for 3.4 s" and " (8.8 s in all)": for how long a task has waited for one thing; if it waited for another before, also the
// total.
export function ages({ since, start }) {
  return since - start < SHORTEST_AGE ? [age(since, ", for ")] : [age(since, ", for "), age(start, " (", " in all)")];
}

// Show all ages as of a time.
export function updateAges(time) {
  now = time;
  document.querySelectorAll(".age").forEach(showAge);
}
