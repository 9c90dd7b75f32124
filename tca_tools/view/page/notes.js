// Notes on the tasks in sight: why they wait, or how they ended. The server composes them. After news a note is shown until
// the next answer, if it can still be true.

import { soon } from "./dom.js";

const NOTHING = { text: "", end: "", whole: "", names: [], last: 0 };

export class Notes {
  // `changed` is called when notes have changed.
  constructor(store, { ask, changed }) {
    Object.assign(this, { store, ask, changed });
    this.known = new Map(); // by number of a task: its note, with the version and the time for which it was requested
    this.wanted = []; // the tasks in sight
    this.isAsking = false;
    this.fetch = soon(() => this.#fetch(), 120);
  }

  // The note on a task; undefined if none is known that can be true.
  of(task, time) {
    const note = this.known.get(task.id), { store } = this;
    if (note === undefined || store.stateStart(task, note.time) !== store.stateStart(task, time)) return undefined;
    if (note.asked === this.asked) return note;
    if (note.names.some((number) => store.hasEnded(number, note.time, time))) return undefined;
    return store.hasChanged(note.last, note.time, time) ? { ...note, end: "" } : note;
  }

  // Fetch the notes on these tasks that are not known. Notes change with new entries, not with time.
  want(tasks, time) {
    Object.assign(this, { wanted: tasks, time, asked: this.store.versionAt(time) });
    this.fetch();
  }

  async #fetch() {
    if (this.isAsking) return; // `changed` draws the tree, which calls `want` again
    const { asked, time, store } = this, tasks = this.wanted.filter((task) => this.#isWanted(task));
    if (!tasks.length) return;
    this.isAsking = true;
    const notes = await this.ask("notes", { ids: tasks.map((task) => task.id).join(","), at: time });
    this.isAsking = false;
    if (!notes) return;
    const since = store.times[store.lastEntry(time)] ?? -Infinity; // a note is true from the last entry on
    for (const task of tasks) this.known.set(task.id, { ...notes[task.id] ?? NOTHING, asked, time: Math.max(since, task.time) });
    this.changed();
  }

  #isWanted(task) {
    return this.of(task, this.time)?.asked !== this.asked && ![undefined, "achieved"].includes(this.store.stateAt(task, this.time));
  }
}
