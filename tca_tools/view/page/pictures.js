// Pictures that modules publish, as of the time shown. A browser runs no script in an image.

import { element } from "./dom.js";
import { lastNotAfter } from "./store.js";

export class Pictures {
  constructor(store, { ask }) {
    Object.assign(this, { store, ask });
    this.panel = document.getElementById("pictures");
    this.frames = new Map(); // by name: { box, image, remark, wanted, shown, isAsking }
  }

  show(time) {
    let isEmpty = true;
    for (const [name, { times, messages }] of this.store.pictures) {
      const place = lastNotAfter(times, time), frame = this.#frame(name);
      frame.box.hidden = place < 0;
      if (place < 0) continue;
      isEmpty = false;
      frame.wanted = messages[place];
      this.#fetch(frame);
    }
    this.panel.hidden = isEmpty;
  }

  #frame(name) {
    if (!this.frames.has(name)) {
      const image = element("img", { alt: name }), remark = element("p", { class: "faint" });
      const box = element("details", { open: true }, element("summary", { text: name }), image, remark);
      const frame = { box, image, remark, wanted: null, shown: null, isAsking: false };
      box.addEventListener("toggle", () => this.#fetch(frame));
      this.frames.set(name, frame);
      this.panel.append(box);
    }
    return this.frames.get(name);
  }

  // Fetch the wanted picture, one at a time. Pictures that are no longer wanted are skipped.
  async #fetch(frame) {
    if (frame.isAsking || !frame.box.open || frame.wanted === frame.shown) return;
    frame.isAsking = true;
    const { wanted } = frame, { image, problem, error } = await this.ask(`picture/${wanted}`) ?? { error: "the server does not answer: start 'tca view' again" };
    frame.isAsking = false;
    frame.shown = wanted;
    frame.image.hidden = !image;
    if (image) frame.image.src = image;
    frame.remark.textContent = problem ?? error ?? "";
    this.#fetch(frame);
  }
}
