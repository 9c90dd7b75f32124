// Why the tasks in sight wait, or how they ended: asked of the server, and shown until there is news, as long as it can
// still be so.

import { soon } from "./dom.js";

const NOTHING = { text: "", end: "", whole: "", names: [], last: 0 };

export class Notes {
  // `changed` is called when there are others.
  constructor(store, { ask, changed }) {
    Object.assign(this, { store, ask, changed });
    this.known = new Map(); // by task: what was answered, of which moment
    this.wanted = []; // tasks
    this.isAsking = false;
    this.fetch = soon(() => this.#fetch(), 120);
  }

  // That of a task; undefined where nothing is known.
  of(task, time) {
    const note = this.known.get(task.id), { store } = this;
    if (note === undefined || store.entered(task, note.time) !== store.entered(task, time)) return undefined;
    if (note.asked === this.asked) return note;
    if (note.names.some((number) => store.hasEnded(number, note.time, time))) return undefined;
    return store.hasChanged(note.last, note.time, time) ? { ...note, end: "" } : note;
  }

  // What is known changes with messages, not with time.
  want(tasks, time) {
    Object.assign(this, { wanted: tasks, time, asked: this.store.known(time) });
    this.fetch();
  }

  async #fetch() {
    if (this.isAsking) return; // the answer comes back here
    const { asked, time, store } = this, tasks = this.wanted.filter((task) => this.#isWanted(task));
    if (!tasks.length) return;
    this.isAsking = true;
    const notes = await this.ask("notes", { ids: tasks.map((task) => task.id).join(","), at: time });
    this.isAsking = false;
    if (!notes) return;
    const told = store.times[store.place(time)] ?? -Infinity; // it holds from there on
    for (const task of tasks) this.known.set(task.id, { ...notes[task.id] ?? NOTHING, asked, time: Math.max(told, task.time) });
    this.changed();
  }

  #isWanted(task) {
    return this.of(task, this.time)?.asked !== this.asked && ![undefined, "achieved"].includes(this.store.stateAt(task, this.time));
  }
}
