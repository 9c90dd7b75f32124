// The task tree at a time, one line for each task. Only the lines in sight are in the page.

import { ages, dot, element, ruler } from "./dom.js";
import { Notes } from "./notes.js";
import { Outline } from "./outline.js";
import { RESOLVED } from "./store.js";
import { numbered, seconds } from "./words.js";

const ROW = 24; // pixels, as in style.css
const MARKS_WIDTH = 150; // pixels for marks and numbers beside a name
const KIND_MARGIN = 10; // pixels beside the kinds of constraints, as in style.css
const DEEPEST = 18; // the depth of the last indentation; the depth of deeper tasks is written before their names
const ROLE_MARKS = {
  "exception handler": "for a failure", "listener": "by a wiretap", "termination": "to leave things safe", "cancel": "cancels",
};

export class Tree {
  constructor(store, { choose, ask }) {
    this.store = store;
    this.outline = new Outline(store);
    this.choose = choose;
    this.notes = new Notes(store, { ask, changed: () => this.#draw() });
    this.scroller = document.getElementById("rows");
    this.spacer = document.getElementById("spacer");
    this.head = document.querySelector(".heads span"); // the head of the column of names
    this.shownPath = ""; // the tasks whose names the head shows
    this.time = Infinity;
    this.rows = [];
    this.lastHeight = 0; // of the rows' frame when it was last resized, in pixels
    this.widest = 0; // width of the widest name so far, with its indentation, in characters
    this.widthOf = ruler(this.scroller);
    this.found = new Set();
    this.followsCurrent = true; // whether the current task is kept in sight: until the user scrolls
    this.arrows = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    this.arrows.id = "arrows";
    this.scroller.addEventListener("scroll", () => this.#draw());
    for (const scrolling of ["wheel", "pointerdown"]) this.scroller.addEventListener(scrolling, () => { this.followsCurrent = false; }, { passive: true });
    new ResizeObserver(() => this.#onResize()).observe(this.scroller);
    this.spacer.addEventListener("click", (event) => this.#onClick(event));
    this.spacer.addEventListener("dblclick", (event) => this.#toggle(this.#rowOf(event)));
  }

  show(time) {
    this.time = time;
    const seen = this.#rowsInSight();
    this.rows = this.outline.rows(time);
    this.spacer.style.height = `${Math.max(this.rows.length, 1) * ROW}px`;
    const deepest = this.rows.reduce((depth, row) => Math.max(depth, row.depth), 1); // deep trees are indented less
    this.deepest = Math.min(deepest, DEEPEST);
    this.spacer.style.setProperty("--deepest", this.deepest);
    this.#widenNames();
    this.#keepInPlace(seen);
    if (this.followsCurrent) this.#scrollToCurrent();
    this.#draw();
  }

  // Keep the chosen row in sight when the frame gets smaller.
  #onResize() {
    const { scrollTop, clientHeight } = this.scroller, { lastHeight } = this;
    this.lastHeight = clientHeight;
    const top = this.rows.findIndex((row) => row.task && row.task === this.outline.chosen) * ROW;
    const wasSeen = top >= scrollTop && top + ROW <= scrollTop + lastHeight;
    if (wasSeen && top + ROW > scrollTop + clientHeight) this.scroller.scrollTop = top + ROW - clientHeight;
    this.#draw();
  }

  // Make the column of names as wide as the names in it, to leave room for reasons. It never gets narrower: text that moves is hard to read.
  #widenNames() {
    const { widest } = this;
    for (const { task, depth } of this.rows) {
      if (task) this.widest = Math.max(this.widest, task.name.length + Math.min(depth, DEEPEST) * 2);
    }
    if (this.widest !== widest) document.getElementById("tree").style.setProperty("--names", `${this.widest * 7.5 + MARKS_WIDTH}px`);
  }

  // The rows in sight from the top; first the chosen row, if it is in sight.
  #rowsInSight() {
    const { scrollTop, clientHeight } = this.scroller, first = Math.ceil(scrollTop / ROW);
    const rows = this.rows.slice(first, first + Math.max(Math.floor(clientHeight / ROW), 1));
    const chosen = rows.find((row) => row.task && row.task === this.outline.chosen);
    return chosen ? [chosen, ...rows] : rows;
  }

  // Scroll so that the first row of `seen` that still exists keeps its place on the screen.
  #keepInPlace(seen) {
    for (const old of seen) {
      const row = this.rows[old.place], isThere = row && keyOf(row) === keyOf(old);
      const place = isThere ? old.place : this.rows.findIndex((one) => keyOf(one) === keyOf(old));
      if (place < 0) continue;
      if (place !== old.place) this.scroller.scrollTop += (place - old.place) * ROW;
      return;
    }
  }

  #scrollToCurrent() {
    const { chosen } = this.outline, isAlive = chosen && this.store.endOf(chosen, this.time) === null;
    if (isAlive && this.#rowsInSight()[0]?.task === chosen) return; // the user watches the chosen task
    const place = this.#currentPlace();
    if (place >= 0) this.#scrollTo(place);
  }

  // The place of the current task: the last one that is being handled; if there is none, the one that changed last.
  #currentPlace() {
    const { store, time } = this;
    let newest = -Infinity, place = -1;
    for (let i = this.rows.length - 1; i >= 0; i--) {
      const { task } = this.rows[i];
      if (!task) continue;
      if (store.stateAt(task, time) === "handling") return i;
      const changed = store.stateStart(task, time);
      if (changed > newest) [newest, place] = [changed, i];
    }
    return place;
  }

  #scrollTo(place) {
    const top = place * ROW, { scrollTop, clientHeight } = this.scroller;
    if (top < scrollTop || top > scrollTop + clientHeight - 2 * ROW) this.scroller.scrollTop = top - clientHeight / 2;
  }

