// The shown objects: surface or points, their number and seed, and how far they have arrived.
import { streamPoints } from "../api.js";
import { copyText } from "./curl.js";
import { isComputable } from "../function/card.js";
import { formOf } from "../function/weights.js";
import { attempt, showProblem } from "../problem.js";
import { fetchParts, isOpening, openEarly, openStage, quiet } from "../stage/open.js";
import { number, text } from "../text.js";
import { describe, summarize } from "./about.js";
import { hideDownloads, preferFormat, showDownloads, startDownloads } from "./download.js";
import { hideFunction, showFunction } from "./function.js";
import { hideMorph, offerMorph, startMorph } from "./morph.js";
import { drawRobot, hideRobot, showRobot, startRobot } from "./robot.js";
import { briefly, hideStills, showStills, standIn } from "./stills.js";
import { startTools } from "./tools.js";
import { fetchFunctions } from "./weights.js";

const element = (id) => document.getElementById(id);
const ids = ["n", "dots", "seed", "color", "surface", "live", "words", "link", "working", "empty"];
const [slider, dots, seed, color, surface, live, words, link, working, empty] = ids.map(element);
const progress = document.querySelector("#view progress");

const [FETCHED, COMPUTED] = [6, 7]; // decimal logarithms of the most points on the stage, all clouds together
const canvas = document.querySelector("#stage canvas");

let parts; // of the stage, once it is open: see stage/parts.js
let stage; // undefined until then, without WebGL, and where three.js cannot be fetched
let wanted; // the objects that are shown, or are about to be
let clouds = [];
let filling = new AbortController();
let openAlone; // shows one object of several
let shownMix; // of `showWords`

/** Set up the view; `open(object)` is called when one of several objects is chosen. */
export function startView(open) {
  openAlone = open;
  startDownloads(chosen);
  startRobot();
  listen();
  showControls();
  showNumbers();
  fetchParts();
  openEarly(() => openView().catch(showProblem));
}

/** Show one object. Resolves when the stage has drawn it, or cannot. */
export async function showObject(object) {
  element("summary").textContent = summarize(object);
  element("about").textContent = describe(object);
  words.hidden = true;
  link.hidden = false;
  if (await present([object])) await fill();
}

/**
 * Show words side by side, each with a label; a click on the label opens that word alone.
 * `mix`: {objects, labels, way, about}; `way` are the objects from A to B, for a slider between them. Resolves when they
 * are drawn.
 */
export async function showWords(mix) {
  const { objects, labels, way, about } = mix;
  element("summary").textContent = text("mixes");
  element("about").textContent = about;
  words.replaceChildren(...objects.map((object, index) => label(object, labels[index])));
  words.hidden = false;
  link.hidden = true;
  if (!(await present(objects))) return;
  shownMix = mix;
  if (stage) offerMorph(way);
  words.style.setProperty("--columns", stage?.grid.columns ?? 2);
  await fill();
}

/** Take away what is shown, while a photo is being encoded; meanwhile the stage opens. */
export function clearView() {
  wanted = undefined;
  filling.abort();
  openView().catch(showProblem);
  for (const each of ["summary", "about", "count"]) element(each).textContent = "";
  words.hidden = link.hidden = empty.hidden = true;
  working.hidden = false;
  clouds = [];
  stage?.set(clouds);
  hideStills();
  hideDownloads();
  hideFunction();
  hideMorph();
  hideRobot();
  const { top, bottom } = element("stage").getBoundingClientRect();
  if (top < 0 || bottom > innerHeight) element("view").scrollIntoView({ block: "start" });
}

/** Tell that no object is shown, after a photo that did not become one. */
export function stopWorking() {
  working.hidden = true;
  empty.hidden = false;
}

/** Scroll to the stage and let the keys turn it. */
export function focusStage() {
  canvas.focus();
}

function label(object, name) {
  const item = document.createElement("li");
  const button = document.createElement("button");
  button.type = "button";
  button.textContent = name;
  button.addEventListener("click", () => openAlone(object));
  item.append(button);
  return item;
}

/** Show one cloud of n points instead of the words. */
function showMorph(cloud, n) {
  filling.abort();
  words.hidden = true;
  surface.disabled = live.disabled = seed.disabled = true;
  element("cloud").hidden = true;
  clouds = [cloud];
  stage.set(clouds);
  stage.show(n);
  element("count").textContent = text("nPoints", { n: number(n) });
}

/** Open the stage, once. Throws a Problem if three.js cannot be fetched. */
async function openView() {
  const opened = await openStage(canvas);
  if (parts) return;
  ({ parts, stage } = opened);
  if (!stage) return;
  stage.resizeDots(2 ** dots.valueAsNumber);
  stage.paint(color.checked);
  drawRobot(stage, parts.way);
  startMorph({ stage, parts, show: showMorph, back: () => attempt(() => showWords(shownMix)) });
}

/** Put objects on the stage, or pictures if it cannot open. Returns whether no others are wanted meanwhile. */
async function present(objects) {
  wanted = objects;
  hideStills();
  hideMorph();
  const picture = stage ? undefined : standIn(objects);
  if (!isOpening()) {
    await briefly(picture);
    await quiet(); // opening the stage takes a while
  }
  const problem = await openView().catch((error) => error);
  if (wanted !== objects) return false;
  working.hidden = true;
  surface.disabled = live.disabled = false;
  empty.hidden = Boolean(stage);
  live.parentElement.hidden = !stage || !objects.every(isComputable);
  live.checked &&= !live.parentElement.hidden;
  color.parentElement.hidden = !objects.some((object) => object.color);
  clouds = objects.map((object) => (stage ? new parts.Cloud(object, stage.materials) : { object, count: 0 }));
  if (clouds.length > 1) hideDownloads();
  stage?.set(clouds);
  if (!stage) showInstead(objects, problem);
  if (clouds.length === 1) showRobot(clouds[0]);
  else hideRobot();
  showControls();
  return true;
}

