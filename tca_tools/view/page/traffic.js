// The traffic between modules at the time shown: the number of messages from each module to each other one, and their recent
// rate.

import { element } from "./dom.js";
import { lastNotAfter } from "./store.js";

const RECENT = 30; // seconds

export class Traffic {
  // `find` searches for words.
  constructor(store, { find }) {
    Object.assign(this, { store, find });
    this.panel = document.getElementById("traffic");
    this.drawn = ""; // unchanged links are not replaced: one may be pressed just now
  }

  show(time) {
    this.time = time;
    if (this.panel.hidden) return;
    const since = time - RECENT, seconds = Math.min(RECENT, Math.max(time - this.store.start, 1)), groups = new Map();
    for (const link of this.store.links) {
      const number = countAt(link, time), lately = lastNotAfter(link.times, time) - lastNotAfter(link.times, since);
      if (!number) continue;
      const key = JSON.stringify([link.sender, link.handler]);
      if (!groups.has(key)) groups.set(key, { sender: link.sender, handler: link.handler, rows: [] });
      groups.get(key).rows.push({ message: link.message, kind: link.kind, number, rate: link.handler ? lately / seconds : 0 });
    }
    const all = [...groups.values()].sort((one, other) => !one.handler - !other.handler), content = JSON.stringify(all);
    if (content === this.drawn) return;
    this.drawn = content;
    this.panel.replaceChildren(...this.#parts(all));
  }

  *#parts(groups) {
    if (!groups.length) return yield element("p", { class: "faint", text: "No messages have been sent yet." });
    const heads = [["message", ""], ["number", "until the time shown"], ["per s", `in the last ${RECENT} s before that time`]];
    yield element("table", {},
      element("tr", {}, ...heads.map(([text, title]) => element("th", { text, title }))),
      ...groups.flatMap((group) => [this.#head(group), ...group.rows.map((row) => this.#row(row, group))]));
  }

  #head({ sender, handler, rows }) {
    const whom = handler ? element("span", { text: handler }) : element("span", { class: "faint", text: "not handled yet" });
    return line("pair", element("td", {}, `${sender} → `, whom), rows.reduce((sum, { number }) => sum + number, 0),
      rows.reduce((sum, { rate }) => sum + rate, 0));
  }

  #row({ message, kind, number, rate }, { handler }) {
    const name = element("button", { class: "link", text: message, title: "find these messages" });
    name.addEventListener("click", () => this.find(`${message} ${handler}`));
    return line("", element("td", {}, name, element("span", { class: "faint", text: `  ${kind}` })), number, rate);
  }
}

function line(kind, name, number, rate) {
  return element("tr", { class: kind }, name, element("td", { class: "number", text: number.toLocaleString("en") }),
    element("td", { class: "number", text: rate ? perSecond(rate) : "–" }));
}

// The rate in words, as in tca stats.
function perSecond(rate) { return rate < 100 ? String(Number(rate.toPrecision(2))) : rate.toFixed(0); }

// The number of a link's messages at a time; for a link without a handler, the number that still wait.
function countAt({ times, less }, time) { return lastNotAfter(times, time) - lastNotAfter(less, time); }
