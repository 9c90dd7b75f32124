// The choice of the run: a fixed one from the list, or always the newest. The page requests a run by its address, which
// never changes. Its name may change, as when another run starts in its folder.

import { element } from "./dom.js";

const LEFT = "left"; // the session's key of the run that the page has left for a newer one
const chosen = new URLSearchParams(location.search).get("run"); // from the address; null: the server's first choice

export class Runs {
  // `isMoved` says whether the reader has chosen a time or a task: then the page does not switch to another run.
  constructor(store, { isMoved }) {
    Object.assign(this, { store, isMoved });
    this.known = null; // the newest run that the reader knows
    this.names = null; // of the present runs, by address
    this.latest = null; // the run that the list marks as newest
    this.isLeaving = false; // whether the browser is loading another run
    this.list = document.getElementById("runs");
    this.note = document.getElementById("newer");
    this.list.addEventListener("change", () => this.#choose(this.list.value, this.latest));
    this.list.addEventListener("focus", () => this.#fetch());
    this.note.querySelector("button").addEventListener("click", () => this.#choose(this.newest, this.newest));
  }

  // Switch to a newer run, or show a note about it.
  update() {
    if (this.isLeaving) return;
    const { newest, newestAtStart, run, name, follows } = this.store.head, announced = JSON.stringify([newest, run, name]);
    this.#announceSwitch();
    if (announced === this.announced) return;
    const isSame = newest.run === this.newest;
    this.announced = announced;
    this.known ??= chosen === null && !follows ? newestAtStart : newest.run; // with a LOG, only runs newer than that start are announced
    this.newest = newest.run;
    this.#fetch();
    this.note.firstElementChild.textContent = `a newer run has started: ${newest.name}`;
    if (isSame || newest.run === this.known || newest.run === run) return;
    if (follows && !chosen && !this.isMoved()) {
      this.isLeaving = true;
      sessionStorage.setItem(LEFT, run);
      return go(null);
    }
    this.note.hidden = false;
  }

  // Report that the page has switched to a newer run, as soon as its start is known, with a button to go back.
  #announceSwitch() {
    const left = sessionStorage.getItem(LEFT), { run, name, began } = this.store.head, note = document.getElementById("over");
    if (this.isLeaving || left === null || began === null || this.names === null) return;
    sessionStorage.removeItem(LEFT);
    if (left === run || chosen !== null) return;
    const [text, back, close] = note.children;
    text.textContent = `A new run has started, and is shown now: ${name}, started ${new Date(began * 1000).toLocaleString()}.`;
    back.hidden = !this.names.has(left);
    back.textContent = `back to ${this.names.get(left)}`;
    back.addEventListener("click", () => go(left));
    close.addEventListener("click", () => { note.hidden = true; });
    note.hidden = false;
  }

  // The query of the address: the run, if it was chosen or a time or task of it is named.
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
    if (!this.names.has(run)) runs.push({ run, name: `${name} (removed)`, isNewest: false, began: null });
    this.#list(runs.map((one) => [one.run, one.name + (one.isNewest && one.began !== null ? " (newest)" : "")]), run);
    this.#announceSwitch();
  }

  #list(options, run) {
    this.list.hidden = options.length < 2;
    document.getElementById("name").hidden = !this.list.hidden;
    document.getElementById("outcomes").hidden = this.list.hidden;
    const shown = [...this.list.options].map(({ value, text }) => [value, text]);
    if (JSON.stringify(shown) === JSON.stringify(options)) return; // an open list is left alone
    this.list.replaceChildren(...options.map(([value, text]) => element("option", { value, text, selected: value === run })));
  }

  // The list names the shown run until another one is loaded.
  #choose(run, newest) {
    this.list.value = this.store.head.run;
    go(run === newest && this.store.head.follows ? null : run);
  }
}

// Load the page of another run.
export function go(run) { location.assign(location.pathname + (run === null ? "" : asked(run))); }

function asked(run) { return `?run=${encodeURIComponent(run).replaceAll("%2F", "/")}`; }

// The parameter of a request that names the run, so that all answers are about the same run.
export function ofRun(head) {
  const run = head?.run ?? chosen;
  return run === null ? {} : { run };
}
