// The details of one task or message: state, causes of a wait or failure, times, data, constraints, story.

import { age, ages, element, soon } from "./dom.js";
import { Machines } from "./machine.js";
import { duration, numbered, parted, seconds } from "./words.js";

const LONGEST = 1500, LONGEST_DATA = 20000; // characters that are shown at first
const MET = 3, UNMET = 12; // constraints that are shown at first

export class Details {
  constructor(store, { choose, setTime, ask, answered }) {
    Object.assign(this, { store, choose, setTime, ask, answered });
    this.panel = document.getElementById("task");
    this.id = null;
    this.time = Infinity;
    this.isAsking = false;
    this.unfolded = new Set();
    this.machines = new Machines(store, ask);
    this.fetch = soon(() => this.#fetch(), 60);
  }

  show(id, time) {
    if (id === null || (id === this.id && time === this.time && this.version === this.store.version)) return;
    Object.assign(this, { id, time, version: this.store.version });
    this.fetch();
  }

  async #fetch() {
    if (this.isAsking) return; // it is called again after the answer
    const { id, time, version } = this;
    this.isAsking = true;
    const about = await this.ask(`message/${id}`, { at: time });
    this.isAsking = false;
    if (id !== this.id || time !== this.time || version !== this.version) this.fetch();
    if (id !== this.id || !about) return;
    if (about.error) this.panel.replaceChildren(element("p", { class: "faint", text: about.error }));
    else this.panel.replaceChildren(...this.#parts(about));
    this.answered({ ...about, id });
  }

  *#parts(about) {
    yield element("h2", { text: numbered(about.name, about.id) });
    yield* this.#lead(about);
    if (about.machine) yield this.machines.pictureOf(about.id, about.machine);
    if (about.machine?.late?.length) yield element("ul", { class: "late" }, ...about.machine.late.map((text) => element("li", { text })));
    yield* this.#relations(about);
    if (about.constraints?.length) {
      yield element("h3", { text: "constraints" });
      yield element("table", { id: "constraints" }, ...this.#constraints(about));
    }
    yield* this.#data("newest progress", about.progress);
    yield* this.#data("requested goal", about.asked);
    yield* this.#data("data", about.data);
    yield* this.#data("result", about.result);
    yield* this.#data("data of the failure", about.failureData);
    yield element("h3", { text: "story" });
    if (about.untold) yield element("p", { class: "faint", text: `… ${about.untold} earlier sentences` });
    const later = about.story.findIndex(({ time }) => time > this.time), known = later < 0 ? about.story : about.story.slice(0, later);
    yield element("table", { id: "story" }, ...known.map((one) => this.#sentence(one)));
    if (later >= 0) {
      yield element("h3", { text: "later" });
      yield element("table", { id: "later" }, ...about.story.slice(later).map((one) => this.#sentence(one)));
    }
    if (!about.chain?.length) return;
    yield element("h3", { text: "its failure, step by step" });
    if (about.unlinked) yield element("p", { class: "faint", text: `… ${about.unlinked} earlier steps` });
    yield element("table", { id: "chain" }, ...about.chain.map((step) => this.#step(step)));
  }

  *#lead(about) {
    if (about.state) {
      const chip = element("span", { class: "state", text: about.state });
      chip.style.background = this.store.head.fills[about.state];
      yield element("div", {}, chip, element("span", { class: "faint", text: `  ${about.class}` }));
    } else {
      yield element("div", { class: "faint", text: about.isSent ? about.class : `${about.class}, not sent yet at this time` });
    }
    for (const { text, since } of about.waits ?? []) yield this.#paragraph("", text, ...ages({ since, start: about.start }));
    if (about.end) yield this.#paragraph("end", about.end);
    for (const text of about.ahead ?? []) yield this.#paragraph("", text);
    if (about.failure) {
      yield this.#paragraph(about.handled ? "handled" : "bad", about.failure);
      const later = about.handled ? undefined : this.store.handledLater(about.id, this.time);
      if (later !== undefined) yield element("p", { class: "lead faint" }, "handled later: ", this.#timeLink(later));
      if (about.told) yield this.#paragraph("", about.told);
    }
    if (about.killed) yield this.#paragraph(about.replaced ? "handled" : "bad", `killed: ${about.killed}`);
  }

  #paragraph(kind, text, ...ages) { return element("p", { class: `lead ${kind}`.trim() }, ...this.#linked(text), ...ages); }

  *#relations({ relations, life, spans = {} }) {
    const lines = [...life ? [["life cycle", life]] : [], ...relations].map(([name, text]) => [name, [...this.#linked(text)]]);
    for (const [name, span] of Object.entries(spans)) if (span) lines.push([name, times(span)]);
    yield element("table", {}, ...lines.map(([name, what]) => element("tr", {}, element("td", { class: "faint", text: name }), element("td", {}, ...what))));
  }

  *#data(name, text) {
    if (!text) return;
    yield element("h3", { text: name });
    const whole = pretty(text), shown = whole.slice(0, LONGEST_DATA);
    yield element("pre", { text: shown }, shown.length < whole.length ? showAllButton(whole) : null);
  }

  // The rows of constraints, unmet ones first. Only the first ones are shown, with a button for the others.
  *#constraints({ id, constraints }) {
    const met = constraints.filter((one) => one.isMet), unmet = constraints.filter((one) => !one.isMet);
    for (const [group, most, state] of [[unmet, UNMET, "not met"], [met, MET, "met"]]) {
      const key = `${id} ${state}`, shown = this.unfolded.has(key) || group.length <= most + 1 ? group.length : most;
      yield* group.slice(0, shown).map((one) => this.#constraint(one));
      if (shown === group.length) continue;
      const rest = group.slice(shown), more = element("button", { class: "link", text: `and ${rest.length} more ${state}` });
      const row = element("tr", {}, element("td"), element("td", {}, more));
      more.addEventListener("click", () => {
        this.unfolded.add(key); // for later answers, too
        row.replaceWith(...rest.map((one) => this.#constraint(one)));
      });
      yield row;
    }
  }

  #constraint({ isMet, text }) {
    return element("tr", { class: isMet ? "met" : "" }, element("td", { text: isMet ? "✓" : "•", title: isMet ? "met" : "not met" }),
      element("td", {}, ...this.#linked(text)));
  }

  #sentence({ time, text, seconds: took, isOpen }) {
    const isKnown = time <= this.time, lasts = isOpen && isKnown ? [age(time), " …"] : [took === null ? "" : duration(took)];
    return element("tr", { class: isKnown ? "" : "met" }, element("td", { class: "number" }, this.#timeLink(time)),
      element("td", { class: "number" }, ...lasts), element("td", { class: "said" }, ...this.#linked(text)));
  }

  #step({ time, depth, text }) {
    const cell = element("td", { class: "said" }, ...this.#linked(text));
    cell.style.paddingLeft = `calc(${depth} * var(--indent))`;
    return element("tr", { class: time > this.time ? "met" : "" }, element("td", { class: "number" }, this.#timeLink(time)), cell);
  }

  #timeLink(time) {
    const when = element("button", { class: "link", text: seconds(time), title: "go there" });
    when.addEventListener("click", () => this.setTime(time));
    return when;
  }

  // A text with links to its tasks. A very long text is cut, with a button that shows all of it.
  *#linked(text) {
    const shown = withoutCarets(text), { byId } = this.store;
    for (const part of parted(shown.slice(0, LONGEST), (number) => byId.get(number)?.name)) yield part.number ? this.#link(part.number, part.text) : part;
    if (shown.length > LONGEST) yield* ["… ", showAllButton(shown)];
  }

  #link(number, text) {
    const made = element("button", { class: "link", text });
    made.addEventListener("click", () => this.choose(number));
    return made;
  }
}

// A button that is replaced by a frame with the whole text.
function showAllButton(text) {
  const made = element("button", { class: "link", text: `show all ${text.length} characters` });
  made.addEventListener("click", () => made.replaceWith(element("textarea", { class: "whole", readOnly: true, rows: 16, value: text })));
  return made;
}

// Python marks places in a traceback with lines of ^ and ~, under letters of one width.
function withoutCarets(text) {
  const isMark = (line) => line.trim() && [...line.trim()].every((letter) => ["^", "~", " "].includes(letter));
  return text.split("\n").filter((line) => !isMark(line)).join("\n");
}

function times([start, over]) {
  if (over === null) return [`since ${seconds(start)}  (`, age(start), " so far)"];
  return [`${seconds(start)} – ${seconds(over)}  (${duration(over - start)})`];
}

function pretty(text) {
  try {
    return text.length < 70 ? text : JSON.stringify(JSON.parse(text), null, 2);
  } catch {
    return text;
  }
}
