// The part of the run that the server has sent: rows are only added. Answers questions about any time of it.

import { firstWith, newRow } from "./rows.js";
import { ofRun } from "./runs.js";

// The place of the last item of a sorted list that is at most `value`; -1 if all are greater.
export function lastNotAfter(list, value) { return firstWith(list, (one) => one > value) - 1; }

// Whether the run continued after a failure, or still may, by the verdict at a time. The first verdict is that it did
// not; each turn reverses the verdict. For a failure after that time, the newest verdict.
export function wasHandled(failure, time) {
  if (!failure || time < failure.time) return Boolean(failure?.handled);
  return lastNotAfter(failure.turns, time) % 2 === 0;
}

// A frame's columns by table (see columns.py): { task: { id, name, ... }, ... }. Adds the frame's texts to `texts`, those of all frames.
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

// Note the time in all ancestors of a failed task. States come in the order of time: an ancestor with a time keeps it, and so
// do the ancestors above it.
function noteFailureBelow(task, time) {
  for (let above = task.parent; above && above.failedBelow === Infinity; above = above.parent) above.failedBelow = time;
}

export class Store {
  constructor() {
    this.lengths = {}; // the number of rows received, by table
    this.head = null; // the newest frame without its columns
    this.texts = []; // all texts of the columns
    this.times = []; // of entries
    this.tasks = []; // see #addTasks
    this.byId = new Map();
    this.top = []; // top-level tasks
    this.messages = []; // other than tasks: { id, name, time, modules, reasons, queued }
    this.messageById = new Map();
    this.rows = []; // of the chart: see rows.js
    this.spans = []; // see #addSpans
    this.failed = new Set(); // the tasks that ever failed
    this.failures = []; // of messages and tasks, in the order of time, which is that of the table: see #addFailures
    this.failuresOf = new Map(); // the same, by message
    this.links = []; // { sender, message, kind, handler, times, less }, see traffic.py; less: the times at which the count decreases
    this.pictures = new Map(); // by name: { times, messages }, see pictures.py
    this.restarts = []; // of central: { time, text }
    this.members = []; // the centrals with the same replicated log: { time, text, standbys }
    this.version = 0;
    this.firstMessage = Infinity; // when the first message was sent or handled
    this.lastChange = -Infinity; // the time of the newest state, or start or end of a span other than a connection
    this.openSpans = 0; // the number of open spans, without connections and claims
    this.end = 0; // the present end of the run
    this.answeredAt = 0; // the time of the newest answer, by the browser's clock
  }

  get start() { return this.times.length ? this.times[0] : 0; }
  get last() { return this.times.length ? this.times[this.times.length - 1] : 0; }
  colour(name) { return this.head.colours[name] ?? "#51606f"; } // of a message; gray if it has no colour
  get isLive() { return typeof this.head?.now === "number"; }

  // Advance the end of a live run between two answers of the server.
  advance() {
    if (this.isLive) this.end = Math.max(this.last, this.head.now + (performance.now() - this.answeredAt) / 1000);
  }

  // Stop the run's time, when the server does not answer.
  stopClock() { if (this.head) this.head.now = null; }

