// Numbers beside the picture: grips, speed and material; they follow the handles, and the handles follow them.

import * as geometry from "./geometry.js";
import { byId, note } from "./page.js";
import { centre, change, changed, duration, extent, grips, isMirrored, moveGrips, size, state, velocity } from "./state.js";

const GRIPS = ["x1", "y1", "x2", "y2"];
const MATERIAL = ["E", "nu", "onset", "crit"];
const NUMBERS = [...GRIPS, "degrees", "speed", ...MATERIAL];
const STRETCHES = ["onset", "crit"];
const GAP = 0.05; // between onset and crit, where a slider pushes the other
const STEPS = 400;
const TOLERATED = 0.02; // part of the object by which grips may be off its centre without a word

export function connect() {
  GRIPS.forEach((id, k) => onNumber(id, (value) => moveOne(k, value), [-2, 3]));
  onNumber("degrees", turn, [-360, 360]);
  onNumber("speed", (value) => setSpeed(value), [0.001, 20]);
  byId("speed-slider").addEventListener("input", (event) => setSpeed(Number(event.target.value)));
  byId("mirrored").addEventListener("change", (event) => mirror(event.target.checked));
  byId("category").addEventListener("change", (event) => change({ category: event.target.value }));
  byId("caption").addEventListener("input", (event) => change({ caption: event.target.value }));
  byId("preset").addEventListener("change", (event) => choosePreset(event.target.value));
  for (const preset of state.setup.presets) byId("preset").add(new Option(preset.name, preset.name));
  MATERIAL.forEach(connectMaterial);
}

// A field that takes numbers: what cannot be used is marked and said, and changes nothing.
function onNumber(id, use, [least, most]) {
  const field = byId(id);
  field.addEventListener("input", () => {
    const value = Number(field.value.trim().replace(",", "."));
    const fine = field.value.trim() !== "" && Number.isFinite(value) && value >= least && value <= most;
    setProblem(id, fine ? "" : `${field.getAttribute("aria-label")}: give a number from ${text(least)} to ${text(most)}.`);
    if (fine) use(value);
    else changed();
  });
  field.addEventListener("change", () => {
    if (!state.problems[id]) changed(); // shows the value as it is kept
  });
}

function setProblem(id, words) {
  if (words) state.problems[id] = words;
  else delete state.problems[id];
  byId(id).setAttribute("aria-invalid", String(Boolean(words)));
}

function moveOne(k, value) {
  const which = k < 2 ? 0 : 1;
  const point = [...grips()[which]];
  point[k % 2] = value * size()[k % 2];
  moveGrips(geometry.dragged(grips(), which, point, state.mirrored ? centre() : null, false));
}

function turn(degrees) {
  const two = grips();
  const about = state.mirrored ? centre() : geometry.middle(two);
  moveGrips(geometry.mirrored(about, degrees, geometry.distance(...two) / 2));
}

function setSpeed(widths) {
  moveGrips(grips(), widths * size()[0]);
}

function mirror(on) {
  state.mirrored = on;
  if (on) turn(geometry.angle(grips()));
  else changed();
}

function choosePreset(name) {
  const preset = state.setup.presets.find((one) => one.name === name);
  if (!preset) return changed();
  MATERIAL.forEach((id) => setProblem(id, ""));
  const { name: _, ...values } = preset;
  change(values);
}

function connectMaterial(id) {
  const range = state.setup.ranges[id];
  const slider = byId(`${id}-slider`);
  const [low, high] = id === "E" ? [Math.log10(range.low), Math.log10(range.high)] : [range.low, range.high];
  Object.assign(slider, { min: low, max: high, step: (high - low) / STEPS });
  slider.addEventListener("input", () => slide(id, id === "E" ? 10 ** Number(slider.value) : Number(slider.value)));
  onNumber(id, (value) => type(id, value), [range.least, range.most]);
}

// A slider pushes the other stretch before it.
function slide(id, value) {
  const { least, most } = state.setup.ranges[id];
  const values = { [id]: rounded(Math.min(most, Math.max(least, value))) };
  setProblem(id, "");
  if (id === "onset") {
    values.onset = Math.min(values.onset, most - GAP);
    values.crit = Math.max(state.condition.crit, rounded(values.onset + GAP));
    setProblem("crit", "");
  }
  if (id === "crit") {
    values.crit = Math.max(values.crit, least + GAP);
    values.onset = Math.min(state.condition.onset, rounded(values.crit - GAP));
    setProblem("onset", "");
  }
  change(values);
}

// What is typed must keep crit above onset; the other field is not touched.
function type(id, value) {
  const values = { ...state.condition, [id]: value };
  if (STRETCHES.includes(id)) {
    const wrong = values.crit <= values.onset;
    const words = `crit must be greater than onset: raise crit above ${text(values.onset)} or lower onset.`;
    STRETCHES.forEach((name) => setProblem(name, ""));
    if (wrong) setProblem(id, words);
  }
  change({ [id]: value });
}

function rounded(value) {
  return Number(value.toPrecision(3));
}

function text(value) {
  const plain = Math.abs(value) < 1e5 || !Number.isFinite(value);
  return plain ? String(Number(value.toPrecision(9))) : value.toExponential().replace("e+", "e");
}

export function draw() {
  drawGrips();
  const c = state.condition;
  for (const id of MATERIAL) {
    byId(`${id}-slider`).value = id === "E" ? Math.log10(c.E) : c[id];
    set(id, text(c[id]));
  }
  byId("category").value = c.category;
  if (document.activeElement !== byId("caption")) byId("caption").value = c.caption;
  const found = state.setup.presets.find((one) => ["category", ...MATERIAL].every((name) => one[name] === c[name]));
  byId("preset").value = found?.name ?? "";
}

function drawGrips() {
  const c = state.condition;
  const two = grips();
  GRIPS.forEach((id, k) => set(id, c.grips[k].toFixed(3)));
  set("degrees", String(Number(geometry.angle(two).toFixed(1))));
  const pixels = geometry.speed(velocity());
  set("speed", (pixels / size()[0]).toFixed(3));
  byId("speed-slider").value = pixels / size()[0];
  byId("mirrored").checked = state.mirrored;
  const metres = state.opened.object ? (pixels / extent()) * state.opened.object.metres : 0;
  const way = `Each grip moves ${((100 * pixels * duration()) / size()[0]).toFixed(0)} % of the width in ${duration().toFixed(2)} s`;
  const speed = metres ? `, as ${metres.toFixed(2)} m/s in the simulation.` : ".";
  const off = geometry.distance(geometry.middle(two), centre()) > TOLERATED * extent();
  const aside = off ? " The simulation pulls mirrored about the object's centre; only the generator pulls here." : "";
  note(byId("grips-note"), way + speed + aside, off ? "warn" : "");
}

// Show a value, but not over what is being typed.
function set(id, value) {
  const field = byId(id);
  if (document.activeElement === field && state.problems[id]) return;
  if (document.activeElement === field && Number(field.value) === Number(value)) return;
  if (document.activeElement === field && field.dataset.typing) return;
  field.value = value;
}

// While a field has the focus and was typed in, it keeps what was typed.
export function watchTyping() {
  for (const id of NUMBERS) {
    const field = byId(id);
    field.addEventListener("input", () => (field.dataset.typing = "yes"), { capture: true });
    for (const end of ["change", "blur"]) {
      field.addEventListener(end, () => {
        delete field.dataset.typing;
        if (state.condition) draw();
      });
    }
  }
}

export function imported() {
  for (const id of NUMBERS) {
    setProblem(id, "");
    delete byId(id).dataset.typing;
  }
  state.mirrored = isMirrored();
}
