// The processors and their activities, which the user moves with the mouse or the keyboard.

import { dot, element } from "../view/dom.js";
import { duration } from "../view/words.js";

const NEW = "new processor", NONE = "on no processor"; // the names of the two baskets, which stand beside the processors
const TITLES = ["", "activity", "period (ms)", "longest", "response", "jitter", "ticks"];
const WIDE = new Set(["response", "jitter"]);

export class Processors {
  // `move(activity, processor, position)`, `setPeriod(activity, seconds)`, `setPriority(processor, priority)` send commands.
  constructor(panel, commands) {
    Object.assign(this, { panel, commands, allocation: null, dragged: null, postponed: null });
    panel.addEventListener("keydown", (event) => this.#onKey(event));
  }

  // Build all elements for a new allocation, and restore the focus.
  build(allocation) {
    if (this.dragged) { // wait until the activity is dropped
      this.postponed = allocation;
      return;
    }
    const focused = document.activeElement?.closest?.(".activity")?.dataset.activity;
    this.allocation = allocation;
    this.figures = new Map(); // the elements that show figures, by kind and name
    const { processors, unallocated } = allocation;
    this.panel.replaceChildren(
      element("div", { class: "top" }, element("div", { class: "baskets" },
        this.#basket(NEW, "drop an activity here", []), this.#basket(NONE, "drop an activity here to stop its ticks", unallocated)), this.#titles()),
      ...processors.map((one) => this.#processor(one)));
    if (this.lastFigures) this.show(this.lastFigures);
    if (focused) this.row(focused)?.focus();
  }

  row(name) {
    return this.panel.querySelector(`.activity[data-activity="${CSS.escape(name)}"]`);
  }

  #titles() {
    return element("div", { class: "activity titles" }, ...TITLES.map((text) => element("span", { text, class: WIDE.has(text) ? "wide" : "" })));
  }

  #processor({ name, priority, period, activities }) {
    const input = element("input", { type: "number", value: priority, step: 1, "aria-label": `priority of ${name}` });
    input.addEventListener("change", () => this.commands.setPriority(name, Number(input.value)));
    const figures = element("span", { class: "figures" }), verdict = element("span", { class: "verdict" });
    this.figures.set(`processor ${name}`, { figures, verdict });
    const head = element("div", { class: "head" }, element("h2", { text: name }),
      element("span", { class: "value", text: `every ${duration(period)}` }), element("label", { text: "priority " }, input), verdict, figures);
    return this.#section(name, head, activities);
  }

  #basket(name, hint, activities) {
    const section = this.#section(name, element("div", { class: "head" }, element("h2", { text: name })), activities);
    section.classList.add("basket");
    if (!activities.length) section.append(element("div", { class: "empty", text: hint }));
    return section;
  }

  // The section of a processor or basket, on which activities can be dropped.
  #section(name, head, activities) {
    const section = element("section", { class: "processor", "aria-label": name }, head,
      element("ul", { class: "activities" }, ...activities.map((activity) => this.#activity(activity))));
    section.dataset.processor = name;
    section.addEventListener("dragover", (event) => this.#onDragOver(event, section));
    section.addEventListener("dragleave", ({ relatedTarget }) => section.contains(relatedTarget) || clearMarks(section));
    section.addEventListener("drop", (event) => {
      event.preventDefault();
      clearMarks(section);
      const next = this.#rowUnder(event)?.dataset.activity;
      if (this.dragged) this.#move(this.dragged, name, next === undefined ? null : this.#names(name).filter((one) => one !== this.dragged).indexOf(next));
    });
    return section;
  }

  #onDragOver(event, section) {
    if (!this.dragged) return;
    event.preventDefault();
    clearMarks(section);
    section.classList.add("over");
    this.#rowUnder(event)?.classList.add("before");
  }

  // The activity before which the dragged one would be dropped.
  #rowUnder({ target }) {
    const row = target.closest(".activity[data-activity]");
    return row && row.dataset.activity !== this.dragged ? row : null;
  }

  #activity({ name, component, period, estimate }) {
    const input = element("input", { type: "number", value: Number((period * 1000).toPrecision(6)), min: 0, step: "any", "aria-label": `period of ${name}, in milliseconds` });
    input.addEventListener("change", () => this.commands.setPeriod(name, Number(input.value) / 1000));
    const cells = Object.fromEntries(["longest", "response", "jitter", "ticks"].map((kind) => [kind, element("span", { class: `number ${kind}${WIDE.has(kind) ? " wide" : ""}` })]));
    const title = estimate === null ? name : `${name}: takes at most ${duration(estimate)}, as declared`;
    const made = element("li", { class: "activity", draggable: true, tabIndex: 0, title }, dot(hue(component)),
      element("span", { class: "name", text: name }), input, ...Object.values(cells));
    made.dataset.activity = name;
    made.addEventListener("dragstart", (event) => {
      this.dragged = name;
      event.dataTransfer.setData("text/plain", name);
      made.classList.add("dragged");
    });
    made.addEventListener("dragend", () => {
      this.dragged = null;
      made.classList.remove("dragged");
      if (this.postponed) this.build(this.postponed);
      this.postponed = null;
    });
    this.figures.set(`activity ${name}`, { ...cells, estimate });
    return made;
  }

  // --- keyboard ---------------------------------------------------------------------------------------------------

  #onKey(event) {
    const row = event.target.classList.contains("activity") ? event.target : null, { key, altKey } = event;
    if (!row) return;
    const rows = [...this.panel.querySelectorAll(".activity[data-activity]")], name = row.dataset.activity;
    const processor = row.closest(".processor").dataset.processor;
    const rowStep = { ArrowUp: -1, ArrowDown: 1 }[key], processorStep = { ArrowLeft: -1, ArrowRight: 1 }[key];
    if (key === "n") this.#move(name, NEW, null);
    else if (key === "Delete") this.#move(name, NONE, null);
    else if (rowStep && altKey) this.#move(name, processor, this.#names(processor).indexOf(name) + rowStep);
    else if (rowStep) rows[rows.indexOf(row) + rowStep]?.focus();
    else if (processorStep && !altKey) this.#move(name, this.#neighbour(processor, processorStep), null);
    else return;
    event.preventDefault();
  }

  #neighbour(processor, step) {
    const names = this.allocation.processors.map(({ name }) => name);
    return processor === NONE ? names.at(-1) : names[names.indexOf(processor) + step] ?? processor;
  }

