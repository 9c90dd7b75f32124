// The page of an application: it shows the values that the server sends, and sends the user's commands.

import { element } from "../view/dom.js";
import { buildControls } from "./controls.js";
import { Processors } from "./processors.js";
import { Regions } from "./regions.js";
import { follow, hasKey, send } from "./server.js";

const part = (id) => document.getElementById(id);
const known = {}; // the newest value of each part

async function run(message, data = null) {
  showOutcome(`${message} …`, false);
  const { text, isBad } = await send(message, data);
  showOutcome(text, isBad);
  if (isBad && known.allocation) processors.build(known.allocation); // reset the inputs to the present values
}

function showOutcome(text, isBad) {
  part("said").textContent = text;
  part("said").classList.toggle("bad", isBad);
}

const percent = (share) => `${(100 * share).toFixed(1)} %`;
const messageName = (message) => `${message} ${known.application.name}`;
const regions = new Regions(part("regions"));
const processors = new Processors(part("processors"), {
  move: (activity, processor, position) => run(messageName("move activity of"), { activity, processor, position }),
  setPeriod: (activity, period) => run(messageName("set period in"), { activity, period }),
  setPriority: (processor, priority) => run(messageName("set priority in"), { processor, priority }),
});

const UPDATES = {
  application(application) {
    document.title = part("name").textContent = application.name;
    part("policy").replaceChildren(...[...application.policies, "by hand"].map((text) => element("option", { text: text.replaceAll("_", " "), value: text })));
    regions.build(application);
    buildControls(part("controls"), application.controls, run);
  },
  allocation(allocation) {
    part("policy").value = allocation.policy.replaceAll("-", "_");
    processors.build(allocation);
  },
  states: (states) => regions.show(states),
  figures(figures) {
    processors.show(figures);
    const { load, is_schedulable: fits, utilisation } = figures;
    part("figures").textContent = `load ${percent(load)}${utilisation === null ? "" : `, utilisation at most ${percent(utilisation)}`}`;
    part("figures").title = "load: measured in the last second; utilisation: from declared, else from longest execution times";
    part("verdict").hidden = fits === null;
    part("verdict").textContent = figures.refuted ? "refuted by measurement" : fits ? "schedulable" : "not schedulable";
    part("verdict").title = figures.refuted;
    part("verdict").className = `badge ${fits ? "good" : "bad"}`;
  },
  picture(svg) {
    part("picture").hidden = false;
    part("picture").src = `data:image/svg+xml,${encodeURIComponent(svg)}`;
  },
};

function update(parts) {
  Object.assign(known, parts);
  for (const [name, updatePart] of Object.entries(UPDATES)) if (name in parts) updatePart(parts[name]);
  if ("application" in parts && known.states) regions.show(known.states);
  showStatus(known.lost ?? "");
}

function showStatus(problem) {
  const isRunning = known.allocation?.is_running ?? false, isKnown = known.application !== undefined;
  const holder = known.figures?.held_by, warning = problem || (holder ? `the tick of ${holder} has run for more than a second: nothing else is ticked until it ends` : "");
  part("problem").hidden = !warning;
  part("problem").textContent = warning;
  document.body.classList.toggle("lost", problem !== "");
  part("status").textContent = problem ? "lost" : !isKnown ? "reading" : isRunning ? "running" : "stopped";
  part("status").className = `badge ${problem ? "bad" : isRunning ? "live" : ""}`;
  const canSend = hasKey() && !problem && isKnown, isPossible = { start: !isRunning, stop: isRunning, initialise: !isRunning };
  for (const button of document.querySelectorAll("[data-step]")) button.disabled = !(canSend && isPossible[button.dataset.step]);
  for (const control of document.querySelectorAll("#policy, #controls button, .activity input, .head input")) control.disabled = !canSend;
  part("policy").querySelector("[value='by hand']")?.toggleAttribute("disabled", true);
}

for (const button of document.querySelectorAll("[data-step]")) button.addEventListener("click", () => run(messageName(button.dataset.step)));
part("policy").addEventListener("change", () => run(messageName("set policy of"), part("policy").value));
part("help").addEventListener("click", () => part("keys").showModal());
document.addEventListener("keydown", ({ key, target }) => {
  if (key === "?" && target.tagName !== "INPUT") part("keys").showModal();
});

follow(update, showStatus);
