// All there is to say about one task or message: state, why it waits or failed, times, data, constraints, its story.

import { age, ages, CALM, element, length, near, seconds, soon } from "./format.js";

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
    Object.assign(this, { id, time, version: this.store.version, changed: performance.now() });
    this.fetch();
  }

  async #fetch() {
    if (this.isAsking) return; // the answer comes back here
    const { id, time, changed } = this, within = near(changed);
    this.isAsking = true;
    const about = await this.ask(`message/${id}`, { at: time, within });
    this.isAsking = false;
    if (changed !== this.changed) this.fetch();
    else if (about?.isFurther) setTimeout(this.fetch, CALM);
    if (id !== this.id || !about) return;
    if (about.error) this.panel.replaceChildren(element("p", { class: "faint", text: about.error }));
    else this.panel.replaceChildren(...this.#parts(about));
  }

  *#parts(about) {
    yield element("h2", { text: `${about.name} {${about.id}}` });
    yield* this.#lead(about);
    yield* this.#relations(about);
    if (about.constraints?.length) {
      yield element("h3", { text: "constraints" });
      yield element("table", { id: "constraints" }, ...this.#constraints(about));
    }
    yield* this.#data("data", about.data);
    yield* this.#data("result", about.result);
    yield* this.#data("data of the failure", about.failure_data);
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
    yield element("table", { id: "chain" }, ...about.chain.map((link) => this.#link(link)));
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
    for (const reason of about.reasons ?? []) yield this.#reason(about.how, reason);
    if (about.end) yield element("p", { class: "lead end" }, ...this.#linked(`in the end ${about.end}`));
    for (const one of about.coming ?? []) yield element("p", { class: "lead" }, ...this.#linked(one));
    if (about.failure) {
      yield element("p", { class: `lead ${about.handled ? "handled" : "bad"}` }, ...this.#linked(about.failure));
      const later = about.handled ? undefined : this.store.handledLater(about.id, this.time);
      if (later !== undefined) yield element("p", { class: "lead faint" }, "handled later: ", this.#moment(later));
      if (about.told) yield element("p", { class: "lead" }, ...this.#linked(about.told));
    }
    if (about.killed) yield element("p", { class: `lead ${about.replaced ? "handled" : "bad"}` }, ...this.#linked(`killed: ${about.killed}`));
  }

  #reason(how, reason) {
    const [lasted, inAll] = ages(reason), told = this.#linked(`${how} ${reason.text}`);
    return element("p", { class: "lead" }, ...told, lasted, inAll);
  }

  *#relations(about) {
    const lines = [];
    if (about.parent) lines.push(["under", this.#linkTo(about.parent, about.parent_name)]);
    lines.push(["sent by", element("span", { text: about.sender })]);
    if (about.role) lines.push(["as", element("span", {}, element("span", { text: `${about.role} for ` }), this.#linkTo(about.about_id, about.about))]);
    for (const handler of about.caught_by ?? []) lines.push(["handled as a failure by", this.#linkTo(handler.id, handler.name)]);
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
    const met = constraints.filter((one) => one.is_met), unmet = constraints.filter((one) => !one.is_met);
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
    const what = one.id ? this.#linkTo(one.id, one.text) : element("span", { text: one.text });
    return element("tr", { class: one.is_met ? "met" : "" },
      element("td", { text: one.is_met ? "✓" : "•", title: one.is_met ? "met" : "holds it" }),
      element("td", {}, what, ...one.way ? [", by way of ", this.#linkTo(one.way, one.way_name)] : []));
  }

  #sentence({ time, text, seconds: took, is_open: isOpen }) {
    const isKnown = time <= this.time, lasts = isOpen && isKnown ? [age(time), " …"] : [took === null ? "" : length(took)];
    return element("tr", { class: isKnown ? "" : "met" }, element("td", { class: "number" }, this.#moment(time)),
      element("td", { class: "number" }, ...lasts), element("td", { class: "said" }, ...this.#linked(text)));
  }

  #link({ time, depth, text }) {
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
    const shown = withoutCarets(text);
    if (shown.length <= LONGEST) return yield* this.#withLinks(shown);
    yield* this.#withLinks(shown.slice(0, LONGEST));
    yield "… ";
    yield rest(shown);
  }

  // A text in which the tasks that it names are links: "move {7}", "task 7".
  *#withLinks(text) {
    let told = 0;
    for (const { 0: found, 1: braced, 2: plain, index } of text.matchAll(/\{(\d+)\}|\btask (\d+)\b/g)) {
      const task = this.store.byId.get(Number(braced ?? plain)), name = `${task?.name} `;
      if (!task) continue;
      const isNamed = braced && text.slice(told, index).endsWith(name), start = isNamed ? index - name.length : index;
      yield text.slice(told, start);
      told = index + found.length;
      yield this.#linkTo(task.id, text.slice(start, told));
    }
    yield text.slice(told);
  }

  #linkTo(id, name) {
    const made = element("button", { class: "link", text: name });
    made.addEventListener("click", () => this.choose(id));
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
function withoutCarets(text) { return text.replaceAll(/\n[ \t]*[\^~]+[ \t]*(?=\n|$)/g, ""); }

function times([start, end]) {
  if (end === null) return element("span", {}, `since ${seconds(start)}  (`, age(start), " so far)");
  return element("span", { text: `${seconds(start)} – ${seconds(end)}  (${length(end - start)})` });
}

function pretty(text) {
  try {
    return text.length < 70 ? text : JSON.stringify(JSON.parse(text), null, 2);
  } catch {
    return text;
  }
}
