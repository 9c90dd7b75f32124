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
    const chips = states.map(({ label, parent = -1 }) => {
      const outer = states[parent]?.label;
      const chip = element("span", { class: outer ? "state inside" : "state", text: label });
      if (outer) chip.title = `inside '${outer}'`;
      return { name: label, parent: outer, chip };
    });
    this.states.set(`${component}.${name}`, chips);
    return element("div", { class: "region" }, element("span", { class: "name", text: name, title: name }),
      element("span", { class: "states" }, ...chips.map(({ chip }) => chip)));
  }

  show({ states }) {
    for (const [region, chips] of this.states) {
      const active = new Set();
      for (let name = states[region]; name; name = chips.find((state) => state.name === name)?.parent) active.add(name);
      for (const { name, chip } of chips) {
        chip.classList.toggle("active", active.has(name));
        if (active.has(name)) chip.setAttribute("aria-current", "true");
        else chip.removeAttribute("aria-current");
      }
    }
  }
}
