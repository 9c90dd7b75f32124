// The run, as far as the server has told it: columns that only grow, and what can be asked of them for any moment.

import { newRow } from "./rows.js";
import { ofRun } from "./runs.js";

export const NEVER = -1;

// The last place in a sorted list whose value is not beyond `value`; -1 if all are.
function lastNotAfter(list, value) {
  let low = 0, high = list.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (list[middle] <= value) low = middle + 1; else high = middle;
  }
  return low - 1;
}

// Whether the run had gone on after a failure by a time, or still might; of one that is to come, as far as is known. Each
// turn makes it the other way round.
export function wasHandled(failure, time) {
  if (!failure || time < failure.time) return Boolean(failure?.handled);
  return lastNotAfter(failure.turns, time) % 2 === 0;
}

const ARRAYS = { d: Float64Array, i: Int32Array, B: Uint8Array };

// A frame's head and its columns (see columns.py).
export function parse(buffer) {
  const bytes = new Uint8Array(buffer);
  let end = bytes.indexOf(10) + 1;
  const head = JSON.parse(new TextDecoder().decode(bytes.subarray(0, end)));
  end += (8 - end % 8) % 8;
  const columns = {};
  for (const { name, kind, offset, bytes: length } of head.columns) {
    const array = ARRAYS[kind];
    columns[name] = new array(buffer, end + offset, length / array.BYTES_PER_ELEMENT);
  }
  return { head, columns };
}

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
    this.tasks = []; // { id, parent, name, sender, role, form, time, children, times, states, holds, before }
    this.byId = new Map();
    this.top = [];
    this.messages = []; // that are no tasks: { id, name, time, modules, said, queued }, as of tasks
    this.messageById = new Map();
    this.rows = []; // of the chart: see rows.js
    this.spans = []; // { row, kind, name, message, within, lane, start, end, outcome, waits, failure, lanes, by }
    this.failed = new Set(); // the tasks that were ever in that state
    this.failures = []; // those of messages, as they were raised: { message, time, span, handled, turns }
    this.failuresOf = new Map(); // the same by message
    this.verdicts = []; // the same by their rows, with those of what came directly
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
    const buffer = await answer.arrayBuffer();
    this.heard = performance.now();
    this.add(buffer);
  }

  add(buffer) {
    const { head, columns } = parse(buffer);
    this.head = head;
    for (const text of head.texts) this.texts.push(text);
    for (const time of columns["entry.time"]) this.times.push(time);
    this.#addTasks(columns);
    this.#addMessages(columns);
    this.#addStates(columns);
    this.#addSaid(columns);
    this.#addHolds(columns);
    columns["row.label"].forEach((label, i) => this.rows.push(newRow(this.texts[label], this.texts[columns["row.module"][i]])));
    this.#addSpans(columns);
    this.#addFailures(columns);
    this.lengths = head.lengths;
    this.version += 1;
    this.end = this.last;
    this.goOn();
  }

  #addTasks(columns) {
    const ids = columns["task.id"];
    for (let i = 0; i < ids.length; i++) {
      const task = {
        id: ids[i], parent: this.byId.get(columns["task.parent"][i]) ?? null, name: this.texts[columns["task.name"][i]],
        sender: this.texts[columns["task.sender"][i]], role: this.head.roles[columns["task.role"][i]],
        form: columns["task.form"][i], time: columns["task.time"][i], children: [], times: [], states: [], holds: [], before: [],
        depth: 0, modules: null, said: [], queued: [], // said: how it failed or why it was killed; queued: its spans
        failedBelow: Infinity, // since when something under it has failed
      };
      task.depth = task.parent ? task.parent.depth + 1 : 0;
      this.first = Math.min(this.first, task.time);
      this.byId.set(task.id, task);
      this.tasks.push(task);
      (task.parent ? task.parent.children : this.top).push(task);
    }
  }

  #addMessages(columns) {
    columns["message.id"].forEach((id, i) => {
      const name = this.texts[columns["message.name"][i]], message = { id, name, time: columns["message.time"][i], modules: null, said: [], queued: [] };
      this.messages.push(message);
      this.messageById.set(id, message);
    });
  }

  #addStates(columns) {
    const ids = columns["state.task"];
    for (let i = 0; i < ids.length; i++) {
      const task = this.byId.get(ids[i]);
      task.times.push(columns["state.time"][i]);
      this.lastly = Math.max(this.lastly, columns["state.time"][i]);
      task.states.push(columns["state.state"][i]);
      if (this.head.states[columns["state.state"][i]].name !== "failed") continue;
      this.failed.add(task);
      noteFailure(task, columns["state.time"][i]);
    }
  }

  #addSaid(columns) {
    columns["said.message"].forEach((id, i) => {
      const said = { time: columns["said.time"][i], text: this.texts[columns["said.text"][i]].toLowerCase() };
      (this.byId.get(id) ?? this.messageById.get(id))?.said.push(said);
    });
  }

  #addHolds(columns) {
    const ids = columns["hold.task"];
    for (let i = 0; i < ids.length; i++) {
      const task = this.byId.get(ids[i]), before = this.byId.get(columns["hold.before"][i]);
      if (!task || !before || task === before) continue;
      task.holds.push({ before, kind: this.texts[columns["hold.kind"][i]], time: columns["hold.time"][i] });
    }
  }

  #addFailures(columns) {
    columns["failure.time"].forEach((time, i) => {
      const message = columns["failure.message"][i], span = this.spans[columns["failure.span"][i]];
      const failure = { message, time, span, handled: false, turns: [] }; // handled: the run went on after it, or still may; turns: when that changed
      this.verdicts.push(failure);
      if (span && columns["failure.beside"][i]) this.rows[span.row].raised.push(failure);
      else if (span) span.failure = failure;
      if (!message) return;
      this.failures.push(failure);
      if (!this.failuresOf.has(message)) this.failuresOf.set(message, []);
      this.failuresOf.get(message).push(failure);
    });
    columns["verdict.failure"].forEach((row, i) => {
      const failure = this.verdicts[row];
      failure.handled = Boolean(columns["verdict.good"][i]);
      failure.turns.push(columns["verdict.time"][i]);
    });
  }

  #addSpans(columns) {
    const rows = columns["span.row"];
    for (let i = 0; i < rows.length; i++) {
      const span = {
        row: rows[i], kind: this.head.kinds[columns["span.kind"][i]], name: this.texts[columns["span.name"][i]],
        message: columns["span.message"][i], within: columns["span.within"][i], lane: columns["span.lane"][i],
        start: columns["span.start"][i], end: Infinity, outcome: "", waits: [], failure: null, lanes: null, by: "",
      };
      this.#happened(span, span.start, 1);
      this.spans.push(span);
      this.#place(span);
    }
    columns["suspended.span"].forEach((span, i) => { this.spans[span].by = this.texts[columns["suspended.by"][i]]; });
    const ended = columns["end.span"];
    for (let i = 0; i < ended.length; i++) {
      const span = this.spans[ended[i]];
      span.end = columns["end.time"][i];
      this.#happened(span, span.end, -1);
      span.lanes?.end(span);
      span.outcome = this.head.outcomes[columns["end.outcome"][i]];
      if (span.outcome === "failed") this.rows[span.row].failed.push(span);
    }
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
    const message = this.byId.get(span.message) ?? this.messageById.get(span.message);
    if (message && span.kind === "handling") (message.modules ??= new Set()).add(row.label);
    if (message && span.kind === "queued") message.queued.push(span);
  }

  // --- what was so at a moment -------------------------------------------------------------------------------------

  // The number of a task's state, or NEVER.
  stateAt(task, time) {
    const { times, states } = task;
    if (time >= times[times.length - 1]) return states[states.length - 1];
    const place = times.length < 8 ? this.#scan(times, time) : lastNotAfter(times, time);
    return place < 0 ? NEVER : states[place];
  }

  // The number of the last entry that is known at a time, -1 before the first; and a text that changes with all that is.
  place(time) { return lastNotAfter(this.times, time); }
  known(time) { return `${this.place(time)}#${this.version}`; }

  // How a task stands at a time, by name and colour: its state; or, of a failure, that the run went on after it.
  looksOf(task, time) {
    const state = this.stateAt(task, time), looks = this.head.states[state === NEVER ? 0 : state];
    return looks.name === "failed" && wasHandled(this.lastFailure(task.id, time), time) ? this.head.handled : looks;
  }

  // The tasks above those that stand as failed at a time, after which the run did not go on.
  aboveBad(time) {
    const known = this.known(time);
    if (this.bad?.known === known) return this.bad.above;
    this.bad = { known, above: new Set() };
    for (const task of this.failed) {
      if (this.looksOf(task, time).name !== "failed") continue;
      for (let { parent } = task; parent && !this.bad.above.has(parent); { parent } = parent) this.bad.above.add(parent);
    }
    return this.bad.above;
  }

  // When the state that a task is in at a time began; undefined before it was sent.
  entered(task, time) { return task.times[lastNotAfter(task.times, time)]; }

  #scan(times, time) {
    let place = times.length - 1;
    while (place >= 0 && times[place] > time) place--;
    return place;
  }

  // How many of some tasks, oldest first, had been sent.
  sentBy(tasks, time) {
    if (!tasks.length || tasks[tasks.length - 1].time <= time) return tasks.length;
    let low = 0, high = tasks.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (tasks[middle].time <= time) low = middle + 1; else high = middle;
    }
    return low;
  }

  // How many tasks stand how at a time: { looks, count }, in the order of the states.
  counts(time) {
    const { states, handled } = this.head, counts = new Array(states.length).fill(0), sent = this.sentBy(this.tasks, time);
    for (let i = 0; i < sent; i++) counts[this.stateAt(this.tasks[i], time)]++;
    const found = states.map((looks, state) => ({ looks, count: counts[state] })), failed = states.findIndex(({ name }) => name === "failed");
    const good = counts[failed] ? [...this.failed].filter((task) => this.looksOf(task, time) === handled).length : 0;
    found[failed].count -= good;
    found.splice(failed + 1, 0, { looks: handled, count: good });
    return found.filter(({ count }) => count);
  }

  // When a task ended, if it has by then.
  ended(task, time) {
    const state = this.stateAt(task, time);
    return state !== NEVER && this.isOver(state) ? task.times[lastNotAfter(task.times, time)] : null;
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

  isOver(state) { return ["achieved", "failed", "killed"].includes(this.head.states[state].name); }
}
