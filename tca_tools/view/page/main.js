// Connects the parts of the page, which share a cursor in time and a chosen task, and fetches new rows from the server.

import { Causes } from "./causes.js";
import { Chart } from "./chart.js";
import { Details } from "./details.js";
import { dot, element, updateAges } from "./dom.js";
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

const ADVANCE_INTERVAL = 250; // milliseconds between two frames while the time of a live run passes
const RETRY_DELAY = 2000; // milliseconds before the next request, if the server did not answer or the journal is damaged
const LAST_SECONDS = 30; // the stretch that the key "l" shows
const TABS = ["task", "messages", "traffic"];
const AGES_INTERVAL = 900; // milliseconds between two updates of the durations of waits

const store = new Store();
let cursor = Infinity; // Infinity: the present end
let isDrawScheduled = false;
let agesUpdated = 0; // when the durations of waits were last updated
let isAddressApplied = false; // whether the time and task of the address have been applied

async function ask(what, parameters = {}) {
  const finite = Object.entries(parameters).filter(([, value]) => value !== Infinity); // without "at", the answer is about the end
  try {
    const answer = await fetch(`api/${what}?${new URLSearchParams({ ...Object.fromEntries(finite), ...ofRun(store.head) })}`);
    return await answer.json();
  } catch {
    return null; // showStatus reports a server that does not answer
  }
}

// Move the cursor. With `followCurrent` the tree scrolls to the current task.
function setTime(time, { keepPlaying = false, followCurrent = time === Infinity && !keepPlaying } = {}) {
  if (!keepPlaying) slider.stop();
  if (followCurrent) tree.followsCurrent = true;
  cursor = time >= store.end ? Infinity : Math.max(time, store.start);
  slider.time = Math.min(cursor, store.end); // at once, since the next key may be pressed before the next frame
  if (!keepPlaying) reveal(cursor);
  draw();
}

// Move the cursor while the run is played.
function playTo(time) {
  if (store.lastEntry(time) !== store.lastEntry(tree.time)) return setTime(time, { keepPlaying: true });
  cursor = time;
  drawTime(time);
}

// Choose a task or message, or any other number of an address.
function choose(id) {
  const task = store.byId.get(id);
  openTab("task");
  details.show(id, cursor);
  if (task) {
    if (task.time > cursor) setTime(task.time);
    tree.reveal(task, Math.min(cursor, store.end)); // the time that all parts show next
  } else {
    tree.chooseNone();
  }
  chart.showChosen(id, Math.min(cursor, store.end));
  writeAddress();
}

const reveal = (time) => chart.reveal(Math.min(time, store.end));
const followCurrent = () => { tree.followsCurrent = true; };
const callbacks = { choose, setTime, playTo, reveal, followCurrent, ask };
const tree = new Tree(store, callbacks);
const chart = new Chart(store, callbacks);
const slider = new Slider(store, callbacks);
const steering = new Steering(store, { toEnd: () => setTime(Infinity) });
const details = new Details(store, { ...callbacks, answered: (about) => steering.show(about, cursor === Infinity) });
const messages = new Messages(store, callbacks);
const traffic = new Traffic(store, { find: (words) => search.lookFor(words) });
const pictures = new Pictures(store, callbacks);
const causes = new Causes(store, callbacks);
const search = new Search(store, { tree, choose, setTime, changed: draw });
new Outcomes(store);
const runs = new Runs(store, { isMoved: () => cursor !== Infinity || details.id !== null || search.input.value !== "" });

// Draw all parts, at most once a frame.
function draw() {
  if (isDrawScheduled) return;
  isDrawScheduled = true;
  requestAnimationFrame(() => {
    isDrawScheduled = false;
    if (!store.head) return;
    if (cursor === Infinity) store.advance();
    const time = Math.min(cursor, store.end);
    updateAges(time);
    search.update(time);
    tree.show(time);
    chart.show(time);
    slider.show(time, cursor === Infinity);
    details.show(details.id, time);
    messages.show(time);
    traffic.show(time);
    pictures.show(time);
    drawCounts(time);
    showMembers(time);
    causes.show(time);
    writeAddress();
  });
}

function advance() {
  if (cursor !== Infinity || !store.isLive || !store.times.length || document.hidden) return;
  store.advance();
  drawTime(store.end);
}

// Between two entries only the time changes: draw the cursor, the chart's end and the durations.
function drawTime(time) {
  slider.show(time, cursor === Infinity);
  chart.show(time);
  if (performance.now() - agesUpdated < AGES_INTERVAL) return;
  agesUpdated = performance.now();
  updateAges(time);
  traffic.show(time);
}

