// The buttons of the application, with inputs for their numbers.

import { element } from "../view/dom.js";

// Fill `place` with the controls; `run` sends a message with its data.
export function buildControls(place, controls, run) {
  const elements = [];
  let group = null;
  for (const control of controls) {
    if (control.group !== group) elements.push(element("h3", { text: group = control.group }));
    elements.push(buildForm(control, run));
  }
  place.replaceChildren(...elements);
}

function buildForm({ label, message, data, fields }, run) {
  const inputs = fields.map(({ name, value, unit, least, most }) => {
    const input = element("input", { type: "number", value, step: "any", "aria-label": `${label} ${name}`, title: unit });
    if (least !== null) input.min = least;
    if (most !== null) input.max = most;
    return { name, input, unit };
  });
  const form = element("form", {}, element("button", { text: label, title: message }),
    ...inputs.flatMap(({ name, input, unit }) => [name ? element("label", { class: "faint", text: name }) : null, input, unit ? element("span", { class: "faint", text: unit }) : null]));
  form.dataset.message = message;
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    run(message, messageData(data, inputs));
  });
  return form;
}

// The data of a message. A field with an empty name is the whole data.
function messageData(data, inputs) {
  const whole = { ...data, ...Object.fromEntries(inputs.map(({ name, input }) => [name, Number(input.value)])) };
  if ("" in whole) return whole[""];
  return Object.keys(whole).length ? whole : null;
}
