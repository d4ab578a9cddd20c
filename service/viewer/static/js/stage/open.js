// The stage, opened for the first object: until then the page works without three.js and without WebGL.
import { Problem } from "../api.js";
import { text } from "../text.js";

const MOST_PATIENCE_MS = 2000; // for a quiet moment
const STARTS = ["pointerdown", "pointermove", "keydown", "dragenter"]; // events

let parts; // a promise, once they are wanted
let opening;

/** Fetch the modules of the stage once the page is seen and rests, for when an object is to be drawn. */
export async function fetchParts() {
  await new Promise((done) => new PerformanceObserver(done).observe({ type: "paint", buffered: true }));
  if (document.readyState !== "complete") await new Promise((done) => addEventListener("load", done, { once: true }));
  await quiet();
  await load().catch(() => {}); // whoever needs them tells
}

/** Open the stage when the visitor starts to do something, so that it is there when an object is. */
export function openEarly(open) {
  const first = async () => {
    for (const name of STARTS) removeEventListener(name, first);
    await quiet();
    open();
  };
  for (const name of STARTS) addEventListener(name, first, { passive: true });
}

/**
 * Open the stage on a canvas: {parts, stage}; without WebGL there is no `stage`. Throws a Problem if three.js cannot be
 * fetched, and again each time: most browsers do not fetch a module again before the page is reloaded.
 */
export function openStage(canvas) {
  opening ??= open(canvas);
  return opening;
}

/** Return whether the stage is open, being opened, or could not be opened. */
export function isOpening() {
  return opening !== undefined;
}

/** Wait until the browser has nothing urgent to do. Safari cannot tell. */
export function quiet() {
  return new Promise((done) => {
    if (globalThis.requestIdleCallback) requestIdleCallback(done, { timeout: MOST_PATIENCE_MS });
    else setTimeout(done, 1);
  });
}

function load() {
  parts ??= import("./parts.js").catch((error) => {
    console.warn(error);
    throw Object.assign(new Problem(text("noStage"), text("noStageReload")), { isLasting: true });
  });
  return parts;
}

async function open(canvas) {
  const loaded = await load();
  await painted(); // opening takes a while: what the visitor just did shows first
  try {
    return { parts: loaded, stage: new loaded.Stage(canvas) };
  } catch {
    return { parts: loaded };
  }
}

function painted() {
  return new Promise((done) => {
    requestAnimationFrame(() => setTimeout(done));
    setTimeout(done, 100); // hidden pages have no frames
  });
}
