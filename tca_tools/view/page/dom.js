// Elements, canvases and timers, for all parts of the page.

import { duration } from "./words.js";

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

// The mark of a state; that of a goal is round.
export function dot(colour, isGoal = false) {
  const made = element("span", { class: isGoal ? "dot goal" : "dot" });
  made.style.background = colour;
  return made;
}

export function css(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
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

// As much of a text on a canvas as is so wide.
export function clipped(context, text, width) {
  if (context.measureText(text).width <= width) return text;
  let cut = text;
  while (cut.length > 1 && context.measureText(`${cut}…`).width > width) cut = cut.slice(0, -1);
  return `${cut}…`;
}

// Measures texts in the letters of an element.
export function ruler(like) {
  const context = document.createElement("canvas").getContext("2d"), { fontWeight, fontSize, fontFamily } = getComputedStyle(like);
  context.font = `${fontWeight} ${fontSize} ${fontFamily}`;
  return (text) => context.measureText(text).width;
}

// Calls `work` soon, and once however often it is asked for meanwhile.
export function soon(work, milliseconds) {
  let timer = null;
  return () => {
    if (timer !== null) return;
    timer = setTimeout(() => { timer = null; work(); }, milliseconds);
  };
}

// --- how long something has gone on ----------------------------------------------------------------------------------

const BRIEF = 5e-4; // seconds: of what has just begun no age is told
let now = 0;

// Elements that say how long something has gone on at the moment that is shown.
export function age(since, before = "", behind = "") {
  const made = element("span", { class: "age" });
  Object.assign(made.dataset, { since, before, behind });
  tell(made);
  return made;
}

function tell(made) {
  const { since, before, behind } = made.dataset, time = now - since;
  made.textContent = before && time < BRIEF ? "" : `${before}${duration(time)}${behind}`;
}

// ", for 3.4 s" and " (8.8 s in all)": for how long one thing keeps a task waiting, and if something else did before, in all.
export function ages({ since, start }) {
  return since - start < BRIEF ? [age(since, ", for ")] : [age(since, ", for "), age(start, " (", " in all)")];
}

export function setTime(time) {
  now = time;
  document.querySelectorAll(".age").forEach(tell);
}
