// The processors and their activities, which are moved by drag or by keyboard.

import { dot, element } from "../view/dom.js";
import { duration } from "../view/words.js";

const NEW = "new processor", NONE = "on no processor";
const TITLES = ["", "activity", "period (ms)", "longest", "response", "jitter", "ticks"];
const WIDE = new Set(["response", "jitter"]);

export class Processors {
  // `moved(activity, processor, position)`, `hasPeriod(activity, seconds)`, `hasPriority(processor, priority)` send commands.
  constructor(place, commands) {
    Object.assign(this, { place, commands, allocation: null, dragged: null, late: null });
    place.addEventListener("keydown", (event) => this.#onKey(event));
  }

  // New structure: built anew, and what had the focus has it again.
  build(allocation) {
    if (this.dragged) { // what is dragged stays where it is until it is dropped
      this.late = allocation;
      return;
    }
    const focused = document.activeElement?.closest?.(".activity")?.dataset.activity;
    this.allocation = allocation;
    this.figures = new Map(); // by kind and name: the elements that show them
    const { processors, unallocated } = allocation;
    this.place.replaceChildren(
      element("div", { class: "top" }, element("div", { class: "baskets" },
        this.#basket(NEW, "drop an activity here", []), this.#basket(NONE, "nothing ticks what is dropped here", unallocated)), this.#titles()),
      ...processors.map((one) => this.#processor(one)));
    if (this.shown) this.show(this.shown);
    if (focused) this.row(focused)?.focus();
  }

  row(name) {
    return this.place.querySelector(`.activity[data-activity="${CSS.escape(name)}"]`);
  }

  #titles() {
    return element("div", { class: "activity titles" }, ...TITLES.map((text) => element("span", { text, class: WIDE.has(text) ? "wide" : "" })));
  }

  #processor({ name, priority, period, activities }) {
    const input = element("input", { type: "number", value: priority, step: 1, "aria-label": `priority of ${name}` });
    input.addEventListener("change", () => this.commands.hasPriority(name, Number(input.value)));
    const told = element("span", { class: "figures" }), verdict = element("span", { class: "verdict" });
    this.figures.set(`processor ${name}`, { told, verdict });
    const head = element("div", { class: "head" }, element("h2", { text: name }),
      element("span", { class: "value", text: `every ${duration(period)}` }), element("label", { text: "priority " }, input), verdict, told);
    return this.#place(name, head, activities);
  }

  #basket(name, hint, activities) {
    const made = this.#place(name, element("div", { class: "head" }, element("h2", { text: name })), activities);
    made.classList.add("place");
    if (!activities.length) made.append(element("div", { class: "empty", text: hint }));
    return made;
  }

  #place(name, head, activities) {
    const made = element("section", { class: "processor", "aria-label": name }, head,
      element("ul", { class: "activities" }, ...activities.map((activity) => this.#activity(activity))));
    made.dataset.processor = name;
    made.addEventListener("dragover", (event) => this.#over(event, made));
    made.addEventListener("dragleave", ({ relatedTarget }) => made.contains(relatedTarget) || unmarked(made));
    made.addEventListener("drop", (event) => {
      event.preventDefault();
      unmarked(made);
      const before = this.#rowUnder(event)?.dataset.activity;
      if (this.dragged) this.#move(this.dragged, name, before === undefined ? null : this.#names(name).filter((one) => one !== this.dragged).indexOf(before));
    });
    return made;
  }

  #over(event, place) {
    if (!this.dragged) return;
    event.preventDefault();
    unmarked(place);
    place.classList.add("over");
    this.#rowUnder(event)?.classList.add("before");
  }

  // The activity before which one is dropped.
  #rowUnder({ target }) {
    const row = target.closest(".activity[data-activity]");
    return row && row.dataset.activity !== this.dragged ? row : null;
  }

  #activity({ name, component, period, estimate }) {
    const input = element("input", { type: "number", value: Number((period * 1000).toPrecision(6)), min: 0, step: "any", "aria-label": `period of ${name}, in milliseconds` });
    input.addEventListener("change", () => this.commands.hasPeriod(name, Number(input.value) / 1000));
    const cells = Object.fromEntries(["longest", "response", "jitter", "ticks"].map((kind) => [kind, element("span", { class: `number ${kind}${WIDE.has(kind) ? " wide" : ""}` })]));
    const title = estimate === null ? name : `${name}: declared to take at most ${duration(estimate)}`;
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
      if (this.late) this.build(this.late);
      this.late = null;
    });
    this.figures.set(`activity ${name}`, { ...cells, estimate });
    return made;
  }

