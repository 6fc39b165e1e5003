// The cut-out over the picture, and the brush that corrects it.

import * as api from "./api.js";
import { attempt, byId, note } from "./page.js";
import { pointOf } from "./stage.js";
import { recentre, size, state } from "./state.js";

const VEIL = "rgb(250 251 252 / 66%)";
const RIM = "#0b7f88";
const UNDO = 8;
const KEYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

const object = document.createElement("canvas"); // opaque white on the object, transparent elsewhere
const ring = document.createElement("canvas");
let before = [];
let at = null; // where the brush is, in pixels of the canvas
let stroke = null;
let sending = Promise.resolve();

export function connect() {
  const canvas = byId("mask");
  canvas.addEventListener("pointerdown", begin);
  canvas.addEventListener("pointermove", move);
  canvas.addEventListener("lostpointercapture", finish);
  canvas.addEventListener("pointerleave", () => !stroke && hideBrush());
  canvas.addEventListener("keydown", press);
  canvas.addEventListener("focus", () => showBrush(at ?? [canvas.width / 2, canvas.height / 2]));
  canvas.addEventListener("blur", hideBrush);
  byId("radius").addEventListener("input", () => at && showBrush(at));
  byId("undo").addEventListener("click", undo);
  byId("again").addEventListener("click", again);
}

// Take the cut-out that the server has.
export async function load() {
  const image = new Image();
  image.src = api.url("mask.png", { now: Date.now() });
  await image.decode();
  const [width, height] = state.opened.shown;
  for (const canvas of [byId("mask"), object, ring]) Object.assign(canvas, { width, height });
  const context = object.getContext("2d", { willReadFrequently: true });
  context.drawImage(image, 0, 0, width, height);
  const pixels = context.getImageData(0, 0, width, height);
  for (let k = 0; k < pixels.data.length; k += 4) {
    const inside = pixels.data[k] >= 128 ? 255 : 0;
    pixels.data.set([255, 255, 255, inside], k);
  }
  context.putImageData(pixels, 0, 0);
  before = [];
  byId("undo").disabled = true;
  at = null;
  draw();
}

export function toolChanged() {
  byId("mask").tabIndex = state.tool === "grips" ? -1 : 0;
  if (state.tool === "grips") hideBrush();
}

// A veil over what is not the object, and a line around the object.
function draw() {
  const canvas = byId("mask");
  const [width, height] = [canvas.width, canvas.height];
  const edge = ring.getContext("2d");
  edge.globalCompositeOperation = "source-over";
  edge.clearRect(0, 0, width, height);
  const reach = Math.max(1.5, width / 500);
  for (let k = 0; k < 8; k += 1) {
    edge.drawImage(object, reach * Math.cos((k * Math.PI) / 4), reach * Math.sin((k * Math.PI) / 4));
  }
  edge.globalCompositeOperation = "source-in";
  edge.fillStyle = RIM;
  edge.fillRect(0, 0, width, height);
  edge.globalCompositeOperation = "destination-out";
  edge.drawImage(object, 0, 0);

  const context = canvas.getContext("2d");
  context.globalCompositeOperation = "source-over";
  context.clearRect(0, 0, width, height);
  context.fillStyle = VEIL;
  context.fillRect(0, 0, width, height);
  context.globalCompositeOperation = "destination-out";
  context.drawImage(object, 0, 0);
  context.globalCompositeOperation = "source-over";
  context.drawImage(ring, 0, 0);
}

function radius() {
  return (Number(byId("radius").value) * byId("mask").width) / 1000;
}

function onCanvas(event) {
  const [x, y] = pointOf(event);
  return [(x / size()[0]) * object.width, (y / size()[1]) * object.height];
}

function begin(event) {
  if (event.button !== 0) return;
  byId("mask").setPointerCapture(event.pointerId);
  keep();
  stroke = onCanvas(event);
  paint(stroke, stroke);
}

function move(event) {
  const to = onCanvas(event);
  showBrush(to);
  if (!stroke) return;
  paint(stroke, to);
  stroke = to;
}

function finish() {
  if (!stroke) return;
  stroke = null;
  send();
}

function press(event) {
  const way = KEYS[event.key];
  if (way) {
    const step = radius() * (event.shiftKey ? 2.5 : 0.5);
    at ??= [object.width / 2, object.height / 2];
    showBrush([clamp(at[0] + way[0] * step, object.width), clamp(at[1] + way[1] * step, object.height)]);
  } else if (event.key === " " || event.key === "Enter") {
    keep();
    paint(at, at);
    send();
  } else {
    return;
  }
  event.preventDefault();
}

function clamp(value, most) {
  return Math.min(most, Math.max(0, value));
}

function paint(from, to) {
  const context = object.getContext("2d");
  context.globalCompositeOperation = state.tool === "erase" ? "destination-out" : "source-over";
  context.strokeStyle = "#fff";
  context.lineCap = "round";
  context.lineWidth = 2 * radius();
  context.beginPath();
  context.moveTo(...from);
  context.lineTo(to[0] + 0.01, to[1]); // a line of no length is not drawn everywhere
  context.stroke();
  draw();
}

function showBrush(point) {
  at = point;
  const scale = byId("paper").clientWidth / object.width;
  const circle = byId("brush");
  circle.setAttribute("cx", point[0] * scale);
  circle.setAttribute("cy", point[1] * scale);
  circle.setAttribute("r", radius() * scale);
  circle.setAttribute("visibility", "visible");
}

function hideBrush() {
  byId("brush").setAttribute("visibility", "hidden");
}

function keep() {
  before = [...before.slice(1 - UNDO), object.getContext("2d").getImageData(0, 0, object.width, object.height)];
  byId("undo").disabled = false;
}

function undo() {
  object.getContext("2d").putImageData(before.pop(), 0, 0);
  byId("undo").disabled = !before.length;
  draw();
  send();
}

async function again() {
  const found = await attempt(() => api.post("mask/again"), "Finding the object…");
  if (!found) return;
  await load();
  told(found);
}

// Send the cut-out, one after the other, so that the last one stays.
function send() {
  const whole = document.createElement("canvas");
  Object.assign(whole, { width: object.width, height: object.height });
  const context = whole.getContext("2d");
  context.fillRect(0, 0, whole.width, whole.height);
  context.drawImage(object, 0, 0);
  const number = state.opened.number;
  sending = sending.then(() => new Promise((done) => {
    whole.toBlob(async (blob) => {
      const found = state.opened.number === number ? await attempt(() => api.put("mask", blob)) : undefined;
      if (found && state.opened.number === number) told(found);
      done();
    }, "image/png");
  }));
}

// Wait until the server has what was painted.
export function sent() {
  return sending;
}

export function told(found) {
  note(byId("cutout-note"), found.note ?? "", "warn");
  recentre(found.object);
}