function drawCounts(time) {
  const chips = store.counts(time).map(([standing, count]) => {
    const chip = element("button", { title: `go to the next task: ${standing}` }, dot(store.head.fills[standing]), element("span", { text: `${count} ${standing}` }));
    chip.dataset.state = standing;
    chip.addEventListener("click", () => goToNext(standing, time));
    return chip;
  });
  document.getElementById("counts").replaceChildren(...chips);
}

function goToNext(standing, time) {
  const sent = store.tasks.slice(0, store.countSent(store.tasks, time)), begin = sent.indexOf(store.byId.get(details.id)) + 1;
  const next = [...sent.slice(begin), ...sent.slice(0, begin)].find((task) => store.standingOf(task, time) === standing);
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

// Write time and task into the address, so that the user can share it.
function writeAddress() {
  if (!isAddressApplied) return; // it would overwrite the address before it is applied
  const parts = [];
  if (cursor !== Infinity) parts.push(`t=${cursor}`);
  if (details.id !== null) parts.push(`task=${details.id}`);
  const address = `${location.pathname}${runs.search(parts.length > 0)}${parts.length ? `#${parts.join("&")}` : ""}`;
  if (address !== location.pathname + location.search + location.hash) history.replaceState(null, "", address);
}

// Go to the time and task of an address; without a time, to `defaultTime`.
function applyAddress(hash, defaultTime) {
  const fields = new URLSearchParams(hash.slice(1)), time = fields.has("t") ? Number(fields.get("t")) || 0 : defaultTime;
  if (time !== undefined) setTime(time, { followCurrent: true });
  if (fields.has("task")) choose(Number(fields.get("task")));
}

// --- news ------------------------------------------------------------------------------------------------------------

const MEANINGS = {
  live: "central is running: the page follows the run",
  ended: "central ended this run",
  "not closed": "this run is unfinished: central was killed, or the journal is a copy of a live one",
};

// Show the run's name and state, and a problem if there is one. `noAnswer`: why the server can't be reached.
function showStatus(noAnswer = "") {
  const { head } = store, badge = document.getElementById("status"), problem = document.getElementById("problem");
  const name = document.getElementById("name");
  name.textContent = head?.name ?? "…";
  name.title = head?.name ?? "";
  document.title = head ? `${head.name} – tca view` : "tca view";
  const error = noAnswer || head?.problem || "", text = error || head?.remark || "";
  problem.hidden = !text;
  problem.textContent = text;
  const state = head?.state ?? "reading";
  badge.textContent = noAnswer ? "no answer" : state === "reading" ? `reading, ${store.times.length} entries` : state;
  badge.className = `badge ${error || state === "not closed" ? "bad" : state === "live" ? "live" : ""}`;
  badge.title = MEANINGS[state] ?? "";
}

// Show how many centrals can take over, in a run with a replicated log.
function showMembers(time) {
  const badge = document.getElementById("members"), found = store.members.findLast((one) => one.time <= time);
  badge.hidden = !found;
  if (!found) return;
  badge.textContent = found.standbys === 1 ? "1 standby" : `${found.standbys || "no"} standbys`;
  badge.className = `badge ${found.standbys ? "live" : "bad"}`;
  badge.title = found.text;
}

async function follow() {
  for (let isAway = false; ;) {
    try {
      await store.fetchMore(isAway); // after a failure, request an answer at once
      isAway = false;
      showStatus();
      runs.update();
      draw();
      if (!isAddressApplied && store.head.caughtUp) {
        isAddressApplied = true;
        if (!location.hash && store.head.state === "ended") tree.showTop(store.end);
        applyAddress(location.hash);
      }
      if (store.head.state === "damaged") await pause(RETRY_DELAY); // the server answers at once, since there will be no news
    } catch (error) {
      isAway = true;
      store.stopClock();
      showStatus(`The server does not answer (${error.message}). The page shows the part read before. Start 'tca view' again.`);
      await pause(RETRY_DELAY);
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
  Home: () => setTime(store.start, { followCurrent: true }),
  End: () => setTime(Infinity),
  "[": () => goToFailure(-1),
  "]": () => goToFailure(1),
  "/": () => search.input.focus(),
  f: () => chart.zoomOut(),
  l: () => chart.showLast(chart.lastSeconds === null ? LAST_SECONDS : null),
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
window.addEventListener("hashchange", ({ newURL }) => isAddressApplied && applyAddress(new URL(newURL).hash, Infinity)); // pasted into an open page
setInterval(advance, ADVANCE_INTERVAL);
window.tca = { store, tree, chart, slider }; // for the browser's console
follow();
