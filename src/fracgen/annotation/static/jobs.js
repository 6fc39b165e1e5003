// The simulation and the generator: start, progress, cancel, film.

import * as api from "./api.js";
import { sent } from "./brush.js";
import { attempt, byId, complain, note } from "./page.js";
import { problem, state } from "./state.js";

const KINDS = ["simulate", "generate"];
const EVERY = 600;
const STATES = { waiting: "Waiting", running: "Running", failed: "Failed", cancelled: "Cancelled" };

let timer = 0;
let latest = {};

export function connect() {
  for (const kind of KINDS) {
    const [start, cancel] = byId(kind).querySelectorAll("button");
    start.addEventListener("click", () => run(kind));
    cancel.addEventListener("click", () => attempt(() => api.remove(`jobs/${latest[kind].id}`)).then(poll));
  }
}

// A new picture has no films yet.
export function forget() {
  latest = {};
  for (const kind of KINDS) byId(`${kind}-film`).replaceChildren(words(kind));
  byId("generate-figure").hidden = true; // its place is the photo's until it is used
  draw();
}

function words(kind) {
  const text = document.createElement("p");
  text.className = "quiet";
  text.textContent = kind === "simulate" ? "Start the simulation to see it here." : "It comes here.";
  return text;
}

async function run(kind) {
  await sent();
  const body = JSON.stringify(state.condition);
  if (await attempt(() => api.post(`jobs/${kind}`, body, { fit: state.fit }))) poll();
}

async function poll() {
  clearTimeout(timer);
  const number = state.opened.number;
  let found;
  try {
    found = await api.get("jobs");
  } catch (error) {
    complain(error.message);
    timer = setTimeout(poll, 5 * EVERY); // the server may be busy
    return;
  }
  if (number !== state.opened.number) return;
  for (const job of found) latest[job.kind] = job;
  if (latest.generate) byId("generate-figure").hidden = false;
  KINDS.forEach((kind) => latest[kind]?.state === "done" && showFilm(kind));
  draw();
  clearTimeout(timer);
  if (found.some(active)) timer = setTimeout(poll, EVERY);
}

function active(job) {
  return job !== undefined && (job.state === "waiting" || job.state === "running");
}

export function draw() {
  for (const kind of KINDS) {
    const [start, cancel] = byId(kind).querySelectorAll("button");
    const progress = byId(kind).querySelector("progress");
    const job = latest[kind];
    const lacking = reason(kind);
    start.disabled = Boolean(lacking) || active(job);
    cancel.hidden = progress.hidden = !active(job);
    progress.value = job?.done ?? 0;
    const bad = job?.state === "failed";
    note(byId(kind).querySelector("p"), lacking || told(job), bad && !lacking ? "bad" : "");
  }
}

function reason(kind) {
  if (kind === "generate" && state.setup.no_generator) return state.setup.no_generator;
  if (!state.opened) return "";
  if (kind === "simulate" && !state.opened.object) return "There is no cut-out: paint the object first.";
  return problem() ? "A number is wrong, see above." : "";
}

function told(job) {
  if (!job) return "";
  if (job.state === "done") return job.kind === "simulate" && job.text ? `Break: ${job.text}` : "";
  if (job.state === "waiting" && job.before) return `Waiting, ${job.before} before it`;
  return job.text && job.state !== "cancelled" ? `${STATES[job.state]}: ${job.text}` : STATES[job.state];
}

function link(address) {
  const element = document.createElement("a");
  Object.assign(element, { href: address, download: "film.mp4", textContent: "Save the film: it cannot be shown here." });
  return element;
}

function showFilm(kind) {
  const box = byId(`${kind}-film`);
  const address = api.url(`jobs/${latest[kind].id}/film.mp4`);
  if (box.querySelector("video")?.getAttribute("src") === address) return;
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  const film = document.createElement("video");
  Object.assign(film, { muted: true, loop: true, autoplay: !still, controls: true, playsInline: true, src: address });
  film.setAttribute("aria-label", `${kind === "simulate" ? "Simulation" : "Generated clip"}: colour and maps side by side`);
  film.addEventListener("error", () => box.replaceChildren(link(address))); // not every browser decodes H.264
  box.replaceChildren(film);
}
