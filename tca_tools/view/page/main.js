// Connects the parts of the page: they share one cursor in time and one chosen task, and get new rows from the server.

import { Causes } from "./causes.js";
import { Chart } from "./chart.js";
import { Details } from "./details.js";
import { dot, element, setTime as setAges } from "./dom.js";
import { Messages } from "./messages.js";
import { Outcomes } from "./outcomes.js";
import { Pictures } from "./pictures.js";
import { ofRun, Runs } from "./runs.js";
import { Search } from "./search.js";
import { Slider } from "./slider.js";
import { Steering } from "./steer.js";
import { Store } from "./store.js";
import { Traffic } from "./traffic.js";
import { Tree } from "./tree.js";

const BEAT = 250; // milliseconds between two frames while time passes
const AGAIN = 2000; // milliseconds until the next request to a server that does not answer, or can't read on
const LATELY = 30; // seconds
const TABS = ["task", "messages", "traffic"];
const SLOW = 900; // milliseconds between two updates of the durations of waits

const store = new Store();
let cursor = Infinity; // Infinity: the end, wherever it is
let drawing = false;
let counted = 0; // the time of the last such update
let recalled = false; // whether the moment and task of the address have been applied

async function ask(what, parameters = {}) {
  const known = Object.entries(parameters).filter(([, value]) => value !== Infinity);
  try {
    const answer = await fetch(`api/${what}?${new URLSearchParams({ ...Object.fromEntries(known), ...ofRun(store.head) })}`);
    return await answer.json();
  } catch {
    return null; // the server is away; the page says so already
  }
}

// With `keepUp` the tree scrolls to the current task.
function setTime(time, { keepPlaying = false, keepUp = time === Infinity && !keepPlaying } = {}) {
  if (!keepPlaying) slider.stop();
  if (keepUp) tree.keepsUp = true;
  cursor = time >= store.end ? Infinity : Math.max(time, store.start);
  slider.time = Math.min(cursor, store.end); // at once: the next key may be pressed before the next frame
  if (!keepPlaying) reveal(cursor);
  draw();
}

function reveal(time) { chart.reveal(Math.min(time, store.end)); }

function keepUp() { tree.keepsUp = true; }

// Advance while the run is played.
function playTo(time) {
  if (store.place(time) !== store.place(tree.time)) return setTime(time, { keepPlaying: true });
  cursor = time;
  glide(time);
}

function choose(id) {
  const task = store.byId.get(id);
  openTab("task");
  details.show(id, cursor);
  if (task) {
    if (task.time > cursor) setTime(task.time);
    tree.reveal(task, Math.min(cursor, store.end)); // at the moment that all parts are about to show
  } else {
    tree.leave();
  }
  chart.follow(id, Math.min(cursor, store.end));
  remember();
}

const callbacks = { choose, setTime, playTo, reveal, keepUp, ask };
const tree = new Tree(store, callbacks);
const chart = new Chart(store, callbacks);
const slider = new Slider(store, callbacks);
const steering = new Steering(store, { toEnd: () => setTime(Infinity) });
const details = new Details(store, { ...callbacks, answered: (about) => steering.show(about, cursor === Infinity) });
const messages = new Messages(store, callbacks);
const traffic = new Traffic(store, { find: (words) => search.look(words) });
const pictures = new Pictures(store, callbacks);
const causes = new Causes(store, callbacks);
const search = new Search(store, { tree, choose, setTime, changed: draw });
new Outcomes(store);
const runs = new Runs(store, { isMoved: () => cursor !== Infinity || details.id !== null || search.input.value !== "" });

// Draw all parts, at most once a frame.
function draw() {
  if (drawing) return;
  drawing = true;
  requestAnimationFrame(() => {
    drawing = false;
    if (!store.head) return;
    if (cursor === Infinity) store.goOn();
    const time = Math.min(cursor, store.end);
    setAges(time);
    search.update(time);
    tree.show(time);
    chart.show(time);
    slider.show(time, cursor === Infinity);
    details.show(details.id, time);
    messages.show(time);
    traffic.show(time);
    pictures.show(time);
    drawCounts(time);
    causes.show(time);
    remember();
  });
}

function goOn() {
  if (cursor !== Infinity || !store.isLive || !store.times.length || document.hidden) return;
  store.goOn();
  glide(store.end);
}

// Between two messages only the time changes: move the cursor, extend the chart, update durations.
function glide(time) {
  slider.show(time, cursor === Infinity);
  chart.show(time);
  if (performance.now() - counted < SLOW) return;
  counted = performance.now();
  setAges(time);
  traffic.show(time);
}

function drawCounts(time) {
  const chips = store.counts(time).map(([looks, count]) => {
    const chip = element("button", { title: `go to the next task that is ${looks}` }, dot(store.head.fills[looks]), element("span", { text: `${count} ${looks}` }));
    chip.dataset.state = looks;
    chip.addEventListener("click", () => goToNext(looks, time));
    return chip;
  });
  document.getElementById("counts").replaceChildren(...chips);
}

function goToNext(looks, time) {
  const sent = store.tasks.slice(0, store.sentBy(store.tasks, time)), begin = sent.indexOf(store.byId.get(details.id)) + 1;
  const next = [...sent.slice(begin), ...sent.slice(0, begin)].find((task) => store.looksOf(task, time) === looks);
  if (next) choose(next.id);
}

