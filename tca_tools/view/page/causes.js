// What all tasks that wait wait for in the end: how many wait for how many things, and what these are.

import { element, seconds, soon } from "./format.js";
import { hasChanged, toldOf } from "./stale.js";
import { lastNotAfter } from "./store.js";

const SHOWN = 4;
const LEAST = 150; // milliseconds between two questions
const FAR = 2; // seconds of the run: where the reader has gone so far, what was told before is not shown any more
const OLD = 0.5; // seconds of the run, after which news may have changed more than what is named
const REST = 3000; // milliseconds in which nothing is asked, at most: for as long as the last answer took

export class Causes {
  constructor(store, { choose, ask }) {
    Object.assign(this, { store, choose, ask });
    this.panel = document.getElementById("causes");
    this.#forget();
    this.isAsking = false;
    this.hasMoved = false; // the reader has, since it was asked: he does not wait until a rest is over
    this.rest = null; // a timer
    this.fetch = soon(() => this.#fetch(), LEAST);
  }

  show(time, isFollowing) {
    this.hasMoved ||= !(isFollowing && this.isFollowing) && Math.abs(time - this.time) > FAR;
    Object.assign(this, { time, isFollowing });
    this.moment = lastNotAfter(this.store.times, time);
    this.wanted = `${this.moment}#${this.store.version}`; // what is known changes with messages
    if (this.answer && this.answer.asked !== this.wanted) { // some of it may not be so any more
      if (this.#isFar(this.answer.at)) this.#forget();
      else this.#draw();
    }
    if (this.hasMoved && this.rest !== null) this.#goOn();
    else if (this.wanted !== this.asked) this.fetch();
  }

  #goOn() {
    clearTimeout(this.rest);
    this.rest = null;
    this.isAsking = false;
    if (this.wanted !== this.asked) this.fetch();
  }

  async #fetch() {
    if (this.isAsking || this.wanted === this.asked) return; // the answer comes back here
    this.isAsking = true;
    this.hasMoved = false;
    this.asked = this.wanted;
    const begun = performance.now(), { asked, time: at } = this, told = toldOf(this.store, this.moment);
    const answer = await this.ask("causes", { at });
    if (answer && this.#isFar(at)) this.#forget();
    else if (answer) {
      this.answer = { ...answer, asked, told, at };
      this.#draw();
    }
    this.rest = setTimeout(() => this.#goOn(), this.hasMoved ? 0 : Math.min(performance.now() - begun, REST));
  }

  #isFar(at) { return this.hasMoved && Math.abs(this.time - at) > FAR; }

  #forget() {
    this.answer = null; // what was told last, and of when
    this.asked = ""; // of when
    this.drawn = ""; // which of it is shown
    this.panel.replaceChildren(element("span", { class: "faint", text: "what is waited for is being looked for …" }));
  }

  // What was told of an earlier moment is said to be of that, if it is long ago, or if a cause is in another state now.
  #draw() {
    const { waiting, things, causes, asked, told, at } = this.answer;
    const isOld = this.time - at > OLD || causes.some(({ text }) => hasChanged(this.store, text, told, this.time));
    const isNow = asked === this.wanted || !isOld, drawn = `${asked} ${isNow}`;
    if (drawn === this.drawn) return; // what is pressed just now stays there
    this.drawn = drawn;
    const asOf = isNow ? [] : [element("span", { class: "faint", text: `as of ${seconds(at)}` })]; // the new ones are on their way
    if (!waiting) return this.panel.replaceChildren(element("span", { class: "faint", text: "nothing waits" }), ...asOf);
    const head = `${waiting} ${waiting === 1 ? "waits" : "wait"} for ${things} ${things === 1 ? "thing" : "things"}:`;
    const links = causes.slice(0, SHOWN).map((cause) => this.#link(cause, things > 1));
    const more = things - links.length, others = causes.slice(SHOWN).map(({ text, tasks }) => `${tasks} for ${text}`);
    if (more > 0) links.push(element("span", { class: "faint", text: `and ${more} more`, title: others.join("\n") }));
    const title = causes.reduce((sum, { tasks }) => sum + tasks, 0) > waiting ? "a task that waits for several things counts for each" : "";
    this.panel.replaceChildren(element("span", { class: isNow ? "" : "faint", text: head, title }), ...links, ...asOf);
  }

  #link({ text, tasks, number }, isCounted) {
    const told = isCounted ? `${tasks} for ${text}` : text, made = element("button", { class: "link", text: told, title: `${told}: go there` });
    made.dataset.number = number;
    made.addEventListener("click", () => this.choose(number));
    return made;
  }
}
