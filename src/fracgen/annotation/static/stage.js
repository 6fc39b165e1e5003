// The picture with its grips: where everything lies, and how grips are dragged and nudged.

import * as geometry from "./geometry.js";
import { byId } from "./page.js";
import { centre, changed, duration, grips, moveGrips, size, state, velocity } from "./state.js";

const NUDGE = 0.0025; // of the picture's width
const FAR = 5;
const RIM = 6; // of the stage, which arrows leave free [px]
const KEYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

export function connect() {
  [byId("grip1"), byId("grip2")].forEach((handle, which) => {
    handle.addEventListener("pointerdown", (event) => grab(event, handle, which));
    handle.addEventListener("keydown", (event) => nudge(event, which));
  });
  new ResizeObserver(() => state.opened && draw()).observe(byId("stage"));
}

function grab(event, handle, which) {
  if (event.button !== 0) return;
  handle.setPointerCapture(event.pointerId);
  handle.focus();
  const move = (moved) => {
    const about = state.mirrored ? centre() : null;
    moveGrips(geometry.dragged(grips(), which, pointOf(moved), about, !(moved.altKey || moved.ctrlKey)));
  };
  const stop = () => {
    handle.removeEventListener("pointermove", move);
    changed();
  };
  handle.addEventListener("pointermove", move);
  handle.addEventListener("lostpointercapture", stop, { once: true });
  event.preventDefault();
}

function nudge(event, which) {
  const way = KEYS[event.key];
  if (!way) return;
  event.preventDefault();
  const step = NUDGE * size()[0] * (event.shiftKey ? FAR : 1);
  const at = grips()[which];
  const to = [at[0] + way[0] * step, at[1] + way[1] * step];
  moveGrips(geometry.dragged(grips(), which, to, state.mirrored ? centre() : null, false));
}

// The point of the picture below a pointer [px of the picture].
export function pointOf(event) {
  const seen = byId("paper").getBoundingClientRect();
  return [((event.clientX - seen.left) / seen.width) * size()[0], ((event.clientY - seen.top) / seen.height) * size()[1]];
}

export function draw() {
  byId("empty").hidden = true;
  byId("paper").hidden = false;
  byId("stage").classList.toggle("painting", state.tool !== "grips");
  place();
  drawFrame();
  drawGrips();
}

// Put the paper, which is the picture, so that the model's picture is seen too.
function place() {
  const [width, height] = size();
  const [left, top, w, h] = state.box;
  const [x0, y0] = [Math.min(0, left) * width, Math.min(0, top) * height];
  const [x1, y1] = [Math.max(1, left + w) * width, Math.max(1, top + h) * height];
  const stage = byId("stage");
  const margin = 14;
  const scale = Math.min((stage.clientWidth - 2 * margin) / (x1 - x0), (stage.clientHeight - 2 * margin) / (y1 - y0));
  const paper = byId("paper").style;
  paper.width = `${width * scale}px`;
  paper.height = `${height * scale}px`;
  paper.left = `${(stage.clientWidth - (x1 - x0) * scale) / 2 - x0 * scale}px`;
  paper.top = `${(stage.clientHeight - (y1 - y0) * scale) / 2 - y0 * scale}px`;
}

function drawFrame() {
  for (const id of ["white", "frame"]) {
    const style = byId(id).style;
    [style.left, style.top, style.width, style.height] = state.box.map((part) => `${100 * part}%`);
  }
  byId("white").hidden = state.fit !== "fit";
  byId("frame").hidden = state.fit !== "crop";
}

function drawGrips() {
  const seen = byId("paper");
  const scale = seen.clientWidth / size()[0];
  const onPaper = ([x, y]) => [x * scale, y * scale];
  const two = grips();
  const ends = velocity().map((v, k) => [two[k][0] + v[0] * duration(), two[k][1] + v[1] * duration()]);
  setLine(byId("axis"), ...two.map(onPaper));
  const lines = byId("arrows").children;
  [0, 1, 2, 3].forEach((k) => {
    const [from, to] = [onPaper(two[k % 2]), onPaper(ends[k % 2])];
    const part = partInside(from, to);
    setLine(lines[k], from, [from[0] + part * (to[0] - from[0]), from[1] + part * (to[1] - from[1])]);
    lines[k].classList.toggle("beyond", part < 1);
  });
  const [x, y] = onPaper(centre());
  byId("centre").setAttribute("cx", x);
  byId("centre").setAttribute("cy", y);
  [byId("grip1"), byId("grip2")].forEach((handle, k) => {
    const [left, top] = [100 * (two[k][0] / size()[0]), 100 * (two[k][1] / size()[1])];
    handle.style.left = `${left}%`;
    handle.style.top = `${top}%`;
    handle.setAttribute("aria-label", `Grip ${k + 1}: ${left.toFixed(1)} % from the left, ${top.toFixed(1)} % from the top`);
  });
}

// The part of a way on the paper that the stage shows, so that an arrow that is longer still has its head.
function partInside(from, to) {
  const [stage, paper] = [byId("stage").getBoundingClientRect(), byId("paper").getBoundingClientRect()];
  const low = [stage.left - paper.left + RIM, stage.top - paper.top + RIM];
  const high = [stage.right - paper.left - RIM, stage.bottom - paper.top - RIM];
  const parts = [0, 1].map((k) => {
    const way = to[k] - from[k];
    return way === 0 ? 1 : ((way > 0 ? high[k] : low[k]) - from[k]) / way;
  });
  return Math.max(0, Math.min(1, ...parts));
}

function setLine(line, [x1, y1], [x2, y2]) {
  Object.entries({ x1, y1, x2, y2 }).forEach(([name, value]) => line.setAttribute(name, value));
}
