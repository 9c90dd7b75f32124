// State machines of tasks. A picture is fetched once. The states that are active or foreseen at the time shown are marked.

import { element } from "./dom.js";

export class Machines {
  constructor(store, ask) {
    Object.assign(this, { store, ask });
    this.pictures = new Map();
  }

  // The picture of a task's machine: always the same element, so that it does not flicker, and keeps its scrolled place.
  pictureOf(id, machine) {
    const key = `${this.store.head.token} ${id}`; // the token identifies the run, as it is read now
    let frame = this.pictures.get(key);
    if (!frame) {
      frame = element("div", { class: "machine", title: "click to fit the picture, or to show it in full size" });
      frame.addEventListener("click", () => frame.classList.toggle("whole"));
      this.pictures.set(key, frame);
      this.#fetch(id, key, frame);
    }
    frame.machine = machine;
    frame.classList.toggle("previews", "foreseen" in machine);
    const { scrollTop, isConnected } = frame;
    queueMicrotask(() => {
      frame.scrollTop = scrollTop; // lost when the frame is put into the pane again
      mark(frame, !isConnected);
    });
    return frame;
  }

  async #fetch(id, key, frame) {
    const { svg, problem, error } = await this.ask(`machine/${id}`) ?? {};
    if (svg) {
      const picture = new DOMParser().parseFromString(svg, "image/svg+xml").documentElement;
      picture.querySelectorAll("title").forEach((title) => title.remove()); // Graphviz' names of nodes, which a browser shows
      frame.replaceChildren(document.importNode(picture, true));
      mark(frame, true);
    } else {
      frame.replaceChildren(element("p", { class: "faint", text: problem ?? error ?? "the picture could not be fetched: choose the task again" }));
      if (!problem) this.pictures.delete(key);
    }
  }
}

function mark(frame, isNew) {
  const { active, foreseen = [], likely = {} } = frame.machine;
  isNew = setClass(frame, "active", active) || isNew;
  setClass(frame, "foreseen", foreseen);
  for (const arrow of frame.querySelectorAll("[id^=arrow-]")) showLikelihood(arrow, likely[arrow.id.slice("arrow-".length)]);
  if (isNew) scrollTo(frame, frame.querySelector(".node.active"));
}

// Set a class on the states with these numbers only. Returns whether one of them did not have it.
function setClass(frame, name, numbers) {
  const ids = new Set(numbers.map((number) => `state-${number}`));
  let isNew = false;
  for (const state of frame.querySelectorAll("[id^=state-]")) {
    isNew ||= ids.has(state.id) && !state.classList.contains(name);
    state.classList.toggle(name, ids.has(state.id));
  }
  return isNew;
}

// Show the likelihood of an arrow, below its event.
function showLikelihood(arrow, likelihood) {
  arrow.classList.toggle("likely", Boolean(likelihood));
  arrow.querySelector(".likelihood")?.remove();
  if (!likelihood) return;
  const words = document.createElementNS("http://www.w3.org/2000/svg", "tspan");
  words.classList.add("likelihood");
  words.textContent = likelihood;
  const event = arrow.querySelector("text");
  words.setAttribute("x", event.getAttribute("x"));
  words.setAttribute("dx", "0.5em"); // beside the arrow
  words.setAttribute("dy", "1.1em");
  event.append(words);
}

// Scroll the frame to a state, if it is out of sight.
function scrollTo(frame, state) {
  if (!state) return;
  const inner = state.getBoundingClientRect(), outer = frame.getBoundingClientRect();
  if (inner.top < outer.top || inner.bottom > outer.bottom) frame.scrollTop += inner.top - outer.top - (outer.height - inner.height) / 2;
}
