// The page: which picture is open, and what happens when something changes.

import * as api from "./api.js";
import * as brush from "./brush.js";
import * as fields from "./fields.js";
import * as jobs from "./jobs.js";
import { attempt, byId, complain, note } from "./page.js";
import * as seen from "./seen.js";
import * as stage from "./stage.js";
import { changed, fresh, onChange, problem, state } from "./state.js";

const PANELS = ["picture-panel", "grips-panel", "material-panel", "run-panel"];

async function start() {
  state.setup = await api.setup();
  await api.begin();
  [stage, brush, fields, jobs].forEach((part) => part.connect());
  fields.watchTyping();
  connectFiles();
  connectChoices();
  connectPager();
  onChange(draw);
  jobs.draw();
  byId("choose").disabled = false;
  if (state.setup.images.length) await openImage(0);
}

function draw() {
  if (!state.opened) return;
  stage.draw();
  fields.draw();
  jobs.draw();
  seen.refresh();
  drawActions();
}

function drawActions() {
  const wrong = problem();
  const link = byId("export");
  if (wrong) link.removeAttribute("href");
  else link.href = api.url("condition.json", { condition: JSON.stringify(state.condition) });
  const stem = state.opened.name.replace(/\.[^.]*$/, "");
  link.setAttribute("download", `${stem}.json`);
  byId("keep").setAttribute("download", `${stem}.mask.png`);
  link.setAttribute("aria-disabled", String(Boolean(wrong)));
  byId("keep").href = api.url("mask.png");
  byId("import").disabled = false;
  const { images } = state.setup;
  byId("save").hidden = state.opened.index === null;
  byId("save").disabled = Boolean(wrong);
  byId("pager").hidden = !images.length;
  const { index } = state.opened;
  byId("previous").disabled = index === null || index === 0;
  byId("next").disabled = index === images.length - 1;
  if (index === null) byId("place").textContent = "back to the folder";
  else byId("place").textContent = `${index + 1} of ${images.length}, ${saved(images[index])}`;
}

function saved(image) {
  if (state.unsaved) return "changed";
  return image.saved ? "saved" : "not saved yet";
}

function connectFiles() {
  byId("choose").addEventListener("click", () => byId("file").click());
  byId("import").addEventListener("click", () => byId("json").click());
  byId("file").addEventListener("change", (event) => taken(event, openFile));
  byId("json").addEventListener("change", (event) => taken(event, importFile));
  byId("save").addEventListener("click", save);
  byId("alert").querySelector("button").addEventListener("click", () => complain(""));
  addEventListener("dragover", (event) => {
    event.preventDefault();
    byId("stage").classList.add("over");
  });
  addEventListener("dragleave", () => byId("stage").classList.remove("over"));
  addEventListener("drop", (event) => {
    event.preventDefault();
    byId("stage").classList.remove("over");
    const file = event.dataTransfer.files[0];
    if (file) (file.name.endsWith(".json") && state.opened ? importFile : openFile)(file);
  });
}

function taken(event, use) {
  const file = event.target.files[0];
  event.target.value = ""; // the same file may be chosen again
  if (file) use(file);
}

function connectChoices() {
  for (const input of document.querySelectorAll("input[name=fit]")) {
    input.addEventListener("change", () => chooseFit(input.value));
  }
  for (const input of document.querySelectorAll("input[name=tool]")) {
    input.addEventListener("change", () => {
      state.tool = input.value;
      brush.toolChanged();
      changed();
    });
  }
}

function connectPager() {
  byId("previous").addEventListener("click", () => turnTo(state.opened.index - 1));
  byId("next").addEventListener("click", () => turnTo(state.opened.index === null ? 0 : state.opened.index + 1));
  addEventListener("beforeunload", (event) => inFolder() && state.unsaved && event.preventDefault());
}

function inFolder() {
  return state.opened !== null && state.opened.index !== null;
}

function turnTo(index) {
  if (inFolder() && state.unsaved && !confirm("The changes are not saved. Go on without them?")) return;
  openImage(index);
}

async function openFile(file) {
  const most = state.setup.bytes;
  if (file.size > most) return complain(`${file.name} has more than ${most / 2 ** 20} MiB: make it smaller.`);
  const opened = await attempt(() => api.put("picture", file), "Finding the object…");
  return opened && show({ ...opened, name: file.name }, null);
}

async function openImage(index) {
  const opened = await attempt(() => api.post(`open/${index}`), "Finding the object…");
  if (opened) return show({ ...opened, name: state.setup.images[index].name }, opened.condition);
  if (state.opened) return undefined;
  byId("name").textContent = state.setup.images[index].name;
  return undefined;
}

async function show(opened, condition) {
  state.opened = opened;
  state.box = await api.get("box", { fit: state.fit });
  state.condition = condition ?? fresh();
  state.unsaved = false;
  fields.imported();
  byId("name").textContent = opened.name;
  byId("photo").src = api.url("picture.jpg", { number: opened.number });
  for (const id of PANELS) byId(id).disabled = false;
  note(byId("cutout-note"), opened.note ?? "", "warn");
  seen.showReference();
  jobs.forget();
  changed();
  await attempt(() => brush.load());
}

async function chooseFit(fit) {
  const box = await attempt(() => api.get("box", { fit }));
  if (!box) return;
  Object.assign(state, { fit, box });
  seen.showReference();
  changed();
}

async function importFile(file) {
  const condition = await attempt(async () => api.post("condition", await file.text()));
  if (!condition) return;
  state.condition = condition;
  state.unsaved = true;
  fields.imported();
  changed();
}

async function save() {
  if (!(await attempt(() => api.put("saved", JSON.stringify(state.condition))))) return;
  state.setup.images[state.opened.index].saved = true;
  state.unsaved = false;
  changed();
}

attempt(start);
