// The buttons of the application, with the numbers that they take.

import { element } from "../view/dom.js";

// `run` sends a message with its data.
export function buildControls(place, controls, run) {
  const made = [];
  let group = null;
  for (const control of controls) {
    if (control.group !== group) made.push(element("h3", { text: group = control.group }));
    made.push(form(control, run));
  }
  place.replaceChildren(...made);
}

function form({ label, message, data, fields }, run) {
  const inputs = fields.map(({ name, value, unit, least, most }) => {
    const input = element("input", { type: "number", value, step: "any", "aria-label": `${label} ${name}`, title: unit });
    if (least !== null) input.min = least;
    if (most !== null) input.max = most;
    return { name, input, unit };
  });
  const made = element("form", {}, element("button", { text: label, title: message }),
    ...inputs.flatMap(({ name, input, unit }) => [name ? element("label", { class: "faint", text: name }) : null, input, unit ? element("span", { class: "faint", text: unit }) : null]));
  made.dataset.message = message;
  made.addEventListener("submit", (event) => {
    event.preventDefault();
    run(message, filled(data, inputs));
  });
  return made;
}

// The field with the empty name is the data itself.
function filled(data, inputs) {
  const whole = { ...data, ...Object.fromEntries(inputs.map(({ name, input }) => [name, Number(input.value)])) };
  if ("" in whole) return whole[""];
  return Object.keys(whole).length ? whole : null;
}
