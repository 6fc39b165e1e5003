// What this tab works on: one picture and one condition, and who wants to know when they change.

import * as geometry from "./geometry.js";

export const state = {
  setup: null, // presets, default pull, ranges, size of the model, images
  opened: null, // number, index, size, shown, object, name
  box: null, // where the model's picture lies in this one
  fit: "fit",
  tool: "grips",
  mirrored: true,
  condition: null,
  problems: {}, // by field: what is wrong with what was typed
  unsaved: false,
};

const listeners = [];

export function onChange(listener) {
  listeners.push(listener);
}

export function changed() {
  for (const listener of listeners) listener(state);
}

export function change(values, unsaved = true) {
  Object.assign(state.condition, values);
  state.unsaved ||= unsaved;
  changed();
}

export function size() {
  return state.opened.size;
}

export function centre() {
  const [x, y] = state.opened.object?.centre ?? [0.5, 0.5];
  return [x * size()[0], y * size()[1]];
}

export function extent() {
  return (state.opened.object?.extent ?? 0.6) * size()[0];
}

export function grips() {
  return geometry.toPixels(state.condition.grips, size());
}

export function velocity() {
  return geometry.toPixels(state.condition.velocity, size());
}

// Seconds of simulated time of a clip.
export function duration() {
  const { frames, fps } = state.setup.size;
  return (frames - 1) / (fps || state.condition.fps);
}

// Move the grips, at the speed that they have, along the line through them.
export function moveGrips(two, speed = geometry.speed(velocity())) {
  change({
    grips: geometry.toFractions(two, size()),
    velocity: geometry.toFractions(geometry.parting(two, speed), size()),
  });
}

export function fresh() {
  const { offset, speed } = state.setup.pull;
  const two = geometry.mirrored(centre(), 0, offset * extent());
  const { name, ...material } = state.setup.presets[0];
  return {
    ...material,
    grips: geometry.toFractions(two, size()),
    velocity: geometry.toFractions(geometry.parting(two, speed * extent()), size()),
    fps: 100,
    caption: "",
  };
}

// Whether the grips are mirrored about the object's centre, to a few pixels.
export function isMirrored() {
  return geometry.distance(geometry.middle(grips()), centre()) < 0.005 * extent() + 0.5;
}

// After the cut-out has changed: grips that are mirrored stay so about the new centre.
export function recentre(object) {
  const before = centre();
  state.opened.object = object;
  const [dx, dy] = [centre()[0] - before[0], centre()[1] - before[1]];
  if (!state.mirrored || (dx === 0 && dy === 0)) return changed();
  const two = grips().map(([x, y]) => [x + dx, y + dy]);
  change({ grips: geometry.toFractions(two, size()) });
}

export function problem() {
  return Object.values(state.problems)[0] ?? "";
}
