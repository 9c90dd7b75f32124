// State machines of tasks: the picture of each is fetched once; the states that are active at the moment shown stand out.

import { element } from "./dom.js";

export class Machines {
  constructor(store, ask) {
    Object.assign(this, { store, ask });
    this.pictures = new Map();
  }

  // The picture of a task that is a machine. It stays the same element, so that it neither flickers nor loses its place.
  shown(id, active) {
    const key = `${this.store.head.token} ${id}`; // of this run, as it is read now
    let frame = this.pictures.get(key);
    if (!frame) {
      frame = element("div", { class: "machine", title: "click: all of it, or its own size" });
      frame.addEventListener("click", () => frame.classList.toggle("whole"));
      this.pictures.set(key, frame);
      this.#fetch(id, key, frame);
    }
    frame.dataset.active = active.join(" ");
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
  const active = new Set(frame.dataset.active.split(" ").map((number) => `state-${number}`));
  for (const state of frame.querySelectorAll("[id^=state-]")) {
    const is = active.has(state.id);
    isNew ||= is && !state.classList.contains("active");
    state.classList.toggle("active", is);
  }
  if (isNew) show(frame, frame.querySelector(".node.active"));
}

// Scroll only the frame, and only if the state is out of sight.
function show(frame, state) {
  if (!state) return;
  const inner = state.getBoundingClientRect(), outer = frame.getBoundingClientRect();
  if (inner.top < outer.top || inner.bottom > outer.bottom) frame.scrollTop += inner.top - outer.top - (outer.height - inner.height) / 2;
}
