// The shown objects: number and seed of points, or the surface; progress; downloads.
import { fetchFile, filePath, streamPoints } from "./api.js";
import { Cloud } from "./stage/cloud.js";
import { showCurl } from "./curl.js";
import { attempt } from "./problem.js";
import { Stage } from "./stage/stage.js";
import { fetchSurface } from "./stage/surface.js";

const element = (id) => document.getElementById(id);
const ids = ["n", "dots", "seed", "color", "surface", "download", "format", "words"];
const [slider, dots, seed, color, surface, form, format, words] = ids.map(element);
const progress = document.querySelector("#view progress");
const line = document.querySelector("#view .curl");

const MAX_POINTS = Number(`1e${slider.max}`); // on the stage, all clouds together

let stage; // undefined if the browser has no WebGL
let clouds = [];
let filling = new AbortController();

/** Show one object. */
export function showObject(object) {
  element("about").textContent = describe(object);
  words.hidden = true;
  show([object]);
}

/** Scroll to the stage and let the keys turn it. */
export function focusStage() {
  document.querySelector("#stage canvas").focus();
}

/** Show words side by side, each with a label; a click on the label opens that word alone. */
export function showWords(objects, labels, about) {
  element("about").textContent = about;
  words.replaceChildren(...objects.map((object, index) => label(object, labels[index])));
  words.hidden = false;
  show(objects);
  words.style.setProperty("--columns", stage?.grid.columns ?? 2);
}

function describe({ kind, model, spec, bytes, dimensions, shape_confidence: fit, created_at: created }) {
  const numbers = (bytes / 4).toLocaleString("en");
  const when = new Date(created).toLocaleString("en-GB", { dateStyle: "medium", timeStyle: "short" });
  const sides = dimensions?.map((side) => side.toFixed(2)).join(" × "); // lists lack those of older objects
  const size = sides ? `, ${sides} (width, height, depth)` : "";
  const likely = fit === undefined ? "" : `; expected fit of the shape: ${Math.round(100 * fit)}%`;
  return `${numbers} numbers (${spec.name}, k = ${spec.k}, of ${model}), ${kind} ${when}${size}${likely}`;
}

function label(object, text) {
  const item = document.createElement("li");
  const button = document.createElement("button");
  button.type = "button";
  button.textContent = text;
  button.addEventListener("click", () => showObject(object));
  item.append(button);
  return item;
}

function show(objects) {
  element("empty").hidden = Boolean(stage);
  form.hidden = line.hidden = objects.length > 1;
  color.parentElement.hidden = !objects.some((object) => object.color);
  clouds = objects.map((object) => new Cloud(object, stage?.materials));
  stage?.set(clouds);
  fill();
}

/** Points of each cloud: the slider's value, rounded to two digits. */
function pointsPerCloud() {
  const n = Number((10 ** Number(slider.value)).toPrecision(2));
  return Math.min(n, Math.floor(MAX_POINTS / Math.max(1, clouds.length)));
}

/** Fetch the points or surfaces that are missing. */
function fill() {
  filling.abort();
  filling = new AbortController();
  showNumbers();
  if (!stage) return;
  const { signal } = filling;
  const tasks = clouds.map((cloud) => (surface.checked ? fillSurface(cloud, signal) : fillPoints(cloud, signal)));
  attempt(() => Promise.all(tasks));
}

async function fillPoints(cloud, signal) {
  cloud.setSurface();
  cloud.reserve(pointsPerCloud());
  const query = { n: pointsPerCloud() - cloud.count, seed: seed.value, offset: cloud.count };
  if (query.n <= 0) return;
  await streamPoints(cloud.object, query, signal, (bytes) => {
    cloud.append(bytes);
    stage.redraw();
    showArrived();
  });
}

async function fillSurface(cloud, signal) {
  const mesh = await fetchSurface(cloud.object, signal);
  if (signal.aborted) return;
  cloud.setSurface(mesh);
  stage.redraw();
  showArrived();
}

function showNumbers() {
  const n = pointsPerCloud().toLocaleString("en");
  element("n-shown").textContent = n;
  slider.setAttribute("aria-valuetext", `${n} points`);
  stage?.show(pointsPerCloud());
  showArrived();
  if (!form.hidden) showDownload();
}

function showArrived() {
  if (surface.checked) {
    showTriangles();
    return;
  }
  const n = pointsPerCloud();
  const arrived = Math.min(n, ...clouds.map((cloud) => cloud.count));
  progress.value = clouds.length ? arrived / n : 0;
  progress.classList.toggle("done", arrived === n || !clouds.length);
  const each = clouds.length > 1 ? " each" : "";
  const done = arrived === n ? "" : ` of ${n.toLocaleString("en")}`;
  element("count").textContent = clouds.length ? `${arrived.toLocaleString("en")}${done} points${each}` : "";
}

function showTriangles() {
  const shown = clouds.filter((cloud) => cloud.surface);
  const triangles = shown.reduce((sum, cloud) => sum + cloud.surface.geometry.index.count / 3, 0);
  progress.value = clouds.length ? shown.length / clouds.length : 0;
  progress.classList.toggle("done", shown.length === clouds.length);
  element("count").textContent = shown.length ? `${triangles.toLocaleString("en")} triangles` : "";
}

/** The chosen file: its path in the API, and its suffix. */
function chosenFile() {
  const [{ object }] = clouds;
  const name = format.value;
  const { of } = format.selectedOptions[0].parentElement.dataset;
  const query = of === "points" ? { n: pointsPerCloud(), seed: seed.value, format: name } : { format: name };
  if (of !== "weights" && object.color && !color.checked) query.color = "none";
  return { path: filePath(object, of, query), suffix: name };
}

function showDownload() {
  const { path, suffix } = chosenFile();
  showCurl(line, `-o object.${suffix}`, path);
}

/** Switch between surface and points, on the stage and in the list of formats. */
function switchSurface() {
  slider.disabled = dots.disabled = seed.disabled = surface.checked;
  const group = format.querySelector(`[data-of="${surface.checked ? "mesh" : "points"}"]`);
  group.firstElementChild.selected = true;
  fill();
}

async function save() {
  const { blob, name } = await fetchFile(chosenFile().path);
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

function toggleFullscreen() {
  if (document.fullscreenElement) document.exitFullscreen();
  else element("stage").requestFullscreen();
}

function start() {
  try {
    stage = new Stage(document.querySelector("#stage canvas"));
  } catch {
    element("empty").textContent = "This browser has no WebGL and cannot draw points. Downloads still work.";
  }
  dots.addEventListener("input", () => stage?.resizeDots(2 ** dots.valueAsNumber));
  element("reset").addEventListener("click", () => stage?.reset());
  element("fullscreen").hidden = !document.fullscreenEnabled;
  element("fullscreen").addEventListener("click", toggleFullscreen);
  slider.addEventListener("input", showNumbers);
  slider.addEventListener("change", fill);
  seed.addEventListener("change", () => {
    if (!seed.reportValidity() || seed.value === "") return;
    for (const cloud of clouds) cloud.clear();
    fill();
  });
  color.addEventListener("change", () => {
    stage?.paint(color.checked);
    if (!form.hidden) showDownload();
  });
  surface.addEventListener("change", switchSurface);
  format.addEventListener("change", showDownload);
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    attempt(save);
  });
  slider.disabled = dots.disabled = seed.disabled = surface.checked;
  showNumbers();
}

start();