  // The names of the activities of a processor or basket.
  #names(processor) {
    const { processors, unallocated } = this.allocation;
    return (processors.find(({ name }) => name === processor)?.activities ?? (processor === NONE ? unallocated : [])).map(({ name }) => name);
  }

  // Send a command that moves an activity to a processor or basket; with position null, behind all others.
  #move(activity, processor, position) {
    if (position !== null && position < 0) return;
    if (position === null && this.#names(processor).includes(activity)) return;
    this.commands.move(activity, processor === NONE ? "" : processor === NEW ? this.#newName() : processor, position);
  }

  #newName() {
    const names = new Set(this.allocation.processors.map(({ name }) => name));
    let number = 1;
    while (names.has(`processor ${number}`)) number++;
    return `processor ${number}`;
  }

  // --- figures ----------------------------------------------------------------------------------------------------

  show(figures) {
    this.lastFigures = figures;
    for (const one of figures.processors) {
      const elements = this.figures?.get(`processor ${one.name}`);
      if (elements) showFigures(elements, one);
    }
    for (const one of figures.activities) {
      const cells = this.figures?.get(`activity ${one.name}`);
      if (!cells) continue;
      for (const kind of ["longest", "response", "jitter"]) cells[kind].textContent = duration(one[kind]);
      const isLonger = cells.estimate !== null && one.longest > cells.estimate;
      cells.longest.classList.toggle("bad", isLonger);
      cells.longest.title = isLonger ? `longer than declared (${duration(cells.estimate)})` : "";
      cells.ticks.textContent = one.ticks.toLocaleString("en");
      cells.ticks.classList.toggle("bad", one.errors > 0 || one.overruns > 0 || one.left_out > 0);
      cells.ticks.title = one.errors ? `${one.errors} ticks raised an error, the last: ${one.error}` : one.overruns || one.left_out ? `${one.overruns} ticks ended after the next was due, ${one.left_out} more were left out` : "";
    }
  }
}

function showFigures({ figures, verdict }, { load, response, jitter, overruns, bound, margin, is_schedulable: fits, refuted, last_late: lateAgo }) {
  const parts = [["load", `${(100 * load).toFixed(1)} %`], ["response", duration(response)], ["jitter", duration(jitter)],
    ["overruns", overruns.toLocaleString("en")], ...bound === null ? [] : [["bound", duration(bound)], ["margin", duration(margin)]]];
  figures.replaceChildren(...parts.flatMap(([label, value]) => [element("span", { class: "what", text: ` ${label} ` }), element("span", { class: `value${label === "overruns" && overruns ? " bad" : ""}`, text: value })]));
  verdict.textContent = (refuted || (fits === null ? "schedulability unknown" : fits ? "schedulable" : "not schedulable")) + (lateAgo === null || refuted ? "" : `, last late ${duration(lateAgo)} ago`);
  verdict.title = verdict.textContent;
  verdict.className = `verdict ${fits === null ? "faint" : fits ? "good" : "bad"}`;
}

function clearMarks(section) {
  section.classList.remove("over");
  for (const row of section.querySelectorAll(".before")) row.classList.remove("before");
}

// Each component has its own colour.
const hues = new Map();
function hue(component) {
  if (!hues.has(component)) hues.set(component, `hsl(${(hues.size * 137 + 210) % 360} 55% 58%)`);
  return hues.get(component);
}
