// The run, as far as the server has told it: columns that only grow, and what can be asked of them for any moment.

import { firstWith, newRow } from "./rows.js";
import { ofRun } from "./runs.js";

// The last place in a sorted list whose value is not beyond `value`; -1 if all are.
export function lastNotAfter(list, value) { return firstWith(list, (one) => one > value) - 1; }

// Whether the run had gone on after a failure by a time, or still might; of one that is to come, as far as is known. Each
// turn makes it the other way round.
export function wasHandled(failure, time) {
  if (!failure || time < failure.time) return Boolean(failure?.handled);
  return lastNotAfter(failure.turns, time) % 2 === 0;
}

// A frame's columns by table (see columns.py): { task: { id, name, ... }, ... }. `texts` are those known so far.
function columnsIn(frame, texts) {
  for (const text of frame.texts) texts.push(text);
  const tables = {};
  for (const [table, columns] of Object.entries(frame.tables)) {
    tables[table] = {};
    for (const [key, values] of Object.entries(columns)) {
      const [name, kind] = key.split(":");
      tables[table][name] = kind === "t" ? values.map((place) => texts[place]) : values;
    }
  }
  return tables;
}

export const RESOLVED = "done after a failure";

export function isOver(state) { return ["achieved", RESOLVED, "failed", "killed"].includes(state); }

// States come in the order of time: what is noted of a task is noted of all above it.
function noteFailure(task, time) {
  for (let above = task.parent; above && above.failedBelow === Infinity; above = above.parent) above.failedBelow = time;
}

export class Store {
  constructor() {
    this.lengths = {};
    this.head = null;
    this.texts = [];
    this.times = []; // of entries
    this.tasks = []; // see #addTasks
    this.byId = new Map();
    this.top = [];
    this.messages = []; // that are no tasks: { id, name, time, modules, said, queued }
    this.messageById = new Map();
    this.rows = []; // of the chart: see rows.js
    this.spans = []; // { row, kind, name, message, within, lane, start, end, outcome, waits, failure, lanes, by }
    this.failed = new Set(); // the tasks that were ever in that state
    this.failures = []; // those of messages, as they were raised: { message, time, span, handled, turns }
    this.failuresOf = new Map(); // the same by message
    this.verdicts = []; // the same by their rows, with those of what came directly
    this.links = []; // who sends what to whom: { sender, message, kind, handler, times, less }, see traffic.py
    this.pictures = new Map(); // by name: { times, messages }, see pictures.py
    this.version = 0;
    this.first = Infinity; // when the first message was sent or handled
    this.lastly = -Infinity; // when something began or ended last, other than a connection
    this.open = 0; // spans that have not ended, other than connections and locks
    this.end = 0; // of the run, as far as it has come
    this.heard = 0; // when the newest answer came, by the browser's clock
  }

  get start() { return this.times.length ? this.times[0] : 0; }
  get last() { return this.times.length ? this.times[this.times.length - 1] : 0; }
  colour(name) { return this.head.colours[name] ?? "#51606f"; } // of a message; gray, if it has none
  get isLive() { return typeof this.head?.now === "number"; }

  // Time goes on between two answers of the server, while the run does.
  goOn() {
    if (this.isLive) this.end = Math.max(this.last, this.head.now + (performance.now() - this.heard) / 1000);
  }

  // Nobody says any more that it goes on.
  stand() { if (this.head) this.head.now = null; }

  // Ask the server for what is new; waits there while nothing is, unless the answer is wanted at once.
  async more(atOnce = false) {
    const token = this.head ? { token: this.head.token } : {};
    const asked = { since: JSON.stringify(this.lengths), ...token, ...ofRun(this.head), ...(atOnce ? { wait: 0 } : {}) };
    const answer = await fetch(`api/frame?${new URLSearchParams(asked)}`);
    if (answer.status === 410) location.reload(); // the server reads the run anew
    if (answer.status === 404) throw new Error((await answer.json()).error);
    if (!answer.ok) throw new Error(`the server says ${answer.status}`);
    const frame = await answer.json();
    this.heard = performance.now();
    this.add(frame);
  }

  add(frame) {
    const tables = columnsIn(frame, this.texts);
    const { tables: _, ...head } = frame;
    this.head = head;
    for (const time of tables.entry.time) this.times.push(time);
    this.#addTasks(tables.task);
    this.#addMessages(tables.message);
    this.#addStates(tables.state);
    this.#addSaid(tables.said);
    this.#addHolds(tables.hold);
    this.#addPreviews(tables.preview);
    tables.row.label.forEach((label, i) => this.rows.push(newRow(label, tables.row.module[i])));
    this.#addSpans(tables.span);
    tables.suspended.span.forEach((span, i) => { this.spans[span].by = tables.suspended.by[i]; });
    this.#endSpans(tables.end);
    tables.change.span.forEach((number, i) => this.#addChange(this.spans[number], tables.change.time[i], tables.change.text[i]));
    this.#addFailures(tables.failure);
    this.#addVerdicts(tables.verdict);
    this.#addTraffic(tables);
    this.#addPictures(tables.picture);
    this.lengths = head.lengths;
    this.version += 1;
    this.end = this.last;
    this.goOn();
  }

  #addPictures({ message, name, time }) {
    name.forEach((one, i) => {
      if (!this.pictures.has(one)) this.pictures.set(one, { times: [], messages: [] });
      const { times, messages } = this.pictures.get(one);
      times.push(time[i]);
      messages.push(message[i]);
    });
  }

