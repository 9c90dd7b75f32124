// The facts of the journal around the cursor, one line each.

import { element, soon } from "./dom.js";
import { wasHandled } from "./store.js";
import { seconds } from "./words.js";

const BEFORE = 60, AFTER = 40; // entries
const LONGEST = 600; // characters of a line

export class Messages {
  constructor(store, { choose, setTime, ask }) {
    Object.assign(this, { store, choose, setTime, ask });
    this.panel = document.getElementById("messages");
    this.widest = 0; // characters of the longest time so far: the columns do not move
    this.fetch = soon(() => this.#fetch(), 80);
  }

  show(time) {
    this.time = time;
    if (!this.panel.hidden) this.fetch();
  }

  async #fetch() {
    const place = this.store.lastEntry(this.time);
    if (place < 0) return;
    const lines = await this.ask("messages", { place, before: BEFORE, after: AFTER });
    if (!lines || this.panel.hidden || place !== this.store.lastEntry(this.time)) return;
    this.widest = lines.reduce((wide, { time }) => Math.max(wide, seconds(time).length), this.widest);
    const made = lines.map((line) => this.#line(line, place));
    this.panel.replaceChildren(...made);
    const now = made.findLast((line) => line.classList.contains("now"));
    if (now) this.panel.scrollTop = now.offsetTop - this.panel.clientHeight / 2;
  }

  // The class of a line: bad (red), or handled (amber) for a failure that was handled at the time shown.
  #badness({ kind, id, time, isBad }) {
    if (!isBad) return "";
    return kind === "failed" && wasHandled(this.store.failureAt(id, time), this.time) ? "handled" : "bad";
  }

  #line(line, place) {
    const classes = ["line", line.place === place ? "now" : "", line.place > place ? "later" : "", this.#badness(line)];
    const text = (line.text + (line.data ? `  ${line.data}` : "")).slice(0, LONGEST);
    const made = element("div", { class: classes.filter(Boolean).join(" "), title: text },
      element("span", { class: "faint time", text: seconds(line.time).padStart(this.widest) }),
      element("span", { class: "kind", text: line.kind }), element("span", { text }));
    made.addEventListener("click", () => {
      this.setTime(line.time);
      if (line.id) this.choose(line.id);
    });
    return made;
  }
}
