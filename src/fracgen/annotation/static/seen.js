// What the network sees of the condition: numbers, loading and picture, all made by the server.

import * as api from "./api.js";
import { byId, later, note } from "./page.js";
import { problem, state } from "./state.js";

let shown = 0; // the newest request

export const refresh = later(show, 150);

async function show() {
  if (!state.condition) return;
  if (problem()) return showProblem(problem());
  const query = { condition: JSON.stringify(state.condition) };
  const once = matchMedia("(prefers-reduced-motion: reduce)").matches;
  byId("force").src = api.url("force.png", { ...query, fit: state.fit, once });
  byId("force").hidden = false;
  const mine = (shown += 1);
  const found = await api.get("numbers", query).catch((error) => ({ error: error.message }));
  if (mine !== shown) return;
  if (found.error) showProblem(found.error);
  else showNumbers(found);
}

// Nothing is seen of what is wrong.
function showProblem(words) {
  shown += 1;
  for (const name of Object.keys(state.setup.ranges)) {
    byId(`seen-${name}`).textContent = "–";
    byId(`seen-${name}`).classList.remove("outside");
  }
  note(byId("material-note"), words, "bad");
}

function showNumbers({ numbers, outside }) {
  for (const name of Object.keys(state.setup.ranges)) {
    const cell = byId(`seen-${name}`);
    cell.textContent = numbers[name].toFixed(3).replace("-", "\u2212") + (outside.includes(name) ? " !" : "");
    cell.classList.toggle("outside", outside.includes(name));
  }
  byId("seen-category").textContent = `${sign(numbers.low)}, ${sign(numbers.high)}`;
  const words = outside.map((name) => `${name} is outside ${state.setup.ranges[name].limits}`);
  note(byId("material-note"), words.length ? `${words.join("; ")}: the network sees it clamped.` : "", "warn");
}

function sign(value) {
  return value > 0 ? "+1" : "\u22121";
}

export function showReference() {
  const { width, height } = state.setup.size;
  byId("model").textContent = `Dashed: the generator's picture, ${width} × ${height}.`;
  byId("force-box").style.aspectRatio = `${width} / ${height}`;
  byId("reference").src = api.url("reference.jpg", { fit: state.fit, number: state.opened.number });
  byId("reference").hidden = false;
}
