// An object's function drawn without the service: its points, and their colors.

import { CardPoints, isComputable } from "../function/card.js";
import { formOf, type Frame, type Functions } from "../function/weights.js";
import { canonicalPoints } from "./canonical.js";
import { measureFrame, place, wordOf } from "./frame.js";
import { mapped } from "./mapping.js";

export interface SampleOptions {
  /** Which points: 0 to 2^64 - 1. */
  seed?: bigint | number;
  /** Index of the first point. */
  offset?: number;
  /** Length of the longest side. */
  scale?: number;
}

/**
 * Compute the n points that the service gives for the same seed: x, y and z of each, in the object frame. Weights that
 * have no box of their own are measured first.
 */
export function sample(functions: Functions, n: number, options: SampleOptions = {}): Float32Array {
  const { seed = 0, offset = 0, scale = 1 } = options;
  const canonical = canonicalPoints(functions.spec.domain, n, seed, offset);
  return place(mapped(functions.spec, wordOf(functions), canonical), frameOf(functions), scale);
}

/** Compute the colors of the points that `sample` gives: red, green and blue of each (sRGB); undefined without color. */
export function sampleColors(functions: Functions, n: number, options: SampleOptions = {}): Uint8Array | undefined {
  const { seed = 0, offset = 0 } = options;
  return colorsAt(functions, canonicalPoints(functions.spec.domain, n, seed, offset));
}

/** Compute the colors at canonical points, the mean of the functions' colors: (n, 3); undefined without color. */
export function colorsAt({ colorSpec, colorRows }: Functions, canonical: Float32Array): Uint8Array | undefined {
  if (!colorSpec) return undefined;
  const total = new Float64Array((3 * canonical.length) / colorSpec.input_dim);
  for (const row of colorRows) {
    mapped(colorSpec, [row], canonical).forEach((value, at) => (total[at] += Math.min(1, Math.max(0, value))));
  }
  return Uint8Array.from(total, (value) => Math.round((255 * value) / colorRows.length));
}

/**
 * Compute the points of `sample` on the graphics card (WebGL2), for functions that `isComputable` tells; in browsers
 * only.
 */
export async function sampleOnCard(
  functions: Functions,
  n: number,
  { seed = 0, gl = context() }: { seed?: bigint | number; gl?: WebGL2RenderingContext } = {},
): Promise<Float32Array> {
  const frame = frameOf(functions);
  const { spec, colorSpec } = functions;
  if (!isComputable({ spec, color: colorSpec ?? null, frame })) {
    throw new RangeError(`${spec.name} is no network that the shader can be: draw it with sample`);
  }
  const points = new CardPoints(gl, functions, formOf(functions, frame), seed);
  try {
    while (points.done < n) await points.extend(n);
    return points.read(0, n).points;
  } finally {
    points.dispose();
  }
}

function frameOf(functions: Functions): Frame {
  return functions.frame ?? measureFrame(functions);
}

let shared: WebGL2RenderingContext | undefined;

/** The context of all calls without one of their own: browsers allow a page only a few. */
function context(): WebGL2RenderingContext {
  if (!shared || shared.isContextLost()) {
    const gl = new OffscreenCanvas(1, 1).getContext("webgl2");
    if (!gl) throw new Error("the browser has no WebGL2: draw with sample");
    shared = gl;
  }
  return shared;
}
