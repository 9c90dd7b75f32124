// The list of all runs: when each began, how long it lasted, how it stands, and how its top-level tasks ended.

import { dot, element } from "./dom.js";
import { go } from "./runs.js";
import { counted, duration } from "./words.js";

const HEADS = ["run", "began", "lasted", "", "top-level tasks, and why the first was killed"];
const AWAY = "The server does not answer. Start 'tca view' again.";

export class Outcomes {
  constructor(store) {
    this.store = store;
    this.dialog = document.getElementById("all");
    document.getElementById("outcomes").addEventListener("click", () => this.#show());
  }

  async #show() {
    const answer = await fetch("api/runs").catch(() => null);
    if (!answer?.ok) return;
    const runs = await answer.json(), rows = runs.map((run) => this.#row(run));
    const heads = element("tr", {}, ...HEADS.map((text) => element("th", { text })));
    this.dialog.querySelector("table").replaceChildren(heads, ...rows);
    this.dialog.showModal();
    for (const [place, { run }] of runs.entries()) { // one after the other: long ones take a while
      if (!this.dialog.open || !rows[place].isConnected) return;
      const told = await fetch(`api/outcome?${new URLSearchParams({ run })}`).then((one) => one.json()).catch(() => ({ error: AWAY }));
      rows[place].lastElementChild.replaceWith(...this.#cells(told));
    }
  }

  #row({ run, name, began }) {
    const isShown = run === this.store.head.run, link = element("button", { class: "link", text: name, disabled: isShown });
    link.addEventListener("click", () => go(run));
    const when = began === null ? "" : new Date(began * 1000).toLocaleString();
    return element("tr", { class: isShown ? "shown" : "" }, element("td", {}, link), element("td", { class: "began", text: when }), wide("…"));
  }

  #cells({ error, state, lasted, tasks, top, why }) {
    if (error) return [wide(error)];
    const looks = state === "live" ? "badge live" : state === "ended" ? "badge" : "badge bad";
    const parts = top.flatMap(([name, count]) => [dot(this.store.head.fills[name]), element("span", { text: `${count.toLocaleString("en")} ${name}` })]);
    const all = element("span", { class: "faint", text: tasks ? `${counted(tasks, "task")} in all` : "nothing was sent" });
    return [
      element("td", { class: "number", text: duration(lasted) }), element("td", {}, element("span", { class: looks, text: state })),
      element("td", { class: "became" }, ...parts, all, why ? element("div", { class: "reason", text: why }) : null),
    ];
  }
}

// What is said of a run instead of its outcome.
function wide(text) { return element("td", { class: "became faint", colSpan: HEADS.length - 2, text }); }
