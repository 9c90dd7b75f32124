// The page of an application: it shows what the server tells, and sends what is asked for.

import { element } from "../view/dom.js";
import { buildControls } from "./controls.js";
import { Processors } from "./processors.js";
import { Regions } from "./regions.js";
import { follow, maySteer, send } from "./server.js";

const part = (id) => document.getElementById(id);
const known = {}; // the newest parts

async function run(message, data = null) {
  tell(`${message} …`, false);
  const { text, isBad } = await send(message, data);
  tell(text, isBad);
  if (isBad && known.allocation) processors.build(known.allocation); // inputs show again what is so
}

function tell(text, isBad) {
  part("said").textContent = text;
  part("said").classList.toggle("bad", isBad);
}

const percent = (share) => `${(100 * share).toFixed(1)} %`;
const inName = (message) => `${message} ${known.application.name}`;
const regions = new Regions(part("regions"));
const processors = new Processors(part("processors"), {
  moved: (activity, processor, position) => run(inName("move activity of"), { activity, processor, position }),
  hasPeriod: (activity, period) => run(inName("set period in"), { activity, period }),
  hasPriority: (processor, priority) => run(inName("set priority in"), { processor, priority }),
});

const TAKERS = {
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
    part("figures").title = "load: measured in the last second; utilisation: by declared or longest execution times";
    part("verdict").hidden = fits === null;
    part("verdict").textContent = figures.refuted ? "refuted by measurement" : fits ? "schedulable" : "not schedulable";
    part("verdict").title = figures.refuted;
    part("verdict").className = `badge ${fits ? "good" : "bad"}`;
  },
  picture(svg) {
    part("picture").hidden = false;
    part("picture").src = `data:image/svg+xml,${encodeURIComponent(svg)}`;
  },
  lost: () => {},
};

function take(parts) {
  Object.assign(known, parts);
  for (const [name, taker] of Object.entries(TAKERS)) if (name in parts) taker(parts[name]);
  if ("application" in parts && known.states) regions.show(known.states);
  status(known.lost ?? "");
}

function status(problem) {
  const isRunning = known.allocation?.is_running ?? false, isKnown = known.application !== undefined;
  const holder = known.figures?.held_by, warning = problem || (holder ? `${holder} has been ticked for more than a second: nothing else is ticked until it ends` : "");
  part("problem").hidden = !warning;
  part("problem").textContent = warning;
  document.body.classList.toggle("lost", problem !== "");
  part("status").textContent = problem ? "lost" : !isKnown ? "reading" : isRunning ? "running" : "stopped";
  part("status").className = `badge ${problem ? "bad" : isRunning ? "live" : ""}`;
  const may = maySteer() && !problem && isKnown, can = { start: !isRunning, stop: isRunning, initialise: !isRunning };
  for (const button of document.querySelectorAll("[data-step]")) button.disabled = !(may && can[button.dataset.step]);
  for (const one of document.querySelectorAll("#policy, #controls button, .activity input, .head input")) one.disabled = !may;
  part("policy").querySelector("[value='by hand']")?.toggleAttribute("disabled", true);
}

for (const button of document.querySelectorAll("[data-step]")) button.addEventListener("click", () => run(inName(button.dataset.step)));
part("policy").addEventListener("change", () => run(inName("set policy of"), part("policy").value));
part("help").addEventListener("click", () => part("keys").showModal());
document.addEventListener("keydown", ({ key, target }) => {
  if (key === "?" && target.tagName !== "INPUT") part("keys").showModal();
});

follow(take, status);
