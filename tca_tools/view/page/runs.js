// Which run is shown: chosen from those there are, or the newest one, whichever that is.

import { element } from "./format.js";

const chosen = new URLSearchParams(location.search).get("run"); // by the address; null: the one to begin with

export class Runs {
  // `isMoved` says whether the reader has gone to a moment or a task, from which he is not to be taken away.
  constructor(store, { isMoved }) {
    Object.assign(this, { store, isMoved });
    this.known = null; // the newest run when the page was opened
    this.list = document.getElementById("runs");
    this.note = document.getElementById("newer");
    this.list.addEventListener("change", () => go(this.list.value === this.newest && this.store.head.follows ? null : this.list.value));
    this.list.addEventListener("focus", () => this.#fetch());
    this.note.querySelector("button").addEventListener("click", () => go(this.store.head.follows ? null : this.newest));
  }

  // What has been said of the runs: over to one that has begun since, or a note that it has.
  update() {
    const { newest, run, follows } = this.store.head;
    if (newest === this.newest) return;
    this.known ??= newest;
    this.newest = newest;
    this.#fetch();
    if (newest === this.known || newest === run) return;
    if (follows && !chosen && !this.isMoved()) return go(null);
    this.note.hidden = false;
    this.note.firstElementChild.textContent = `a newer run has begun: ${newest}`;
  }

  // What the address has to say of the run beside a moment or task of it.
  search(isMoved) {
    const { head } = this.store;
    if (chosen !== null) return location.search;
    return isMoved && head?.follows ? `?run=${encodeURIComponent(head.run)}` : "";
  }

  async #fetch() {
    const answer = await fetch("api/runs").catch(() => null), runs = answer?.ok ? await answer.json() : [];
    const { run } = this.store.head;
    this.list.hidden = runs.length < 2;
    document.getElementById("name").hidden = !this.list.hidden;
    const shown = [...this.list.options].map(({ value }) => value);
    if (shown.join() === runs.map(({ name }) => name).join()) return; // an open list is left alone
    this.list.replaceChildren(...runs.map((one, i) => element("option", {
      value: one.name, selected: one.name === run, text: `${one.label}${i || one.began === null ? "" : " (newest)"}`,
    })));
  }
}

// To another run: the page begins anew.
function go(run) { location.assign(location.pathname + (run === null ? "" : `?run=${encodeURIComponent(run)}`)); }

// What a question to the server says of the run, so that all answers are of one.
export function ofRun(head) {
  const run = head?.run ?? chosen;
  return run === null ? {} : { run };
}
