// Why the tasks in sight wait, or how they ended: asked of the server, and shown until there is news, as long as it can
// still be so.

import { soon } from "./dom.js";
import { NEVER } from "./store.js";

export const NOTHING = { waits: [], ahead: [] };

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
    const hasEnded = ({ number, because = [] }) => store.hasEnded(number, note.time, time) || because.some(hasEnded);
    if (note.waits.some(hasEnded)) return undefined;
    return note.end && store.hasChanged(note.end.number, note.time, time) ? { ...note, end: null } : note;
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
    const state = this.store.stateAt(task, this.time);
    return this.of(task, this.time)?.asked !== this.asked && state !== NEVER && this.store.head.states[state].name !== "achieved";
  }
}
