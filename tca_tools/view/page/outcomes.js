// The list of all runs: when each began, how long it lasted, how it stands, and how its top-level tasks ended.

import { dot, element } from "./dom.js";
import { go } from "./runs.js";
import { counted, duration } from "./words.js";

const HEADS = ["run", "began", "lasted", "", "top-level tasks", "why the first was killed"];

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
      const told = await fetch(`api/outcome?${new URLSearchParams({ run })}`).then((one) => one.json()).catch(() => null);
      if (told) this.#fill(rows[place], told);
    }
  }

  #row({ run, name, began }) {
    const isShown = run === this.store.head.run, link = element("button", { class: "link", text: name, disabled: isShown });
    link.addEventListener("click", () => go(run));
    const when = began === null ? "" : new Date(began * 1000).toLocaleString();
    return element("tr", { class: isShown ? "shown" : "" }, element("td", {}, link), element("td", { text: when }), element("td", { class: "number", text: "…" }),
      element("td"), element("td"), element("td", { class: "why" }));
  }

  #fill({ children: [, , lasted, state, top, why] }, told) {
    lasted.textContent = told.error ? "" : duration(told.lasted);
    if (told.error) return top.replaceChildren(element("span", { class: "faint", text: told.error }));
    const looks = told.state === "live" ? "badge live" : told.state === "ended" ? "badge" : "badge bad";
    state.replaceChildren(element("span", { class: looks, text: told.state }));
    const parts = told.top.flatMap(([name, count]) => [dot(this.store.head.fills[name]), element("span", { text: `${count.toLocaleString("en")} ${name}` })]);
    top.replaceChildren(...parts, element("span", { class: "faint", text: told.tasks ? `${counted(told.tasks, "task")} in all` : "nothing was sent" }));
    Object.assign(why, { textContent: told.why, title: told.why });
  }
}
