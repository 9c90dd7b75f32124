// State machines of tasks: the picture of each is fetched once; the states that are active or foreseen at the moment shown stand out.

import { element } from "./dom.js";

export class Machines {
  constructor(store, ask) {
    Object.assign(this, { store, ask });
    this.pictures = new Map();
  }

  // The picture of a task that is a machine. It stays the same element, so that it neither flickers nor loses its place.
  shown(id, machine) {
    const key = `${this.store.head.token} ${id}`; // of this run, as it is read now
    let frame = this.pictures.get(key);
    if (!frame) {
      frame = element("div", { class: "machine", title: "click: all of it, or its own size" });
      frame.addEventListener("click", () => frame.classList.toggle("whole"));
      this.pictures.set(key, frame);
      this.#fetch(id, key, frame);
    }
    frame.told = machine;
    frame.classList.toggle("previews", "foreseen" in machine);
    const { scrollTop, isConnected } = frame;
    queueMicrotask(() => {
      frame.scrollTop = scrollTop; // which is lost when it is put into the pane anew
      mark(frame, !isConnected);
    });
    return frame;
  }

  async #fetch(id, key, frame) {
    const { svg, problem, error } = await this.ask(`machine/${id}`) ?? {};
    if (svg) {
      const picture = new DOMParser().parseFromString(svg, "image/svg+xml").documentElement;
      picture.querySelectorAll("title").forEach((title) => title.remove()); // Graphviz' own names
      frame.replaceChildren(document.importNode(picture, true));
      mark(frame, true);
    } else {
      frame.replaceChildren(element("p", { class: "faint", text: problem ?? error ?? "the picture could not be fetched: choose the task again" }));
      if (!problem) this.pictures.delete(key);
    }
  }
}

function mark(frame, isNew) {
  const { active, foreseen = [], likely = {} } = frame.told;
  isNew = put(frame, "active", active) || isNew;
  put(frame, "foreseen", foreseen);
  for (const arrow of frame.querySelectorAll("[id^=arrow-]")) tell(arrow, likely[arrow.id.slice("arrow-".length)]);
  if (isNew) show(frame, frame.querySelector(".node.active"));
}

// Give these states a class, and no others; whether one of them is new.
function put(frame, name, numbers) {
  const ids = new Set(numbers.map((number) => `state-${number}`));
  let isNew = false;
  for (const state of frame.querySelectorAll("[id^=state-]")) {
    isNew ||= ids.has(state.id) && !state.classList.contains(name);
    state.classList.toggle(name, ids.has(state.id));
  }
  return isNew;
}

// The likelihood of an arrow, below its event.
function tell(arrow, likelihood) {
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

// Scroll only the frame, and only if the state is out of sight.
function show(frame, state) {
  if (!state) return;
  const inner = state.getBoundingClientRect(), outer = frame.getBoundingClientRect();
  if (inner.top < outer.top || inner.bottom > outer.bottom) frame.scrollTop += inner.top - outer.top - (outer.height - inner.height) / 2;
}
