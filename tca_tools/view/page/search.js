// Finding tasks: by name, number, state, or the module that handled them. Several words must all fit.

import { lastNotAfter } from "./store.js";

export class Search {
  constructor(store, { tree, choose, changed }) {
    Object.assign(this, { store, tree, choose, changed });
    this.input = document.getElementById("search");
    this.found = [];
    this.place = -1;
    this.input.addEventListener("input", () => this.update());
    this.input.addEventListener("keydown", (event) => {
      if (event.key === "Enter") this.next(event.shiftKey ? -1 : 1);
      if (event.key === "Escape") {
        this.input.value = "";
        this.input.blur();
        this.update();
      }
    });
  }

  update(time = this.time) {
    this.time = time;
    const words = this.input.value.toLowerCase().split(/\s+/).filter(Boolean);
    const sent = words.length ? this.store.sentBy(this.store.tasks, time) : 0;
    const moment = lastNotAfter(this.store.times, time); // what is found changes with messages, not with time
    const asked = `${words.join(" ")}@${moment}#${this.store.version}`;
    if (asked === this.asked) return;
    this.asked = asked;
    this.found = this.store.tasks.slice(0, sent).filter((task) => words.every((word) => this.#fits(task, word)));
    this.place = -1;
    this.tree.found = new Set(this.found);
    document.getElementById("found").textContent = words.length ? `${this.found.length} found` : "";
    this.changed();
  }

  next(step) {
    if (!this.found.length) return;
    this.place = (this.place + step + this.found.length) % this.found.length;
    document.getElementById("found").textContent = `${this.place + 1} of ${this.found.length}`;
    this.choose(this.found[this.place].id);
  }

  #fits(task, word) {
    if (task.name.toLowerCase().includes(word) || String(task.id) === word) return true;
    if (this.store.looksOf(task, this.time).name.split(/[ ()]+/).includes(word)) return true;
    for (const module of task.modules ?? []) if (module.toLowerCase().includes(word)) return true;
    return false;
  }
}