  // Show the tree from its first task on, with as many of its subtasks as have room.
  showTop(time) {
    this.followsCurrent = false;
    this.outline.openInto(Math.floor(this.scroller.clientHeight / ROW), time);
    this.show(time);
    this.scroller.scrollTop = 0;
  }

  // Choose a task and bring it into sight, in the tree at a time.
  reveal(task, time) {
    this.outline.choose(task);
    this.followsCurrent = false;
    this.show(time);
    let place = this.rows.findIndex((row) => row.task === task);
    if (place < 0 && task.time <= time) {
      this.outline.reveal(task);
      this.show(time);
      place = this.rows.findIndex((row) => row.task === task);
    }
    if (place >= 0) this.#scrollTo(place);
    this.#draw();
  }

  chooseNone() {
    this.outline.choose(null);
    this.#draw();
  }

  // The task `step` rows below the chosen one; above, if it is negative.
  neighbour(step) {
    const tasks = this.rows.filter((row) => row.task);
    const place = tasks.findIndex((row) => row.task === this.outline.chosen);
    return tasks[Math.min(Math.max(place + step, 0), tasks.length - 1)]?.task;
  }

  toggleChosen() { this.#toggle(this.rows.find((row) => row.task && row.task === this.outline.chosen)); }

  #toggle(row) {
    if (!row) return;
    if (!row.task) this.outline.unfolded.add(row.parent);
    else if (row.children) this.outline.toggle(row.task, this.time);
    this.show(this.time);
  }

