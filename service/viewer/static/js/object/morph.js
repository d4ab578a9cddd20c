// The way from one object to another: in a word, one letter after the other turns from A to B. The graphics card
// computes each step of the slider from the two thetas.
import { isComputable } from "../function/card.js";
import { attempt } from "../problem.js";
import { text } from "../text.js";
import { fetchFunctions } from "./weights.js";

const POINTS = 60_000;

const panel = document.getElementById("morph");
const slider = document.getElementById("between");
const back = document.getElementById("sides");

let view; // {stage, parts, show(cloud, n), back()}
let way = []; // objects from A to B, k + 1 of them
let cloud; // of the way, once the slider was moved

/** Set up the slider. `handlers`: `stage`, `parts` (stage/parts.js), `show(cloud, n)` shows a cloud alone, `back()` shows all words again. */
export function startMorph(handlers) {
  view = handlers;
  slider.addEventListener("input", () => attempt(move));
  back.addEventListener("click", () => view.back());
}

/** Offer the way over these words: A, then those with one letter more turned to B each, then B. */
export function offerMorph(words) {
  hideMorph();
  if (!words.every(isComputable)) return;
  way = words;
  slider.max = way.length - 1;
  slider.value = 0;
  panel.hidden = false;
}

/** Offer nothing. */
export function hideMorph() {
  panel.hidden = back.hidden = true;
  way = [];
  cloud = undefined;
}

async function move() {
  const mine = cloud ?? (await makeCloud());
  if (!mine?.computed) return; // something else is shown meanwhile
  cloud = mine;
  const place = slider.valueAsNumber;
  slider.setAttribute("aria-valuetext", text("between", { percent: Math.round((100 * place) / slider.max) }));
  mine.computed.change(formAt(way, place, mine.computed.functions));
  if (mine.isBusy) return;
  mine.isBusy = true;
  try {
    while (mine === cloud && mine.computed?.done < POINTS) {
      await mine.computed.extend(POINTS);
      view.stage.redraw();
    }
  } finally {
    mine.isBusy = false;
  }
}

/** Build the cloud of both functions and show it alone; undefined if something else is shown meanwhile. */
async function makeCloud() {
  const words = way;
  const [first, last] = [words[0], words.at(-1)];
  const [a, b] = await Promise.all([fetchFunctions(first), fetchFunctions(last)]);
  if (words !== way) return undefined;
  if (cloud) return cloud; // the slider moved again
  const functions = joined(a, b);
  const form = formAt(words, slider.valueAsNumber, functions);
  const made = new view.parts.Cloud({ ...first, color: first.color ?? last.color }, view.stage.materials);
  made.setComputed(new view.parts.ComputedPoints(view.stage.renderer, functions, form));
  view.show(made, POINTS);
  back.hidden = false;
  return made;
}

/** The functions of A and of B, as those of one object. */
export function joined(a, b) {
  return {
    ...a,
    rows: [...a.rows, ...b.rows],
    colorSpec: a.colorSpec ?? b.colorSpec,
    colorRows: [...a.colorRows, ...b.colorRows],
  };
}

/**
 * The form at a place of the way over these words, from 0 to k: see ComputedPoints. Between two words, a step is a blend
 * of both functions, and the box a blend of both boxes.
 */
export function formAt(words, place, { colorRows }) {
  const k = words.length - 1;
  const word = Array.from({ length: k }, (_, step) => [0, 1, Math.min(1, Math.max(0, place - (k - 1 - step)))]);
  const before = Math.min(k - 1, Math.floor(place));
  const [from, to] = [words[before].frame, words[before + 1].frame];
  const mix = (name) => from[name].map((value, axis) => value + (place - before) * (to[name][axis] - value));
  const colorShares = colorRows.length > 1 ? [1 - place / k, place / k] : colorRows.map(() => 1);
  return { word, frame: { low: mix("low"), high: mix("high") }, colorShares };
}
