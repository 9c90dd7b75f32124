// What all tasks that wait wait for in the end: how many wait for how many things, and what these are.

import { element, soon } from "./format.js";
import { lastNotAfter } from "./store.js";

const SHOWN = 4;
const LEAST = 150; // milliseconds between two questions
const REST = 4; // after an answer that took a while nothing is asked for so many times as long

export class Causes {
  constructor(store, { choose, ask }) {
    Object.assign(this, { store, choose, ask });
    this.panel = document.getElementById("causes");
    this.asked = "";
    this.isAsking = false;
    this.fetch = soon(() => this.#fetch(), LEAST);
  }

  show(time) {
    this.time = time;
    this.wanted = `${lastNotAfter(this.store.times, time)}#${this.store.version}`; // what is known changes with messages
    if (this.wanted !== this.asked) this.fetch();
  }

  async #fetch() {
    if (this.isAsking || this.wanted === this.asked) return; // the answer comes back here
    this.isAsking = true;
    this.asked = this.wanted;
    const begun = performance.now(), told = await this.ask("causes", { at: this.time });
    if (told) this.#tell(told);
    setTimeout(() => {
      this.isAsking = false;
      if (this.wanted !== this.asked) this.fetch();
    }, (performance.now() - begun) * REST);
  }

  #tell({ waiting, things, causes }) {
    if (!waiting) return this.panel.replaceChildren(element("span", { class: "faint", text: "nothing waits" }));
    const head = `${waiting} ${waiting === 1 ? "waits" : "wait"} for ${things} ${things === 1 ? "thing" : "things"}:`;
    const links = causes.slice(0, SHOWN).map((cause) => this.#link(cause, things > 1));
    const more = things - links.length, others = causes.slice(SHOWN).map(({ text, tasks }) => `${tasks} for ${text}`);
    const rest = more > 0 ? element("span", { class: "faint", text: `and ${more} more`, title: others.join("\n") }) : null;
    this.panel.replaceChildren(element("span", { text: head }), ...links, ...rest ? [rest] : []);
  }

  #link({ text, tasks, number }, isCounted) {
    const told = isCounted ? `${tasks} for ${text}` : text, made = element("button", { class: "link", text: told, title: `${told}: go there` });
    made.dataset.number = number;
    made.addEventListener("click", () => this.choose(number));
    return made;
  }
}