  // Fetch new rows. Without news, the server delays its answer, unless it is wanted `atOnce`.
  async fetchMore(atOnce = false) {
    const token = this.head ? { token: this.head.token } : {};
    const asked = { since: JSON.stringify(this.lengths), ...token, ...ofRun(this.head), ...(atOnce ? { wait: 0 } : {}) };
    const answer = await fetch(`api/frame?${new URLSearchParams(asked)}`);
    if (answer.status === 410) location.reload(); // the server reads the journal again
    if (answer.status === 404) throw new Error((await answer.json()).error);
    if (!answer.ok) throw new Error(`status ${answer.status}`);
    const frame = await answer.json();
    this.answeredAt = performance.now();
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
    tables.restart.time.forEach((time, i) => this.restarts.push({ time, text: tables.restart.text[i] }));
    tables.members.time.forEach((time, i) => this.members.push({ time, text: tables.members.text[i], standbys: tables.members.standbys[i] }));
    this.lengths = head.lengths;
    this.version += 1;
    this.end = this.last;
    this.advance();
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
        children: [], times: [], states: [], holds: [], previews: [], modules: null, reasons: [], queued: [], // modules: those that handled it; reasons: texts of its failures and kills; queued: its spans
        failedBelow: Infinity, // the time of the first failure below it
      };
      this.firstMessage = Math.min(this.firstMessage, task.time);
      this.byId.set(id, task);
      this.tasks.push(task);
      (parent ? parent.children : this.top).push(task);
    });
  }

  #addMessages({ id: ids, name, time }) {
    ids.forEach((id, i) => {
      const message = { id, name: name[i], time: time[i], modules: null, reasons: [], queued: [] };
      this.messages.push(message);
      this.messageById.set(id, message);
    });
  }

  #addStates({ task: ids, time, state }) {
    ids.forEach((id, i) => {
      const task = this.byId.get(id);
      task.times.push(time[i]);
      task.states.push(state[i]);
      this.lastChange = Math.max(this.lastChange, time[i]);
      if (state[i] !== "failed") return;
      this.failed.add(task);
      noteFailureBelow(task, time[i]);
    });
  }

  #addSaid({ message, time, text, kill }) {
    message.forEach((id, i) => this.find(id)?.reasons.push({ time: time[i], text: text[i].toLowerCase(), isKill: Boolean(kill[i]) }));
  }

  #addHolds({ task: ids, before: others, kind, time }) {
    ids.forEach((id, i) => {
      const task = this.byId.get(id), before = this.byId.get(others[i]);
      if (task && before && task !== before) task.holds.push({ before, kind: kind[i], time: time[i] });
    });
  }

  // The roles of tasks for the coordinator that sent them.
  #addPreviews({ task: ids, time, role }) {
    ids.forEach((id, i) => this.byId.get(id)?.previews.push({ time: time[i], role: role[i] }));
  }

  // The role of a coordinator's task at a time, in words; "" for a task of the current state.
  previewOf(task, time) {
    const role = task?.previews.findLast((one) => one.time <= time)?.role;
    return this.head.previewed[role] ?? "";
  }

  // For the bar of a task that was sent ahead of its state: when the task was kept (Infinity: not yet), and whether it was wasted;
  // else null.
  aheadOf({ kind, message }) {
    const previews = kind === "handling" && this.byId.get(message)?.previews || [];
    if (previews[0]?.role !== "ahead") return null;
    return { until: previews.find(({ role }) => role === "kept")?.time ?? Infinity, isWasted: previews.at(-1).role === "wasted" };
  }

  // A request of a task's client, or the answer to it.
  #addChange(span, time, text) { this.rows[span.row].changes.push({ span, time, text }); }

  #addFailures({ message: messages, time, span: spans, beside }) {
    messages.forEach((message, i) => {
      const span = this.spans[spans[i]];
      const failure = { message, time: time[i], span, handled: false, turns: [] }; // handled: the newest verdict; turns: the times of its changes
      this.failures.push(failure);
      if (span && beside[i]) this.rows[span.row].raised.push(failure);
      else if (span) span.failure = failure;
      if (!this.failuresOf.has(message)) this.failuresOf.set(message, []);
      this.failuresOf.get(message).push(failure);
    });
  }

  #addVerdicts({ failure: rows, good, time }) {
    rows.forEach((row, i) => {
      this.failures[row].handled = Boolean(good[i]);
      this.failures[row].turns.push(time[i]);
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
      this.#noteTime(span, span.start, 1);
      this.spans.push(span);
      this.#addToRow(span);
    });
  }

  #endSpans({ span: spans, time, outcome }) {
    spans.forEach((number, i) => {
      const span = this.spans[number];
      Object.assign(span, { end: time[i], outcome: outcome[i] });
      this.#noteTime(span, span.end, -1);
      span.lanes?.end(span);
      if (span.outcome === "failed") this.rows[span.row].failed.push(span);
    });
  }

  // Note that a span began (change: 1) or ended (change: -1).
  #noteTime({ kind }, time, change) {
    if (kind === "connected") return;
    this.firstMessage = Math.min(this.firstMessage, time);
    this.lastChange = Math.max(this.lastChange, time);
    if (kind !== "held") this.openSpans += change; // a claim may last for ever
  }

  // Whether a bar extends to the end of the run.
  get hasOpenSpans() { return this.openSpans > 0; }

  // Add a span to its row in the chart, and to its message.
  #addToRow(span) {
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

  // --- the run at a time --------------------------------------------------------------------------------------

  // The task or message with a number.
  find(number) { return this.byId.get(number) ?? this.messageById.get(number); }

  // A task's state; undefined before it was sent.
  stateAt({ times, states }, time) {
    return time >= times.at(-1) ? states.at(-1) : states[lastNotAfter(times, time)];
  }

  // The place of the last entry at a time; -1 before the first.
  lastEntry(time) { return lastNotAfter(this.times, time); }

  // A text that changes with everything known at a time.
  versionAt(time) { return `${this.lastEntry(time)}#${this.version}`; }

  // A task's standing: its state at a time, or that it failed and the failure was handled.
  standingOf(task, time) {
    const state = this.stateAt(task, time);
    return state === "failed" && wasHandled(this.lastFailure(task.id, time), time) ? this.head.handled : state;
  }

  // The ancestors of the tasks whose failures are not handled at a time.
  ancestorsOfUnhandled(time) {
    const version = this.versionAt(time);
    if (this.unhandled?.version === version) return this.unhandled.above;
    this.unhandled = { version, above: new Set() };
    for (const task of this.failed) {
      if (this.standingOf(task, time) !== "failed") continue;
      for (let { parent } = task; parent && !this.unhandled.above.has(parent); { parent } = parent) this.unhandled.above.add(parent);
    }
    return this.unhandled.above;
  }

  // The start of a task's state at a time; undefined before the task was sent.
  stateStart(task, time) { return task.times[lastNotAfter(task.times, time)]; }

  // The number of the given tasks that had been sent; they are in the order of time.
  countSent(tasks, time) { return firstWith(tasks, (task) => task.time > time); }

  // The number of tasks of each standing at a time: [standing, count], in the order of the states.
  counts(time) {
    const { fills, handled } = this.head, counts = Object.fromEntries(Object.keys(fills).map((standing) => [standing, 0]));
    const sent = this.countSent(this.tasks, time);
    for (let i = 0; i < sent; i++) counts[this.stateAt(this.tasks[i], time)]++;
    counts[handled] = [...this.failed].filter((task) => this.standingOf(task, time) === handled).length;
    counts.failed -= counts[handled];
    return Object.entries(counts).filter(([, count]) => count);
  }

  // The end of a task; null if it has not ended by that time.
  endOf(task, time) {
    return isOver(this.stateAt(task, time)) ? this.stateStart(task, time) : null;
  }

  // The failure that was raised on a message at a time.
  failureAt(message, time) { return this.failuresOf.get(message)?.find((one) => one.time === time); }

  // The newest failure of a task at a time.
  lastFailure(task, time) { return this.failuresOf.get(task)?.findLast((one) => one.time <= time); }

  // The time at which a task's newest failure is handled, if that is later than `time`.
  handledLater(task, time) {
    const failure = this.lastFailure(task, time);
    return failure?.handled ? failure.turns.find((turn) => turn > time) : undefined;
  }

  // Whether a task ended between two times.
  hasEnded(number, from, until) {
    const task = this.byId.get(number);
    return task !== undefined && this.endOf(task, until) !== null && this.endOf(task, from) === null;
  }

  // Whether a task's state changed between two times.
  hasChanged(number, from, until) {
    const task = this.byId.get(number);
    return task !== undefined && this.stateStart(task, from) !== this.stateStart(task, until);
  }
}
