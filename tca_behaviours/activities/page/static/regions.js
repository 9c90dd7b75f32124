// The regions of all components, with their active states.

import { element } from "../view/dom.js";

export class Regions {
  constructor(place) {
    this.place = place;
    this.states = new Map(); // the elements of the states, by region
  }

  build({ components }) {
    this.states.clear();
    this.place.replaceChildren(...components.filter(({ regions }) => regions.length).map((one) => this.#component(one)));
  }

  #component({ name, regions }) {
    return element("div", { class: "component" }, element("h2", { text: name }), ...regions.map((region) => this.#region(name, region)));
  }

  #region(component, { name, states }) {
    const made = states.map(({ label, parent = -1 }) => {
      const outer = states[parent]?.label;
      const shown = element("span", { class: outer ? "state inside" : "state", text: label });
      if (outer) shown.title = `inside '${outer}'`;
      return { name: label, parent: outer, shown };
    });
    this.states.set(`${component}.${name}`, made);
    return element("div", { class: "region" }, element("span", { class: "name", text: name, title: name }),
      element("span", { class: "states" }, ...made.map(({ shown }) => shown)));
  }

  show({ states }) {
    for (const [region, made] of this.states) {
      const active = new Set();
      for (let name = states[region]; name; name = made.find((state) => state.name === name)?.parent) active.add(name);
      for (const { name, shown } of made) {
        shown.classList.toggle("active", active.has(name));
        if (active.has(name)) shown.setAttribute("aria-current", "true");
        else shown.removeAttribute("aria-current");
      }
    }
  }
}