  #addTasks({ id: ids, parent: parents, name, sender, role, form, time }) {
    ids.forEach((id, i) => {
      const parent = this.byId.get(parents[i]) ?? null, task = {
        id, parent, name: name[i], sender: sender[i], role: role[i], form: form[i], time: time[i], depth: parent ? parent.depth + 1 : 0,
        children: [], times: [], states: [], holds: [], previews: [], modules: null, said: [], queued: [], // said: how it failed or why it was killed; queued: its spans
        failedBelow: Infinity, // since when something under it has failed
      };
      this.first = Math.min(this.first, task.time);
      this.byId.set(id, task);
      this.tasks.push(task);
      (parent ? parent.children : this.top).push(task);
    });
  }

  #addMessages({ id: ids, name, time }) {
    ids.forEach((id, i) => {
      const message = { id, name: name[i], time: time[i], modules: null, said: [], queued: [] };
      this.messages.push(message);
      this.messageById.set(id, message);
    });
  }

  #addStates({ task: ids, time, state }) {
    ids.forEach((id, i) => {
      const task = this.byId.get(id);
      task.times.push(time[i]);
      task.states.push(state[i]);
      this.lastly = Math.max(this.lastly, time[i]);
      if (state[i] !== "failed") return;
      this.failed.add(task);
      noteFailure(task, time[i]);
    });
  }

  #addSaid({ message, time, text, kill }) {
    message.forEach((id, i) => this.find(id)?.said.push({ time: time[i], text: text[i].toLowerCase(), isKill: Boolean(kill[i]) }));
  }

  #addHolds({ task: ids, before: others, kind, time }) {
    ids.forEach((id, i) => {
      const task = this.byId.get(id), before = this.byId.get(others[i]);
      if (task && before && task !== before) task.holds.push({ before, kind: kind[i], time: time[i] });
    });
  }

  // What tasks are to the coordinator that sent them.
  #addPreviews({ task: ids, time, role }) {
    ids.forEach((id, i) => this.byId.get(id)?.previews.push({ time: time[i], role: role[i] }));
  }

  // In words, at a time; "" of what was sent for the current state.
  previewOf(task, time) {
    const role = task?.previews.findLast((one) => one.time <= time)?.role;
    return this.head.previewed[role] ?? "";
  }

  // Until when the task of a bar ran ahead of its state, and whether for nothing; null if it was not sent ahead.
  aheadOf({ kind, message }) {
    const previews = kind === "handling" && this.byId.get(message)?.previews || [];
    if (previews[0]?.role !== "ahead") return null;
    return { until: previews.find(({ role }) => role === "kept")?.time ?? Infinity, isWasted: previews.at(-1).role === "wasted" };
  }

  // A client of a task asked for something, or was answered.
  #addChange(span, time, text) { this.rows[span.row].changes.push({ span, time, text }); }

  #addFailures({ message: messages, time, span: spans, beside }) {
    messages.forEach((message, i) => {
      const span = this.spans[spans[i]];
      const failure = { message, time: time[i], span, handled: false, turns: [] }; // handled: the run went on after it, or still may; turns: when that changed
      this.verdicts.push(failure);
      if (span && beside[i]) this.rows[span.row].raised.push(failure);
      else if (span) span.failure = failure;
      if (!message) return;
      this.failures.push(failure);
      if (!this.failuresOf.has(message)) this.failuresOf.set(message, []);
      this.failuresOf.get(message).push(failure);
    });
  }

  #addVerdicts({ failure: rows, good, time }) {
    rows.forEach((row, i) => {
      this.verdicts[row].handled = Boolean(good[i]);
      this.verdicts[row].turns.push(time[i]);
    });
  }

  #addTraffic({ link: { sender, message, kind, handler }, sent }) {
    sender.forEach((_, i) => this.links.push({ sender: sender[i], message: message[i], kind: kind[i], handler: handler[i], times: [], less: [] }));
    sent.link.forEach((link, i) => (sent.less[i] ? this.links[link].less : this.links[link].times).push(sent.time[i]));
  }

  #addSpans({ row, kind, name, message, within, lane, start }) {
    row.forEach((_, i) => {
      const span = {
        row: row[i], kind: kind[i], name: name[i], message: message[i], within: within[i], lane: lane[i],
        start: start[i], end: Infinity, outcome: "", waits: [], failure: null, lanes: null, by: "",
      };
      this.#happened(span, span.start, 1);
      this.spans.push(span);
      this.#place(span);
    });
  }

  #endSpans({ span: spans, time, outcome }) {
    spans.forEach((number, i) => {
      const span = this.spans[number];
      Object.assign(span, { end: time[i], outcome: outcome[i] });
      this.#happened(span, span.end, -1);
      span.lanes?.end(span);
      if (span.outcome === "failed") this.rows[span.row].failed.push(span);
    });
  }

  // A span began or ended.
  #happened({ kind }, time, change) {
    if (kind === "connected") return;
    this.first = Math.min(this.first, time);
    this.lastly = Math.max(this.lastly, time);
    if (kind !== "held") this.open += change; // a lock may stay for ever
  }

  // Whether something has a bar to the end.
  get goesOn() { return this.open > 0; }

  // Put a span where the chart finds it.
  #place(span) {
    const row = this.rows[span.row];
    if (span.kind === "waiting" && span.within >= 0) {
      this.spans[span.within].waits.push(span);
    } else if (span.kind === "connected") {
      row.connected.push(span);
    } else {
      row.suspends ||= span.kind === "suspended";
      span.lanes = { queued: row.queued, suspended: row.queued, held: row.held }[span.kind] ?? row.handled;
      span.lanes.put(span);
    }
    const message = this.find(span.message);
    if (message && span.kind === "handling") (message.modules ??= new Set()).add(row.label);
    if (message && span.kind === "queued") message.queued.push(span);
  }

  // --- what was so at a moment -------------------------------------------------------------------------------------

  // A task, or another message.
  find(number) { return this.byId.get(number) ?? this.messageById.get(number); }

  // A task's state; undefined before it was sent.
  stateAt({ times, states }, time) {
    return time >= times.at(-1) ? states.at(-1) : states[lastNotAfter(times, time)];
  }

  // The number of the last entry that is known at a time, -1 before the first; and a text that changes with all that is.
  place(time) { return lastNotAfter(this.times, time); }
  known(time) { return `${this.place(time)}#${this.version}`; }

  // How a task stands at a time: its state; or, of a failure, that the run went on after it.
  looksOf(task, time) {
    const state = this.stateAt(task, time);
    return state === "failed" && wasHandled(this.lastFailure(task.id, time), time) ? this.head.handled : state;
  }

  // The tasks above those that stand as failed at a time, after which the run did not go on.
  aboveBad(time) {
    const known = this.known(time);
    if (this.bad?.known === known) return this.bad.above;
    this.bad = { known, above: new Set() };
    for (const task of this.failed) {
      if (this.looksOf(task, time) !== "failed") continue;
      for (let { parent } = task; parent && !this.bad.above.has(parent); { parent } = parent) this.bad.above.add(parent);
    }
    return this.bad.above;
  }

  // When the state that a task is in at a time began; undefined before it was sent.
  entered(task, time) { return task.times[lastNotAfter(task.times, time)]; }

  // How many of some tasks, oldest first, had been sent.
  sentBy(tasks, time) { return firstWith(tasks, (task) => task.time > time); }

  // How many tasks stand how at a time: [looks, count], in the order of the states.
  counts(time) {
    const { fills, handled } = this.head, counts = Object.fromEntries(Object.keys(fills).map((looks) => [looks, 0]));
    const sent = this.sentBy(this.tasks, time);
    for (let i = 0; i < sent; i++) counts[this.stateAt(this.tasks[i], time)]++;
    counts[handled] = [...this.failed].filter((task) => this.looksOf(task, time) === handled).length;
    counts.failed -= counts[handled];
    return Object.entries(counts).filter(([, count]) => count);
  }

  // When a task ended, if it has by then.
  ended(task, time) {
    return isOver(this.stateAt(task, time)) ? this.entered(task, time) : null;
  }

  // The failure that was raised on a message at a time.
  failureAt(message, time) { return this.failuresOf.get(message)?.find((one) => one.time === time); }

  // The newest failure of a task at a time.
  lastFailure(task, time) { return this.failuresOf.get(task)?.findLast((one) => one.time <= time); }

  // When the run went on after a task's newest failure, if it did only after that time.
  handledLater(task, time) {
    const failure = this.lastFailure(task, time);
    return failure?.handled ? failure.turns.find((turn) => turn > time) : undefined;
  }

  // Whether a task has ended between two times; and whether it is in another state.
  hasEnded(number, from, until) {
    const task = this.byId.get(number);
    return task !== undefined && this.ended(task, until) !== null && this.ended(task, from) === null;
  }

  hasChanged(number, from, until) {
    const task = this.byId.get(number);
    return task !== undefined && this.entered(task, from) !== this.entered(task, until);
  }
}
