// What all tasks that wait wait for in the end: how many wait for how many things, and what these are.

import { element, soon } from "./dom.js";
import { counted } from "./words.js";

const SHOWN = 4;
const LEAST = 150; // milliseconds between two questions

export class Causes {
  constructor(store, { choose, ask }) {
    Object.assign(this, { store, choose, ask });
    this.panel = document.getElementById("causes");
    this.isAsking = false;
    this.fetch = soon(() => this.#fetch(), LEAST);
  }

  show(time) {
    this.time = time;
    this.wanted = this.store.known(time);
    if (this.wanted !== this.asked) this.fetch();
  }

  async #fetch() {
    if (this.isAsking || this.wanted === this.asked) return; // the answer comes back here
    this.isAsking = true;
    this.asked = this.wanted;
    const begun = performance.now(), answer = await this.ask("causes", { at: this.time }), told = JSON.stringify(answer);
    if (answer && told !== this.told) this.#draw(answer); // what is pressed just now stays there
    if (answer) this.told = told;
    setTimeout(() => { // a rest as long as that took: where very many wait, the server has other things to do, too
      this.isAsking = false;
      this.fetch();
    }, performance.now() - begun);
  }

  #draw({ waiting, things, causes }) {
    if (!waiting) return this.panel.replaceChildren(element("span", { class: "faint", text: "nothing waits" }));
    const head = `${waiting.toLocaleString("en")} ${waiting === 1 ? "waits" : "wait"} for ${counted(things, "thing")}:`;
    const told = causes.map((cause) => (things > 1 ? `${cause.tasks.toLocaleString("en")} for ` : "") + cause.text);
    const links = told.slice(0, SHOWN).map((text, place) => this.#link(text, causes[place].goto));
    const more = things - links.length;
    if (more > 0) links.push(element("span", { class: "faint", text: `and ${more.toLocaleString("en")} more`, title: told.slice(SHOWN).join("\n") }));
    const title = causes.reduce((sum, { tasks }) => sum + tasks, 0) > waiting ? "a task that waits for several things counts for each" : "";
    this.panel.replaceChildren(element("span", { text: head, title }), ...links);
  }

  #link(text, number) {
    const made = element("button", { class: "link", text, title: `${text}: go there` });
    made.dataset.number = number;
    made.addEventListener("click", () => this.choose(number));
    return made;
  }
}
