// All there is to say about one task or message: state, why it waits or failed, times, data, constraints, its story.

import { age, ages, element, soon } from "./dom.js";
import { clauses, constraint, duration, end, numbered, parted, plain, seconds } from "./words.js";

const LONGEST = 1500, LONGEST_DATA = 20000; // characters that are laid out unasked
const MET = 3, UNMET = 12; // constraints that are shown unasked

export class Details {
  constructor(store, { choose, setTime, ask }) {
    Object.assign(this, { store, choose, setTime, ask });
    this.panel = document.getElementById("task");
    this.id = null;
    this.time = Infinity;
    this.isAsking = false;
    this.unfolded = new Set();
    this.fetch = soon(() => this.#fetch(), 60);
  }

  show(id, time) {
    if (id === null || (id === this.id && time === this.time && this.version === this.store.version)) return;
    Object.assign(this, { id, time, version: this.store.version });
    this.fetch();
  }

  async #fetch() {
    if (this.isAsking) return; // the answer comes back here
    const { id, time, version } = this;
    this.isAsking = true;
    const about = await this.ask(`message/${id}`, { at: time });
    this.isAsking = false;
    if (id !== this.id || time !== this.time || version !== this.version) this.fetch();
    if (id !== this.id || !about) return;
    if (about.error) this.panel.replaceChildren(element("p", { class: "faint", text: about.error }));
    else this.panel.replaceChildren(...this.#parts(about));
  }

  *#parts(about) {
    yield element("h2", { text: plain([numbered({ name: about.name, number: about.id })]) });
    yield* this.#lead(about);
    yield* this.#relations(about);
    if (about.constraints?.length) {
      yield element("h3", { text: "constraints" });
      yield element("table", { id: "constraints" }, ...this.#constraints(about));
    }
    yield* this.#data("data", about.data);
    yield* this.#data("result", about.result);
    yield* this.#data("data of the failure", about.failureData);
    yield element("h3", { text: "story" });
    if (about.untold) yield element("p", { class: "faint", text: `… ${about.untold} sentences before these` });
    const later = about.story.findIndex(({ time }) => time > this.time), known = later < 0 ? about.story : about.story.slice(0, later);
    yield element("table", { id: "story" }, ...known.map((one) => this.#sentence(one)));
    if (later >= 0) {
      yield element("h3", { text: "what came later" });
      yield element("table", { id: "later" }, ...about.story.slice(later).map((one) => this.#sentence(one)));
    }
    if (!about.chain?.length) return;
    yield element("h3", { text: "its failure, step by step" });
    yield element("table", { id: "chain" }, ...about.chain.map((step) => this.#step(step)));
  }

  *#lead(about) {
    if (about.state) {
      const { states, handled } = this.store.head, looks = [...states, handled].find((one) => one.name === about.state);
      const chip = element("span", { class: "state", text: about.state });
      chip.style.background = looks.colour;
      yield element("div", {}, chip, element("span", { class: "faint", text: `  ${about.class}` }));
    } else {
      const born = about.received > this.time;
      yield element("div", { class: "faint", text: born ? `${about.class}, not sent yet at this time` : about.class });
    }
    for (const { waits, parts } of clauses(about.waits ?? [])) {
      const since = Math.max(...waits.map((wait) => wait.since ?? about.since));
      yield this.#paragraph("", [`${about.how} `, ...parts], ...ages({ since, start: about.start }));
    }
    if (about.end) yield this.#paragraph("end", ["in the end for ", ...end(about.end)]);
    for (const one of about.ahead ?? []) yield element("p", { class: "lead" }, ...this.#linked(one));
    if (about.failure) {
      const { name, text } = about.failure;
      yield element("p", { class: `lead ${about.handled ? "handled" : "bad"}` }, ...this.#linked([name, text].filter(Boolean).join(": ")));
      const later = about.handled ? undefined : this.store.handledLater(about.id, this.time);
      if (later !== undefined) yield element("p", { class: "lead faint" }, "handled later: ", this.#moment(later));
      if (about.told) yield element("p", { class: "lead" }, ...this.#linked(about.told));
    }
    if (about.killed) yield element("p", { class: `lead ${about.replaced ? "handled" : "bad"}` }, ...this.#linked(`killed: ${about.killed}`));
  }

  #paragraph(kind, parts, ...ages) { return element("p", { class: `lead ${kind}`.trim() }, ...this.#links(parts), ...ages); }

  *#relations(about) {
    const lines = [];
    if (about.parent) lines.push(["under", this.#linkTo(about.parent)]);
    lines.push(["sent by", element("span", {}, ...this.#links(about.origin ? [`${about.sender} while handling `, numbered(about.origin)] : [about.sender]))]);
    if (about.role) lines.push(["as", element("span", {}, `${about.role} for `, this.#linkTo(about.about))]);
    for (const handler of about.caughtBy ?? []) lines.push(["handled as a failure by", this.#linkTo(handler)]);
    for (const [name, span] of Object.entries(about.spans ?? {})) if (span) lines.push([name, times(span)]);
    if (about.children) lines.push(["subtasks", element("span", { text: about.children })]);
    yield element("table", {}, ...lines.map(([name, what]) => element("tr", {}, element("td", { class: "faint", text: name }), element("td", {}, what))));
  }

  *#data(name, text) {
    if (!text) return;
    yield element("h3", { text: name });
    const whole = pretty(text), shown = whole.slice(0, LONGEST_DATA);
    yield element("pre", { text: shown }, shown.length < whole.length ? rest(whole) : null);
  }

  // What holds it first; of many the first ones, and the others when they are asked for.
  *#constraints({ id, constraints }) {
    const met = constraints.filter((one) => one.isMet), unmet = constraints.filter((one) => !one.isMet);
    for (const [group, most, said] of [[unmet, UNMET, "not met"], [met, MET, "met"]]) {
      const key = `${id} ${said}`, shown = this.unfolded.has(key) || group.length <= most + 1 ? group.length : most;
      yield* group.slice(0, shown).map((one) => this.#constraint(one));
      if (shown === group.length) continue;
      const rest = group.slice(shown), more = element("button", { class: "link", text: `and ${rest.length} more that are ${said}` });
      const row = element("tr", {}, element("td"), element("td", {}, more));
      more.addEventListener("click", () => {
        this.unfolded.add(key); // also in answers to come
        row.replaceWith(...rest.map((one) => this.#constraint(one)));
      });
      yield row;
    }
  }

  #constraint(one) {
    const { isMet, number, way } = one, text = constraint(one), what = number ? this.#link(number, text) : element("span", { text });
    return element("tr", { class: isMet ? "met" : "" }, element("td", { text: isMet ? "✓" : "•", title: isMet ? "met" : "holds it" }),
      element("td", {}, what, ...way ? [", by way of ", this.#linkTo(way)] : []));
  }

  #sentence({ time, text, seconds: took, isOpen }) {
    const isKnown = time <= this.time, lasts = isOpen && isKnown ? [age(time), " …"] : [took === null ? "" : duration(took)];
    return element("tr", { class: isKnown ? "" : "met" }, element("td", { class: "number" }, this.#moment(time)),
      element("td", { class: "number" }, ...lasts), element("td", { class: "said" }, ...this.#linked(text)));
  }

  #step({ time, depth, text }) {
    const told = element("td", { class: "said" }, ...this.#linked(text));
    told.style.paddingLeft = `calc(${depth} * var(--indent))`;
    return element("tr", { class: time > this.time ? "met" : "" }, element("td", { class: "number" }, this.#moment(time)), told);
  }

  #moment(time) {
    const when = element("button", { class: "link", text: seconds(time), title: "go there" });
    when.addEventListener("click", () => this.setTime(time));
    return when;
  }

  // A text in which tasks are links; of a very long one the beginning, and the rest when that is asked for.
  *#linked(text) {
    const shown = withoutCarets(text), parts = parted(shown.slice(0, LONGEST), (number) => this.store.byId.get(number)?.name);
    yield* this.#links(parts);
    if (shown.length > LONGEST) yield* ["… ", rest(shown)];
  }

  #links(parts) {
    const isTask = ({ number }) => this.store.byId.has(number);
    return parts.map((part) => (isTask(part) ? this.#link(part.number, part.text) : part.text ?? part));
  }

  #linkTo(task) { return this.#link(task.number, plain([numbered(task)])); }

  #link(number, text) {
    const made = element("button", { class: "link", text });
    made.addEventListener("click", () => this.choose(number));
    return made;
  }
}

// A button that shows all of a text, in a frame of its own.
function rest(text) {
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
  if (over === null) return element("span", {}, `since ${seconds(start)}  (`, age(start), " so far)");
  return element("span", { text: `${seconds(start)} – ${seconds(over)}  (${duration(over - start)})` });
}

function pretty(text) {
  try {
    return text.length < 70 ? text : JSON.stringify(JSON.parse(text), null, 2);
  } catch {
    return text;
  }
}