  // --- by keyboard ------------------------------------------------------------------------------------------------

  #onKey(event) {
    const row = event.target.classList.contains("activity") ? event.target : null, { key, altKey } = event;
    if (!row) return;
    const rows = [...this.place.querySelectorAll(".activity[data-activity]")], name = row.dataset.activity;
    const place = row.closest(".processor").dataset.processor;
    const rowsOn = { ArrowUp: -1, ArrowDown: 1 }[key], processorsOn = { ArrowLeft: -1, ArrowRight: 1 }[key];
    if (key === "n") this.#move(name, NEW, null);
    else if (key === "Delete") this.#move(name, NONE, null);
    else if (rowsOn && altKey) this.#move(name, place, this.#names(place).indexOf(name) + rowsOn);
    else if (rowsOn) rows[rows.indexOf(row) + rowsOn]?.focus();
    else if (processorsOn && !altKey) this.#move(name, this.#neighbour(place, processorsOn), null);
    else return;
    event.preventDefault();
  }

  #neighbour(place, step) {
    const places = this.allocation.processors.map(({ name }) => name);
    return place === NONE ? places[places.length - 1] : places[places.indexOf(place) + step] ?? place;
  }

  #names(place) {
    const { processors, unallocated } = this.allocation;
    return (processors.find(({ name }) => name === place)?.activities ?? (place === NONE ? unallocated : [])).map(({ name }) => name);
  }

  #move(activity, place, position) {
    if (position !== null && position < 0) return;
    if (position === null && this.#names(place).includes(activity)) return;
    const processor = place === NONE ? "" : place === NEW ? this.#newName() : place;
    this.commands.moved(activity, processor, position);
  }

  #newName() {
    const names = new Set(this.allocation.processors.map(({ name }) => name));
    let number = 1;
    while (names.has(`processor ${number}`)) number++;
    return `processor ${number}`;
  }

  // --- figures ----------------------------------------------------------------------------------------------------

  show(figures) {
    this.shown = figures;
    for (const one of figures.processors) {
      const places = this.figures?.get(`processor ${one.name}`);
      if (places) tell(places, one);
    }
    for (const one of figures.activities) {
      const cells = this.figures?.get(`activity ${one.name}`);
      if (!cells) continue;
      for (const kind of ["longest", "response", "jitter"]) cells[kind].textContent = duration(one[kind]);
      const isLonger = cells.estimate !== null && one.longest > cells.estimate;
      cells.longest.classList.toggle("bad", isLonger);
      cells.longest.title = isLonger ? `longer than was declared (${duration(cells.estimate)})` : "";
      cells.ticks.textContent = one.ticks.toLocaleString("en");
      cells.ticks.classList.toggle("bad", one.errors > 0 || one.overruns > 0 || one.left_out > 0);
      cells.ticks.title = one.errors ? `${one.errors} raised, the last one: ${one.error}` : one.overruns || one.left_out ? `${one.overruns} ended after the next was due, ${one.left_out} more were left out` : "";
    }
  }
}

function tell({ told, verdict }, { load, response, jitter, overruns, bound, margin, is_schedulable: fits, refuted, last_late: ago }) {
  const parts = [["load", `${(100 * load).toFixed(1)} %`], ["response", duration(response)], ["jitter", duration(jitter)],
    ["overruns", overruns.toLocaleString("en")], ...bound === null ? [] : [["bound", duration(bound)], ["margin", duration(margin)]]];
  told.replaceChildren(...parts.flatMap(([what, value]) => [element("span", { class: "what", text: ` ${what} ` }), element("span", { class: `value${what === "overruns" && overruns ? " bad" : ""}`, text: value })]));
  verdict.textContent = (refuted || (fits === null ? "not known yet" : fits ? "schedulable" : "not schedulable")) + (ago === null || refuted ? "" : `, last late ${duration(ago)} ago`);
  verdict.title = verdict.textContent;
  verdict.className = `verdict ${fits === null ? "faint" : fits ? "good" : "bad"}`;
}

function unmarked(place) {
  place.classList.remove("over");
  for (const row of place.querySelectorAll(".before")) row.classList.remove("before");
}

// Each component has a colour.
const hues = new Map();
function hue(component) {
  if (!hues.has(component)) hues.set(component, `hsl(${(hues.size * 137 + 210) % 360} 55% 58%)`);
  return hues.get(component);
}