  #rowOf(event) {
    const line = event.target.closest(".row");
    return line ? this.rows[Number(line.dataset.place)] : null;
  }

  #onClick(event) {
    const row = this.#rowOf(event);
    if (!row) return;
    if (!row.task || event.target.classList.contains("twist")) this.#toggle(row);
    else this.choose(row.task.id);
  }

  #draw() {
    const first = Math.max(Math.floor(this.scroller.scrollTop / ROW) - 4, 0);
    const last = Math.min(first + Math.ceil(this.scroller.clientHeight / ROW) + 8, this.rows.length);
    const lines = [];
    this.whyWidth = document.querySelector(".heads .why").clientWidth;
    this.related = this.#related(this.rows.slice(first, last));
    for (let place = first; place < last; place++) lines.push(this.#line(this.rows[place], place));
    if (!this.rows.length) lines.push(element("div", { class: "row faint", text: "no task was sent yet" }));
    this.spacer.replaceChildren(...lines, this.arrows);
    this.#drawArrows(first, last);
    this.#showPath();
    this.notes.want(this.rows.slice(first, last).flatMap(({ task }) => task ?? []), this.time);
  }

  // Show the ancestors of the first row in sight in the head.
  #showPath() {
    const row = this.rows[Math.ceil(this.scroller.scrollTop / ROW)], path = [];
    for (let above = row?.task?.parent ?? row?.parent; above; above = above.parent) path.unshift(above);
    const key = path.map(({ id }) => id).join(" ");
    if (key === this.shownPath) return; // unchanged links are not replaced: one may be pressed just now
    this.shownPath = key;
    const shown = path.length > 2 ? [path[0], null, path.at(-1)] : path;
    const links = shown.map((task) => (task ? this.#linkTo(task) : element("span", { text: "…" })));
    this.head.replaceChildren(...links.length ? links.flatMap((link) => [link, " ▸ "]) : ["task"]);
    this.head.title = path.map(({ name, id }) => numbered(name, id)).join(" ▸ ");
  }

  #linkTo({ name, id }) {
    const made = element("button", { class: "link", text: `${name} ${id}` });
    made.addEventListener("click", () => this.choose(id));
    return made;
  }

  #line(row, place) {
    const line = element("div", { class: "row" });
    line.dataset.place = place;
    line.style.top = `${place * ROW}px`;
    const task = element("span", { class: "task" });
    task.style.paddingLeft = `calc(${Math.min(row.depth, DEEPEST)} * min(var(--indent), 130px / var(--deepest)))`;
    if (row.task) this.#fillTask(line, task, row);
    else this.#fillFolded(line, task, row);
    return line;
  }

  #fillFolded(line, task, row) {
    line.classList.add("folded");
    task.append(element("span", { class: "twist", text: "…" }), dot(this.store.head.fills[row.state]),
      element("span", { class: "name", text: `${row.folded} tasks ${row.state}` }));
    line.append(task, element("span", { class: "when" }), element("span", { class: "why", text: "click to show them" }));
  }

  #fillTask(line, cell, row) {
    const { task } = row, { fills, handled } = this.store.head, standing = this.store.standingOf(task, this.time), isHandled = standing === handled;
    line.classList.add(...isHandled ? ["failed", "handled"] : [standing === RESOLVED ? "resolved" : standing]);
    line.classList.toggle("chosen", task === this.outline.chosen);
    line.classList.toggle("found", this.found.has(task));
    line.dataset.task = task.id;
    const twist = row.children ? (row.open ? "▾" : "▸") : "";
    if (row.depth > DEEPEST) cell.append(element("span", { class: "more", text: `[${row.depth}]` }));
    cell.append(element("span", { class: "twist", text: twist }), dot(fills[standing], task.form === "goal"),
      element("span", { class: "name", text: task.name }), element("span", { class: "number", text: task.id }));
    if (row.children && !row.open) {
      cell.append(element("span", { class: "more", text: `+ ${row.children}` }));
      if (task.failedBelow <= this.time) cell.append(this.#hiddenFailure(task));
    }
    const mark = task.form === "monitor" ? "monitor" : (ROLE_MARKS[task.role] ?? task.role) || this.store.previewOf(task, this.time);
    const ended = this.store.endOf(task, this.time);
    const when = `${seconds(task.time, 2)} – ${ended === null ? "" : seconds(ended, 2)}`;
    const kinds = this.related.has(task) ? [...this.related.get(task)].join(", ") : "";
    const why = element("span", { class: isHandled ? "why handled" : "why" });
    if (kinds) why.append(element("span", { class: "kind", text: kinds, title: kinds }));
    const room = this.whyWidth - (kinds ? this.widthOf(kinds) + KIND_MARGIN : 0) - 4;
    this.#showWhy(why, this.notes.of(task, this.time), standing, room);
    if (mark) cell.append(element("span", { class: "role", text: mark, title: mark }));
    line.append(cell, element("span", { class: "when", text: when }), why);
    line.title = `${numbered(task.name, task.id)}: ${standing}`;
  }

  #hiddenFailure(task) {
    const isUnhandled = this.store.ancestorsOfUnhandled(this.time).has(task), title = `a task below failed${isUnhandled ? "" : ", and the failure was handled"}`;
    return element("span", { class: isUnhandled ? "hidden-failure" : "hidden-failure handled", text: "▲", title });
  }

  // Show a task's wait with its duration and last cause, or its outcome: as much as has room. Without a note, show its state.
  #showWhy(why, note, standing, room) {
    const { text = "", end = "", whole = "", start } = note ?? {}, what = text || (end ? "" : standing);
    why.title = whole || standing;
    const durations = start === undefined ? [] : ages(note), partWidth = (part) => this.widthOf(part.textContent ?? part);
    const forms = [[what, durations, end], [what, durations.slice(0, 1), end], [what, [], end]];
    const hasRoom = ([first, times, last]) => [first, ...times, last && first ? `; ${last}` : last].reduce((sum, one) => sum + partWidth(one), 0) <= room;
    const [first, times, last] = forms.find(hasRoom) ?? forms.at(-1);
    if (first) why.append(element("span", { class: "what", text: first }), ...times);
    if (last) why.append(element("span", { class: "end", text: first ? `; ${last}` : last }));
  }

  // --- constraint arrows -------------------------------------------------------------------------------------------

  // The tasks with a constraint before or after the chosen one, with the kinds of these constraints.
  #related(rows) {
    const { chosen } = this.outline, found = new Map();
    const add = (task, hold) => hold.time <= this.time && found.set(task, (found.get(task) ?? new Set()).add(hold.kind));
    for (const hold of chosen?.holds ?? []) add(hold.before, hold);
    for (const { task } of chosen ? rows : []) {
      for (const hold of task?.holds ?? []) if (hold.before === chosen) add(task, hold);
    }
    return found;
  }

  #drawArrows(first, last) {
    const places = new Map(), paths = [], cell = this.spacer.querySelector(".task");
    for (let place = first; place < last; place++) if (this.rows[place].task) places.set(this.rows[place].task, place);
    const edge = cell ? cell.offsetLeft + cell.offsetWidth - 5 : 0, room = cell ? parseFloat(getComputedStyle(cell).paddingRight) : 0;
    for (const [task, place] of places) {
      const drawn = new Map();
      for (const hold of task.holds) {
        if (hold.time > this.time || !places.has(hold.before)) continue;
        drawn.set(hold.before, (drawn.get(hold.before) ?? new Set()).add(hold.kind));
      }
      for (const [before, kinds] of drawn) {
        const isChosen = task === this.outline.chosen || before === this.outline.chosen;
        paths.push(...arrow(edge, room, places.get(before), place, [...kinds].join(", "), isChosen));
      }
    }
    this.arrows.replaceChildren(...paths);
  }
}

// What identifies a row while others come and go: its task, or the number of the first folded task.
function keyOf(row) { return row.task ?? row.key; }

function svg(kind, attributes) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", kind);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
}

// An arrow from the row of the earlier task to the row of the later one: a bow at the right of the names.
function arrow(edge, room, from, to, kind, isChosen) {
  const a = from * ROW + ROW / 2, b = to * ROW + ROW / 2;
  const bow = Math.min(14 + Math.abs(to - from) * 4, room / 0.75); // a cubic curve reaches three quarters of the way to its control points
  const marked = isChosen ? { class: "chosen" } : {};
  const path = svg("path", { d: `M ${edge} ${a} C ${edge - bow} ${a}, ${edge - bow} ${b}, ${edge} ${b}`, ...marked });
  const head = svg("path", { d: `M ${edge - 6} ${b - 4} L ${edge} ${b} L ${edge - 6} ${b + 4}`, ...marked });
  path.append(svg("title", {}));
  path.firstChild.textContent = kind;
  return [path, head];
}
