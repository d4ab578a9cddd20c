// What is known of an object, in words.
import { language, number, text } from "../text.js";

const [CLOSE, ROUGH] = [0.6, 0.4]; // expected F-scores at 2% of the longest side

/** A sentence for everyone: how large, how small, how likely. */
export function summarize({ dimensions, bytes, shape_confidence: fit }) {
  const [width, height, depth] = (dimensions ?? []).map((side) => number(Number(side.toFixed(2))));
  const size = dimensions ? text("size", { width, height, depth, kilobytes: number(Math.round(bytes / 1024)) }) : "";
  if (fit === undefined) return size;
  return `${text(fit >= CLOSE ? "fitClose" : fit >= ROUGH ? "fitRough" : "fitGuess")} ${size}`;
}

/** A line for experts: numbers, network, time and sides. */
export function describe({ kind, model, spec, bytes, dimensions, shape_confidence: fit, created_at: created }) {
  const when = new Date(created).toLocaleString(language, { dateStyle: "medium", timeStyle: "short" });
  const sides = dimensions?.map((side) => side.toFixed(2)).join(" × "); // lists lack those of older objects
  const about = text("about", { numbers: number(bytes / 4), spec: spec.name, k: spec.k, model, kind, when });
  const size = sides ? text("aboutSides", { sides }) : "";
  const likely = fit === undefined ? "" : text("aboutFit", { percent: Math.round(100 * fit) });
  return about + size + likely;
}
