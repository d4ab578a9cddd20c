// The box of an object: a probe of fixed points, then a search around the outermost ones (service/mapping/box.py).

import type { Frame, Functions, Spec } from "../function/weights.js";
import { canonicalPoints, DIMENSIONS, type Domain } from "./canonical.js";
import { mapped } from "./mapping.js";

const [BORDER, INTERIOR] = [4096, 2048]; // probe points, on the border of the domain and anywhere in it
const CANDIDATES = 4; // for each of the six directions
const TRIALS = 16; // points around each candidate, in each step
const STEPS = [0.1, 0.05, 0.02, 0.01]; // radius of the search around a candidate
const SMALLEST = 1e-20; // a box that is not longer is a point, which has no size to divide by

type Word = readonly Float32Array[];

interface Candidate {
  point: number[];
  reached: number;
}

/** The functions that are applied: theta k times, or those of a word. */
export function wordOf({ spec, rows }: Pick<Functions, "spec" | "rows">): Word {
  return rows.length > 1 ? rows : Array.from({ length: spec.k }, () => rows[0]);
}

/** Measure the box of a function, or of a word, in its own numbers. */
export function measureFrame(functions: Pick<Functions, "spec" | "rows">): Frame {
  const { spec } = functions;
  const word = wordOf(functions);
  const d = DIMENSIONS[spec.domain];
  const around = canonicalPoints(d === 4 ? "ball4" : "ball", TRIALS, 1);
  const probe = probeOf(spec.domain);
  const images = mapped(spec, word, probe);
  const outermost = [0, 1, 2, 3, 4, 5].map((direction) => {
    const order = Array.from({ length: probe.length / d }, (_, index) => index);
    const heights = order.map((index) => heightOf(images, index, direction));
    order.sort((a, b) => heights[b] - heights[a]);
    const candidates = order.slice(0, CANDIDATES).map((index) => ({
      point: [...probe.subarray(d * index, d * (index + 1))],
      reached: heights[index],
    }));
    for (const step of STEPS) search(spec, word, candidates, direction, step, around);
    return Math.max(...candidates.map(({ reached }) => reached));
  });
  return { low: outermost.slice(3).map((height) => -height), high: outermost.slice(0, 3) };
}

/** Center points on a box and divide them by its longest side, in place. */
export function place(points: Float32Array, { low, high }: Frame, scale = 1): Float32Array {
  const longest = Math.max(...high.map((value, axis) => value - low[axis]));
  const factor = scale / (longest > SMALLEST ? longest : 1);
  const center = high.map((value, axis) => (value + low[axis]) / 2);
  for (let at = 0; at < points.length; at++) points[at] = (points[at] - center[at % 3]) * factor;
  return points;
}

/** Width, height and depth of a box in the object frame: the longest is 1. */
export function dimensionsOf({ low, high }: Frame): number[] {
  const sides = high.map((value, axis) => value - low[axis]);
  const longest = Math.max(...sides);
  return sides.map((side) => side / (longest > SMALLEST ? longest : 1));
}

/** Move each candidate to the highest of the points around it, if that is higher. */
function search(
  spec: Spec,
  word: Word,
  candidates: Candidate[],
  direction: number,
  step: number,
  around: Float32Array,
): void {
  const d = DIMENSIONS[spec.domain];
  for (const candidate of candidates) {
    const trials = around.map((value, at) => candidate.point[at % d] + step * value);
    for (let trial = 0; trial < TRIALS; trial++) moveInside(spec.domain, trials.subarray(d * trial, d * (trial + 1)));
    const images = mapped(spec, word, trials);
    for (let trial = 0; trial < TRIALS; trial++) {
      const height = heightOf(images, trial, direction);
      if (height <= candidate.reached) continue;
      candidate.reached = height;
      candidate.point = [...trials.subarray(d * trial, d * (trial + 1))];
    }
  }
}

/** How far a point reaches along +x, +y, +z, -x, -y or -z. */
function heightOf(images: Float32Array, index: number, direction: number): number {
  const value = images[3 * index + (direction % 3)];
  return direction < 3 ? value : -value;
}

function probeOf(domain: Domain): Float32Array {
  const d = DIMENSIONS[domain];
  const points = canonicalPoints(domain, BORDER + INTERIOR);
  for (let index = 0; index < BORDER; index++) {
    const point = points.subarray(d * index, d * (index + 1));
    const length = lengthOf(domain, point);
    if (length > 0) point.forEach((value, axis) => (point[axis] = value / length));
  }
  return points;
}

/** Move a point that lies outside the domain to its border, and any point onto a sphere. */
function moveInside(domain: Domain, point: Float32Array): void {
  const length = lengthOf(domain, point);
  point.forEach((value, axis) => {
    if (domain === "cube") point[axis] = Math.min(1, Math.max(-1, value));
    else if (length > 1 || (domain === "sphere" && length > 0)) point[axis] = value / length;
  });
}

/** The length of a point in the norm whose unit ball is the domain. */
function lengthOf(domain: Domain, point: Float32Array): number {
  return domain === "cube" ? Math.max(...point.map(Math.abs)) : Math.hypot(...point);
}
