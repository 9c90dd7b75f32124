// Finding tasks: by name, number or state, by the module that handled them or for which they are queued, and by how they
// failed. Several words must all fit, each somewhere. Tasks of that name come first, then those in that state, of that
// module, what failed so, and what was killed for such a reason; each in the order in which they were sent. Other messages are found in the same way, if one
// of the words is of their name: they come behind the tasks. What is sent only later is found by its name alone.

const SHORTEST = 3; // letters: of fewer a state must be all
const KILLED = 4, NOWHERE = 5;

export class Search {
  constructor(store, { tree, choose, setTime, changed }) {
    Object.assign(this, { store, tree, choose, setTime, changed });
    this.input = document.getElementById("search");
    this.found = [];
    this.later = []; // what is sent after the moment that is shown
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
    const { store } = this, sent = (all) => all.slice(0, words.length ? store.sentBy(all, time) : 0);
    const asked = `${words.join(" ")}@${store.known(time)}`;
    if (asked === this.asked) return;
    this.asked = asked;
    const stood = this.wanted === words.join(" ") ? this.found[this.place] : undefined; // news do not lead back to the first
    this.wanted = words.join(" ");
    this.found = this.#sorted(sent(store.tasks), sent(store.messages), words);
    this.place = this.found.indexOf(stood);
    this.later = words.length ? this.#named([store.tasks, store.messages].flatMap((all) => all.slice(store.sentBy(all, time))), words) : [];
    const later = this.later.length ? `, ${this.later.length} later` : "";
    this.tree.found = new Set(this.found);
    this.#tell(words.length ? `${this.found.length} found${later}` : "");
    this.changed();
  }

  #tell(how) { document.getElementById("found").textContent = this.place < 0 ? how : `${this.place + 1} of ${this.found.length}`; }

  // What is found stands where the word stands that fits it last.
  #sorted(tasks, messages, words) {
    const ranks = Array.from({ length: NOWHERE }, () => []), named = Array.from({ length: NOWHERE }, () => []);
    for (const task of tasks) ranks[Math.max(...words.map((word) => this.#place(task, word)))]?.push(task);
    for (const message of messages) {
      const places = words.map((word) => this.#place(message, word));
      if (places.includes(0)) named[Math.max(...places)]?.push(message);
    }
    return [...ranks, ...named].flat();
  }

  // Those that all words name, the first one first.
  #named(all, words) {
    return all.filter((one) => words.every((word) => isNamed(one, word))).sort((one, other) => one.time - other.time);
  }

  look(words) {
    this.input.value = words;
    this.input.focus();
    this.update();
  }

  // To another one; where there is none, to the first one that is sent later, when it is.
  next(step) {
    if (!this.found.length && this.later.length) {
      this.found = [this.later[0]];
      this.setTime(this.found[0].time);
    }
    if (!this.found.length) return;
    this.place = (this.place + step + this.found.length) % this.found.length;
    this.#tell();
    this.choose(this.found[this.place].id);
  }

  // Where a word fits: 0 the name or number, 1 the state, 2 the module, 3 the failure, 4 why it was killed.
  #place(task, word) {
    const { store, time } = this, isIn = (text) => text.toLowerCase().includes(word);
    if (isNamed(task, word)) return 0;
    const looks = task.times && store.looksOf(task, time), isHandled = looks === store.head.handled;
    const states = [isHandled ? "handled" : looks, store.failuresOf.get(task.id)?.[0].time <= time ? "failed" : ""];
    if (states.some((state) => state === word || state && begins(state, word))) return 1;
    if (task.queued.some((span) => span.start <= time && span.end > time && isIn(store.rows[span.row].label))) return 2;
    for (const module of task.modules ?? []) if (isIn(module)) return 2;
    const said = task.said.filter((one) => one.time <= time && one.text.includes(word));
    if (!said.length) return NOWHERE;
    return said.every(({ isKill }) => isKill) ? KILLED : 3;
  }
}

function begins(state, word) { return word.length >= SHORTEST && state.slice(0, word.length) === word; }

function isNamed({ name, id }, word) { return name.toLowerCase().includes(word) || String(id) === word || `{${id}}` === word; }