/** Leave the stage to pictures; `problem`: why three.js is missing, undefined if the browser has no WebGL. */
function showInstead(objects, problem) {
  empty.textContent = problem?.message ?? text("noWebgl");
  attempt(() => showStills(objects));
  if (problem) showProblem(problem);
}

/** Points of each cloud: the slider's value, rounded to two digits. */
function pointsPerCloud() {
  const n = Number((10 ** Number(slider.value)).toPrecision(2));
  return Math.min(n, Math.floor(10 ** slider.max / Math.max(1, clouds.length)));
}

/** What a download would save: the object that is shown alone, and how. */
function chosen() {
  const points = { n: pointsPerCloud(), seed: seed.value };
  return { object: clouds[0].object, points, inColor: color.checked, stage };
}

/** Fetch the points or surfaces that are missing. Resolves when they are there, or no longer wanted. */
async function fill() {
  filling.abort();
  filling = new AbortController();
  showNumbers();
  if (!stage) return;
  const { signal } = filling;
  const task = surface.checked ? fillSurface : live.checked ? fillComputed : fillPoints;
  await attempt(() => Promise.all(clouds.map((cloud) => task(cloud, signal))));
}

async function fillPoints(cloud, signal) {
  cloud.setSurface();
  cloud.setComputed();
  cloud.reserve(pointsPerCloud());
  const query = { n: pointsPerCloud() - cloud.count, seed: seed.value, offset: cloud.count };
  if (query.n <= 0) return;
  await streamPoints(cloud.object, query, signal, (bytes) => {
    cloud.append(bytes);
    stage.redraw();
    showArrived();
  });
}

/** Compute the missing points on the graphics card. */
async function fillComputed(cloud, signal) {
  if (!cloud.computed) {
    const functions = await fetchFunctions(cloud.object);
    if (signal.aborted) return;
    const form = formOf(functions, cloud.object.frame);
    cloud.setComputed(new parts.ComputedPoints(stage.renderer, functions, form, seed.value));
  }
  cloud.setSurface();
  const n = pointsPerCloud();
  while (cloud.count < n && !signal.aborted) {
    await cloud.computed.extend(n);
    stage.redraw();
    showArrived();
  }
}

async function fillSurface(cloud, signal) {
  const mesh = await parts.fetchSurface(cloud.object, signal);
  if (signal.aborted) return;
  cloud.setSurface(mesh);
  stage.redraw();
  showArrived();
}

function showNumbers() {
  const n = text("nPoints", { n: number(pointsPerCloud()) });
  element("n-shown").textContent = number(pointsPerCloud());
  slider.setAttribute("aria-valuetext", n);
  stage?.show(pointsPerCloud());
  showArrived();
  if (clouds.length === 1) showDownloads();
}

function showArrived() {
  if (stage && clouds.some((cloud) => cloud.surface || cloud.count)) hideStills();
  if (surface.checked) {
    showTriangles();
    return;
  }
  const n = pointsPerCloud();
  const arrived = Math.min(n, ...clouds.map((cloud) => cloud.count));
  const [{ object, computed } = {}] = clouds;
  if (clouds.length === 1 && computed && arrived) showFunction(object, computed.functions, arrived, seed.value);
  progress.value = clouds.length ? arrived / n : 0;
  progress.classList.toggle("done", arrived === n || !clouds.length);
  const key = arrived === n ? "nPoints" : "nOfPoints";
  const points = text(key, { n: number(arrived), all: number(n) });
  element("count").textContent = clouds.length > 1 ? text("each", { points }) : clouds.length ? points : "";
}

function showTriangles() {
  const shown = clouds.filter((cloud) => cloud.surface);
  const triangles = shown.reduce((sum, cloud) => sum + cloud.surface.triangles, 0);
  progress.value = clouds.length ? shown.length / clouds.length : 0;
  progress.classList.toggle("done", shown.length === clouds.length);
  element("count").textContent = shown.length ? text("nTriangles", { n: number(triangles) }) : "";
}

/** Offer the controls of what is shown: points have a number and a size. */
function showControls() {
  slider.max = live.checked ? COMPUTED : FETCHED;
  if (!live.checked || clouds.length > 1) hideFunction();
  slider.disabled = dots.disabled = seed.disabled = surface.checked;
  element("cloud").hidden = surface.checked;
}

function listen() {
  slider.addEventListener("input", () => (live.checked ? fill() : showNumbers()));
  slider.addEventListener("change", fill);
  dots.addEventListener("input", () => stage?.resizeDots(2 ** dots.valueAsNumber));
  seed.addEventListener("change", () => {
    if (!seed.reportValidity() || seed.value === "") return;
    for (const cloud of stage?.clouds ?? []) cloud.clear();
    fill();
  });
  color.addEventListener("change", () => {
    stage?.paint(color.checked);
    if (clouds.length === 1 && words.hidden && !link.hidden) showDownloads();
  });
  for (const [shown, other] of [[surface, live], [live, surface]]) {
    shown.addEventListener("change", () => {
      other.checked &&= !shown.checked;
      showControls();
      preferFormat(surface.checked ? "mesh" : "points");
      fill();
    });
  }
  startTools(() => stage?.reset());
  link.addEventListener("click", () => copyText(location.href, link));
}
