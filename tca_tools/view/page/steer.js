// Steer a task of a live run: cancel, kill, suspend, resume or retry it, after a confirmation.

import { element } from "./dom.js";
import { ofRun } from "./runs.js";
import { isOver } from "./store.js";
import { counted, numbered } from "./words.js";

const KEY = "key"; // part of the address that the command printed: without it the page is read-only
const CHANGES = {
  cancel: "Its handler is asked to end it, and may refuse. If the handler does not accept cancels, the task is killed.",
  kill: "It ends with everything under it. Running handlers are notified, not interrupted.",
  suspend: "Nothing of it or under it is started until it is resumed. Running handlers are notified.",
  resume: "It continues with everything under it.",
  retry: "Everything under it is killed, and it is handled again from the start.",
};

// Remove the key from the address, which the user may send to others.
function takeKey() {
  const address = new URL(location.href), given = address.searchParams.get(KEY);
  if (given === null) return;
  sessionStorage.setItem(KEY, given);
  address.searchParams.delete(KEY);
  history.replaceState(null, "", address);
}

takeKey();

export class Steering {
  constructor(store, { toEnd }) {
    Object.assign(this, { store, toEnd });
    this.panel = document.getElementById("steering");
    this.shown = ""; // unchanged buttons are not replaced: one may be pressed just now
    this.result = null; // of the last request: { id, text, isBad }
    this.dialog = document.getElementById("steer");
    document.getElementById("steer-not").addEventListener("click", () => this.dialog.close(""));
    this.dialog.addEventListener("close", () => {
      const { returnValue } = this.dialog, why = this.dialog.querySelector("input").value.trim();
      if (returnValue) this.#do(returnValue, this.id, why);
    });
  }

  // Show the buttons for a living task, if the page may steer and shows the present. `about`: the server's answer about it.
  show(about, isPresent) {
    this.about = [about, isPresent];
    const { store } = this, task = store.byId.get(about.id), state = task && store.stateAt(task, store.end);
    const isAlive = task && !isOver(state) && store.isLive && sessionStorage.getItem(KEY) !== null;
    const actions = !isAlive || !isPresent || state === "ending" ? [] : ["cancel", "kill", about.isSuspended ? "resume" : "suspend", "retry"];
    const result = this.result?.id === about.id ? this.result : null, shown = JSON.stringify([about.id, isAlive, actions, result]);
    if (shown === this.shown) return;
    this.shown = shown;
    this.panel.replaceChildren(...actions.map((what) => this.#button(what, task)), ...isAlive && !isPresent ? this.#linkToEnd() : [],
      ...result ? [element("span", { class: result.isBad ? "bad" : "", role: "status", text: result.text })] : []);
  }

  #linkToEnd() {
    const made = element("button", { class: "link", text: "go to the end" });
    made.addEventListener("click", this.toEnd);
    return [made, element("span", { class: "faint", text: "to cancel, kill, suspend or retry it" })];
  }

  #button(what, task) {
    const made = element("button", { text: what, class: what });
    made.dataset.steer = what;
    made.addEventListener("click", () => this.#ask(what, task));
    return made;
  }

  #ask(what, task) {
    const { dialog, store } = this, below = living(task, store);
    this.id = task.id;
    dialog.querySelector("h2").textContent = `${what} ${numbered(task.name, task.id)}?`;
    dialog.querySelector("p").textContent = below ? `${CHANGES[what]} Under it: ${counted(below, "living task")}.` : CHANGES[what];
    dialog.querySelector("label").hidden = !["cancel", "kill"].includes(what);
    dialog.querySelector("input").value = "";
    const yes = dialog.querySelector("button[type=submit]");
    Object.assign(yes, { value: what, textContent: what, className: what });
    dialog.returnValue = "";
    dialog.showModal();
  }

  async #do(what, task, why) {
    const asked = JSON.stringify({ ...ofRun(this.store.head), task, what, why });
    this.result = { id: task, ...await sent(asked) };
    this.show(...this.about);
  }
}

async function sent(body) {
  try {
    const answer = await fetch("api/steer", { method: "POST", body, headers: { "X-TCA-Key": sessionStorage.getItem(KEY) } });
    if (answer.status > 400) sessionStorage.removeItem(KEY); // another viewer serves this address now
    const { said, error } = await answer.json();
    return { text: said ?? error, isBad: said === undefined };
  } catch (error) {
    return { text: `the server does not answer (${error.message})`, isBad: true };
  }
}

// The number of living descendants of a task.
function living({ children }, store) {
  let count = 0;
  for (const left = [...children]; left.length;) {
    const task = left.pop();
    if (!isOver(store.stateAt(task, store.end))) count++;
    left.push(...task.children);
  }
  return count;
}
