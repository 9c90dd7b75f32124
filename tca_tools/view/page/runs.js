// Which run is shown: chosen from those there are, or the newest one, whichever that is. The server asks for a run by an
// address that stays; what people call it may change, as when another one begins in its folder.

import { element } from "./dom.js";

const LEFT = "left"; // what the page remembers from one run to the next: the run that it went over from
const chosen = new URLSearchParams(location.search).get("run"); // by the address; null: the one to begin with

export class Runs {
  // `isMoved` says whether the reader has gone to a moment or a task, from which he is not to be taken away.
  constructor(store, { isMoved }) {
    Object.assign(this, { store, isMoved });
    this.known = null; // the newest run that the reader knows of
    this.names = null; // of the runs there are
    this.latest = null; // the one that the list calls the newest
    this.isLeaving = false; // for another run: until the browser has its page, this one goes on
    this.list = document.getElementById("runs");
    this.note = document.getElementById("newer");
    this.list.addEventListener("change", () => this.#choose(this.list.value, this.latest));
    this.list.addEventListener("focus", () => this.#fetch());
    this.note.querySelector("button").addEventListener("click", () => this.#choose(this.newest, this.newest));
  }

  // What has been said of the runs: over to one that has begun since, or a note that it has.
  update() {
    if (this.isLeaving) return;
    const { newest, newestAtStart, run, name, follows } = this.store.head, told = JSON.stringify([newest, run, name]);
    this.#sayOver();
    if (told === this.told) return;
    const isSame = newest.run === this.newest;
    this.told = told;
    this.known ??= chosen === null && !follows ? newestAtStart : newest.run; // who named a LOG chose among those of then
    this.newest = newest.run;
    this.#fetch();
    this.note.firstElementChild.textContent = `a newer run has begun: ${newest.name}`;
    if (isSame || newest.run === this.known || newest.run === run) return;
    if (follows && !chosen && !this.isMoved()) {
      this.isLeaving = true;
      sessionStorage.setItem(LEFT, run);
      return go(null);
    }
    this.note.hidden = false;
  }

  // That the page has gone over to another run by itself: to which, as soon as that tells when it began, and the way back.
  #sayOver() {
    const left = sessionStorage.getItem(LEFT), { run, name, began } = this.store.head, note = document.getElementById("over");
    if (this.isLeaving || left === null || began === null || this.names === null) return;
    sessionStorage.removeItem(LEFT);
    if (left === run || chosen !== null) return;
    const [said, back, close] = note.children;
    said.textContent = `A new run has begun, and is shown now: ${name}, begun ${new Date(began * 1000).toLocaleString()}.`;
    back.hidden = !this.names.has(left);
    back.textContent = `back to ${this.names.get(left)}`;
    back.addEventListener("click", () => go(left));
    close.addEventListener("click", () => { note.hidden = true; });
    note.hidden = false;
  }

  // What the address has to say of the run beside a moment or task of it.
  search(isMoved) {
    const { head } = this.store;
    if (chosen !== null) return location.search;
    return isMoved && head?.follows ? asked(head.run) : "";
  }

  async #fetch() {
    const answer = await fetch("api/runs").catch(() => null);
    if (!answer?.ok) return;
    const runs = await answer.json(), { run, name } = this.store.head;
    this.names = new Map(runs.map((one) => [one.run, one.name]));
    this.latest = runs.find(({ isNewest }) => isNewest)?.run;
    if (!this.names.has(run)) runs.push({ run, name: `${name}, which is not there any more`, isNewest: false, began: null });
    this.#list(runs.map((one) => [one.run, one.name + (one.isNewest && one.began !== null ? " (newest)" : "")]), run);
    this.#sayOver();
  }

  #list(options, run) {
    this.list.hidden = options.length < 2;
    document.getElementById("name").hidden = !this.list.hidden;
    document.getElementById("outcomes").hidden = this.list.hidden;
    const shown = [...this.list.options].map(({ value, text }) => [value, text]);
    if (JSON.stringify(shown) === JSON.stringify(options)) return; // an open list is left alone
    this.list.replaceChildren(...options.map(([value, text]) => element("option", { value, text, selected: value === run })));
  }

  // The list goes on to say what is shown, until something else is.
  #choose(run, newest) {
    this.list.value = this.store.head.run;
    go(run === newest && this.store.head.follows ? null : run);
  }
}

// To another run: the page begins anew.
export function go(run) { location.assign(location.pathname + (run === null ? "" : asked(run))); }

function asked(run) { return `?run=${encodeURIComponent(run).replaceAll("%2F", "/")}`; }

// What a question to the server says of the run, so that all answers are of one.
export function ofRun(head) {
  const run = head?.run ?? chosen;
  return run === null ? {} : { run };
}
