// The last causes of all waits: the number of waiting tasks, the number of causes, and the most frequent causes.

import { element, soon } from "./dom.js";
import { counted } from "./words.js";

const SHOWN = 4;
const INTERVAL = 150; // milliseconds between two requests

export class Causes {
  constructor(store, { choose, ask }) {
    Object.assign(this, { store, choose, ask });
    this.panel = document.getElementById("causes");
    this.isAsking = false;
    this.fetch = soon(() => this.#fetch(), INTERVAL);
  }

  show(time) {
    this.time = time;
    this.wanted = this.store.versionAt(time);
    if (this.wanted !== this.asked) this.fetch();
  }

  async #fetch() {
    if (this.isAsking || this.wanted === this.asked) return; // it is called again after the answer
    this.isAsking = true;
    this.asked = this.wanted;
    const begun = performance.now(), answer = await this.ask("causes", { at: this.time }), text = JSON.stringify(answer);
    if (answer && text !== this.drawn) this.#draw(answer); // unchanged links are not replaced: one may be pressed just now
    if (answer) this.drawn = text;
    setTimeout(() => { // a pause as long as the request: with very many waits it is slow, and the server has other requests
      this.isAsking = false;
      this.fetch();
    }, performance.now() - begun);
  }

  #draw({ waiting, things, causes }) {
    if (!waiting) return this.panel.replaceChildren(element("span", { class: "faint", text: "nothing waits" }));
    const head = `${waiting.toLocaleString("en")} ${waiting === 1 ? "waits" : "wait"} for ${counted(things, "thing")}:`;
    const texts = causes.map((cause) => (things > 1 ? `${cause.tasks.toLocaleString("en")} for ` : "") + cause.text);
    const links = texts.slice(0, SHOWN).map((text, place) => this.#link(text, causes[place].goto));
    const more = things - links.length;
    if (more > 0) links.push(element("span", { class: "faint", text: `and ${more.toLocaleString("en")} more`, title: texts.slice(SHOWN).join("\n") }));
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
