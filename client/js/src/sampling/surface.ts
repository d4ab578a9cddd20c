// An object's surface: nested shells in the canonical domain, pushed through the mapping function; what it stretches
// across gaps is cut out (service/mapping/surface.py).

import type { Functions } from "../function/weights.js";
import { shellsOf } from "./shells.js";
import { measureFrame, place, wordOf } from "./frame.js";
import { mapped } from "./mapping.js";
import { colorsAt } from "./sample.js";
import { withoutTears } from "./tears.js";

const RESOLUTION = 64;

/** A triangle mesh in the object frame. */
export interface Surface {
  /** (v, 3) numbers. */
  vertices: Float32Array;
  /** (v, 3) numbers, each normal of length 1. */
  normals: Float32Array;
  /** (t, 3) indices of vertices, counter-clockwise seen from outside. */
  triangles: Uint32Array;
  /** (v, 3) levels of red, green and blue (sRGB), if the object has a color. */
  colors?: Uint8Array;
}

/** Compute the surface of an object. `resolution`: it has 20 resolution^2 triangles before it is cut. */
export function surfaceOf(functions: Functions, resolution = RESOLUTION): Surface {
  const { spec } = functions;
  const d = spec.input_dim;
  const { points: shells, triangles: all } = shellsOf(spec.domain, resolution);
  const frame = functions.frame ?? measureFrame(functions);
  const imagesOf = (points: Float32Array): Float32Array => place(mapped(spec, wordOf(functions), points), frame);
  const whole = imagesOf(shells);
  const cut = withoutTears(shells, d, whole, all);
  const [points, images] = [joined(shells, cut.points), joined(whole, imagesOf(cut.points))];
  const { used, triangles } = renumbered(cut.triangles, points.length / d);
  const vertices = taken(images, 3, used);
  const colors = colorsAt(functions, taken(points, d, used));
  return { vertices, normals: normalsOf(vertices, triangles), triangles, ...(colors && { colors }) };
}

/** The points that triangles use, in order, and the triangles in their numbers. */
function renumbered(triangles: Uint32Array, count: number): { used: number[]; triangles: Uint32Array } {
  const isUsed = new Uint8Array(count);
  for (const corner of triangles) isUsed[corner] = 1;
  const numbers = new Uint32Array(count);
  const used: number[] = [];
  isUsed.forEach((flag, point) => {
    numbers[point] = used.length;
    if (flag) used.push(point);
  });
  return { used, triangles: triangles.map((corner) => numbers[corner]) };
}

function joined(first: Float32Array, second: Float32Array): Float32Array {
  const result = new Float32Array(first.length + second.length);
  result.set(first);
  result.set(second, first.length);
  return result;
}

function taken(rows: Float32Array, size: number, indices: readonly number[]): Float32Array {
  const result = new Float32Array(size * indices.length);
  indices.forEach((index, at) => result.set(rows.subarray(size * index, size * (index + 1)), size * at));
  return result;
}

/** Each vertex's normal: the area-weighted mean of its triangles', or (0, 1, 0) where they cancel out. */
function normalsOf(vertices: Float32Array, triangles: Uint32Array): Float32Array {
  const sums = new Float64Array(vertices.length);
  for (let at = 0; at < triangles.length; at += 3) {
    const [a, b, c] = [3 * triangles[at], 3 * triangles[at + 1], 3 * triangles[at + 2]];
    const [u, v] = [b, c].map((to) => [0, 1, 2].map((axis) => vertices[to + axis] - vertices[a + axis]));
    const cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    for (const corner of [a, b, c]) for (let axis = 0; axis < 3; axis++) sums[corner + axis] += cross[axis];
  }
  const normals = new Float32Array(vertices.length);
  for (let at = 0; at < normals.length; at += 3) {
    const length = Math.hypot(sums[at], sums[at + 1], sums[at + 2]);
    for (let axis = 0; axis < 3; axis++) normals[at + axis] = length ? sums[at + axis] / length : Number(axis === 1);
  }
  return normals;
}
