// The rows of the tree: open subtrees, with long runs of tasks in one state folded.

import { isOver } from "./store.js";

const SMALL = 60; // a run of at most this many tasks is shown whole
const MOST_CHILDREN = 24; // if a task has more children, runs of children in one state are folded
const LONGEST_RUN = 8; // a longer run is folded
const KEPT_AT_ENDS = 2; // tasks at each end of a run that stay

export class Outline {
  constructor(store) {
    this.store = store;
    this.opened = new Map(); // whether the reader has opened or closed a task
    this.unfolded = new Set(); // tasks whose folded runs the reader has opened
    this.chosen = null;
    this.neverFolded = new Set(); // the chosen task and its ancestors
  }

  choose(task) {
    this.chosen = task;
    this.neverFolded.clear();
    for (let above = task; above; above = above.parent) this.neverFolded.add(above);
  }

  isOpen(task, time) {
    const decided = this.opened.get(task);
    if (decided !== undefined) return decided;
    if (this.store.tasks.length <= SMALL) return true;
    const state = this.store.stateAt(task, time);
    return !isOver(state) || state === "failed" || (state === "killed" && task.failedBelow <= time);
  }

  toggle(task, time) { this.opened.set(task, !this.isOpen(task, time)); }

  // Open the ancestors of a task, so that it has a row.
  reveal(task) {
    for (let above = task.parent; above; above = above.parent) this.opened.set(above, true);
  }

  // Open tasks from the top down while the rows have room.
  openInto(room, time) {
    for (const tried = new Set(); ;) {
      const closed = this.rows(time).filter(({ task, children, open }) => task && children && !open && !tried.has(task));
      if (!closed.length) return;
      const { task } = closed.reduce((first, row) => (row.depth < first.depth ? row : first));
      tried.add(task);
      this.opened.set(task, true);
      if (this.rows(time).length > room) this.opened.delete(task);
    }
  }

  // The rows at a time: { task } or, for a folded run, { folded, state, parent }; each with its depth.
  rows(time) {
    const rows = [], stack = [...this.#below(null, this.store.top, time, 0)].reverse();
    while (stack.length) {
      const row = stack.pop();
      row.place = rows.length;
      rows.push(row);
      if (!row.task) continue;
      row.children = this.store.countSent(row.task.children, time);
      row.open = row.children > 0 && this.isOpen(row.task, time);
      if (row.open) {
        const below = this.#below(row.task, row.task.children, time, row.depth + 1);
        for (let i = below.length - 1; i >= 0; i--) stack.push(below[i]);
      }
    }
    return rows;
  }

  #below(parent, children, time, depth) {
    const sent = this.store.countSent(children, time);
    if (sent <= MOST_CHILDREN || this.unfolded.has(parent)) {
      const rows = new Array(sent);
      for (let i = 0; i < sent; i++) rows[i] = { task: children[i], depth };
      return rows;
    }
    const rows = [];
    for (let i = 0; i < sent;) {
      const state = this.store.stateAt(children[i], time);
      let end = i + 1;
      if (!this.neverFolded.has(children[i]) && !this.#hasFailed(children[i], time)) while (end < sent && this.#isAlike(children[end], state, time)) end++;
      const fold = end - i > LONGEST_RUN && !this.#hasFailed(children[i], time);
      for (let j = i; j < end; j++) {
        if (fold && j === i + KEPT_AT_ENDS) {
          const last = end - KEPT_AT_ENDS;
          rows.push({ task: null, folded: last - j, state, parent, depth, key: children[j].id });
          j = last - 1;
        } else {
          rows.push({ task: children[j], depth });
        }
      }
      i = end;
    }
    return rows;
  }

  #isAlike(task, state, time) {
    return this.store.stateAt(task, time) === state && !this.neverFolded.has(task) && !this.#hasFailed(task, time);
  }

  // Whether it or one of its descendants failed.
  #hasFailed(task, time) {
    return task.failedBelow <= time || this.store.stateAt(task, time) === "failed";
  }
}
