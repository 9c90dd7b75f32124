// The search for tasks and other messages. A task is found if each word matches its name, number, state, module (of its handler
// or queue), failure or reason of its kill. The results are ranked by the worst match of a word, in this order; results of one
// rank are in the order in which they were sent. Other messages follow the tasks, and need a word that matches their name.
// Messages that are sent after the time shown are found by name or number only.

const SHORTEST = 3; // letters of a word that matches the start of a state; a shorter word must be the whole state
const NAME = 0, STATE = 1, MODULE = 2, FAILURE = 3, KILL = 4, NO_MATCH = 5; // the ranks of a match

export class Search {
  constructor(store, { tree, choose, setTime, changed }) {
    Object.assign(this, { store, tree, choose, setTime, changed });
    this.input = document.getElementById("search");
    this.found = [];
    this.later = []; // matches that are sent after the time shown
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
    const words = this.input.value.toLowerCase().split(" ").filter(Boolean);
    const { store } = this, sent = (all) => all.slice(0, words.length ? store.countSent(all, time) : 0);
    const asked = `${words.join(" ")}@${store.versionAt(time)}`;
    if (asked === this.asked) return;
    this.asked = asked;
    const current = this.wanted === words.join(" ") ? this.found[this.place] : undefined; // new rows do not change the current match
    this.wanted = words.join(" ");
    this.found = this.#sorted(sent(store.tasks), sent(store.messages), words);
    this.place = this.found.indexOf(current);
    this.later = words.length ? this.#allNamed([store.tasks, store.messages].flatMap((all) => all.slice(store.countSent(all, time))), words) : [];
    const later = this.later.length ? `, ${this.later.length} later` : "";
    this.tree.found = new Set(this.found);
    this.#showCount(words.length ? `${this.found.length} found${later}` : "");
    this.changed();
  }

  // Show the number of matches as `text`, or the place of the current match.
  #showCount(text) { document.getElementById("found").textContent = this.place < 0 ? text : `${this.place + 1} of ${this.found.length}`; }

  // The matches by rank.
  #sorted(tasks, messages, words) {
    const ranks = Array.from({ length: NO_MATCH }, () => []), named = Array.from({ length: NO_MATCH }, () => []);
    for (const task of tasks) ranks[Math.max(...words.map((word) => this.#rank(task, word)))]?.push(task);
    for (const message of messages) {
      const found = words.map((word) => this.#rank(message, word));
      if (found.includes(NAME)) named[Math.max(...found)]?.push(message);
    }
    return [...ranks, ...named].flat();
  }

  // The tasks and messages whose name or number matches all words, in the order of time.
  #allNamed(all, words) {
    return all.filter((one) => words.every((word) => isNamed(one, word))).sort((one, other) => one.time - other.time);
  }

  lookFor(words) {
    this.input.value = words;
    this.input.focus();
    this.update();
  }

  // Choose the next match, or with -1 the previous one. Without a match, go to the first later one.
  next(step) {
    if (!this.found.length && this.later.length) {
      this.found = [this.later[0]];
      this.setTime(this.found[0].time);
    }
    if (!this.found.length) return;
    this.place = (this.place + step + this.found.length) % this.found.length;
    this.#showCount();
    this.choose(this.found[this.place].id);
  }

  // The rank of a word's best match.
  #rank(task, word) {
    const { store, time } = this, isIn = (text) => text.toLowerCase().includes(word);
    if (isNamed(task, word)) return NAME;
    const standing = task.times && store.standingOf(task, time), isHandled = standing === store.head.handled;
    const states = [isHandled ? "handled" : standing, store.failuresOf.get(task.id)?.[0].time <= time ? "failed" : ""];
    if (states.some((state) => state === word || state && begins(state, word))) return STATE;
    if (task.queued.some((span) => span.start <= time && span.end > time && isIn(store.rows[span.row].label))) return MODULE;
    for (const module of task.modules ?? []) if (isIn(module)) return MODULE;
    const reasons = task.reasons.filter((one) => one.time <= time && one.text.includes(word));
    if (!reasons.length) return NO_MATCH;
    return reasons.every(({ isKill }) => isKill) ? KILL : FAILURE;
  }
}

function begins(state, word) { return word.length >= SHORTEST && state.slice(0, word.length) === word; }

function isNamed({ name, id }, word) { return name.toLowerCase().includes(word) || String(id) === word || `{${id}}` === word; }