function openTab(name) {
  document.getElementById("steering").hidden = name !== "task";
  for (const tab of TABS) {
    document.getElementById(tab).hidden = tab !== name;
    document.getElementById(`tab-${tab}`).setAttribute("aria-selected", tab === name);
  }
  if (name === "messages") messages.show(Math.min(cursor, store.end));
  if (name === "traffic") traffic.show(Math.min(cursor, store.end));
}

// Write moment and task into the address, so that the user can share it.
function remember() {
  if (!recalled) return; // the address is applied first
  const parts = [];
  if (cursor !== Infinity) parts.push(`t=${cursor}`);
  if (details.id !== null) parts.push(`task=${details.id}`);
  const wanted = `${location.pathname}${runs.search(parts.length > 0)}${parts.length ? `#${parts.join("&")}` : ""}`;
  if (wanted !== location.pathname + location.search + location.hash) history.replaceState(null, "", wanted);
}

function recall(hash, otherwise) {
  const said = new URLSearchParams(hash.slice(1)), time = said.has("t") ? Number(said.get("t")) || 0 : otherwise;
  if (time !== undefined) setTime(time, { keepUp: true });
  if (said.has("task")) choose(Number(said.get("task")));
}

// --- news ------------------------------------------------------------------------------------------------------------

const MEANINGS = {
  live: "central is running: the page follows the run",
  ended: "central ended this run",
  "not closed": "this run is unfinished: central was killed, or the journal is a copy of a live one",
};

function showStatus(away = "") {
  const { head } = store, badge = document.getElementById("status"), problem = document.getElementById("problem");
  const name = document.getElementById("name");
  name.textContent = head?.name ?? "…";
  name.title = head?.name ?? "";
  document.title = head ? `${head.name} – tca view` : "tca view";
  const wrong = away || head?.problem || "", told = wrong || head?.remark || "";
  problem.hidden = !told;
  problem.textContent = told;
  const state = head?.state ?? "reading";
  badge.textContent = away ? "away" : state === "reading" ? `reading, ${store.times.length} entries` : state;
  badge.className = `badge ${wrong || state === "not closed" ? "bad" : state === "live" ? "live" : ""}`;
  badge.title = MEANINGS[state] ?? "";
}

async function follow() {
  for (let isAway = false; ;) {
    try {
      await store.more(isAway); // after a failure, request an answer at once
      isAway = false;
      showStatus();
      runs.update();
      draw();
      if (!recalled && store.head.caughtUp) {
        recalled = true;
        if (!location.hash && store.head.state === "ended") tree.showTop(store.end);
        recall(location.hash);
      }
      if (store.head.state === "damaged") await pause(AGAIN); // the server has nothing to wait for
    } catch (error) {
      isAway = true;
      store.stand();
      showStatus(`The server does not answer (${error.message}). The page shows the part read before. Start 'tca view' again.`);
      await pause(AGAIN);
      if (error instanceof RangeError || error instanceof TypeError && !navigator.onLine) continue;
    }
  }
}

const pause = (milliseconds) => new Promise((done) => setTimeout(done, milliseconds));

// --- keys, tabs, the divider -----------------------------------------------------------------------------------------

const KEYS = {
  ArrowLeft: () => slider.step(-1),
  ArrowRight: () => slider.step(1),
  ArrowUp: () => moveChoice(-1),
  ArrowDown: () => moveChoice(1),
  Enter: () => tree.toggleChosen(),
  " ": () => slider.toggle(),
  Home: () => setTime(store.start, { keepUp: true }),
  End: () => setTime(Infinity),
  "[": () => goToFailure(-1),
  "]": () => goToFailure(1),
  "/": () => search.input.focus(),
  f: () => chart.showAll(),
  l: () => chart.showLast(chart.last === null ? LATELY : null),
  "?": () => document.getElementById("keys").showModal(),
};

function moveChoice(step) {
  const task = tree.neighbour(step);
  if (task) choose(task.id);
}

function goToFailure(by) {
  const message = slider.stepToFailure(by);
  if (message) choose(message);
}

document.addEventListener("keydown", (event) => {
  if (document.querySelector("dialog[open]")) return; // the dialog handles its keys
  const kind = event.target.tagName, isButton = kind === "BUTTON" && ["Enter", " "].includes(event.key);
  if (isButton || ["INPUT", "SELECT"].includes(kind) || event.ctrlKey || event.metaKey || event.altKey || !KEYS[event.key]) return;
  event.preventDefault();
  KEYS[event.key]();
});
document.addEventListener("click", (event) => {
  if (event.detail && event.target.closest("button")) event.target.closest("button").blur(); // return the keyboard focus to the page
});
for (const tab of TABS) document.getElementById(`tab-${tab}`).addEventListener("click", () => openTab(tab));
document.getElementById("help").addEventListener("click", KEYS["?"]);
document.getElementById("divider").addEventListener("pointerdown", (down) => {
  const move = (event) => {
    const share = Math.min(Math.max(event.clientY / window.innerHeight, 0.2), 0.85);
    document.getElementById("upper").style.flex = `1 1 ${share * 100}%`;
    document.getElementById("gantt").style.flex = `1 1 ${(1 - share) * 100}%`;
  };
  down.target.setPointerCapture(down.pointerId);
  down.target.addEventListener("pointermove", move);
  down.target.addEventListener("pointerup", () => down.target.removeEventListener("pointermove", move), { once: true });
});

document.addEventListener("visibilitychange", draw);
window.addEventListener("hashchange", ({ newURL }) => recalled && recall(new URL(newURL).hash, Infinity)); // pasted into an open page
setInterval(goOn, BEAT);
window.tca = { store, tree, chart, slider }; // for the browser's console
follow();
