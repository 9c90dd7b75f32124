// The list of all runs: the start, duration and state of each, and the outcomes of its top-level tasks.

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
    for (const [place, { run }] of runs.entries()) { // one after another, since a long run takes seconds
      if (!this.dialog.open || !rows[place].isConnected) return;
      const outcome = await fetch(`api/outcome?${new URLSearchParams({ run })}`).then((one) => one.json()).catch(() => ({ error: AWAY }));
      rows[place].lastElementChild.replaceWith(...this.#cells(outcome));
    }
  }

  #row({ run, name, began }) {
    const isShown = run === this.store.head.run, link = element("button", { class: "link", text: name, disabled: isShown });
    link.addEventListener("click", () => go(run));
    const when = began === null ? "" : new Date(began * 1000).toLocaleString();
    return element("tr", { class: isShown ? "shown" : "" }, element("td", {}, link), element("td", { class: "began", text: when }), wideCell("…"));
  }

  #cells({ error, state, lasted, tasks, top, why }) {
    if (error) return [wideCell(error)];
    const badge = state === "live" ? "badge live" : state === "ended" ? "badge" : "badge bad";
    const parts = top.flatMap(([standing, count]) => [dot(this.store.head.fills[standing]), element("span", { text: `${count.toLocaleString("en")} ${standing}` })]);
    const all = element("span", { class: "faint", text: tasks ? `${counted(tasks, "task")} in all` : "no tasks" });
    return [
      element("td", { class: "number", text: duration(lasted) }), element("td", {}, element("span", { class: badge, text: state })),
      element("td", { class: "became" }, ...parts, all, why ? element("div", { class: "reason", text: why }) : null),
    ];
  }
}

// A cell with a text instead of the outcome.
function wideCell(text) { return element("td", { class: "became faint", colSpan: HEADS.length - 2, text }); }
