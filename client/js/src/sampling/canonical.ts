// Canonical points: uniform samples of the canonical domain, the same as the service's (service/mapping/canonical.py).

import type { Spec } from "../function/weights.js";
import { Philox } from "./philox.js";

export type Domain = Spec["domain"];

export const DIMENSIONS: Readonly<Record<Domain, number>> = { ball: 3, sphere: 3, cube: 3, ball4: 4 };
const MAX_SEED = 2n ** 64n - 1n;

/** Draw points `offset` to `offset` + `n` of a seed: (n, d) numbers, where d is the domain's dimension. */
export function canonicalPoints(domain: Domain, n: number, seed: bigint | number = 0, offset = 0): Float32Array {
  check("n", n, 1);
  check("offset", offset, 0);
  if (BigInt(seed) < 0n || BigInt(seed) > MAX_SEED) throw new RangeError(`seed is ${seed}, it must lie in 0 to 2^64 - 1`);
  const d = DIMENSIONS[domain];
  const points = new Float32Array(d * n);
  const [philox, uniform] = [new Philox(BigInt(seed)), new Float64Array(8)];
  const place = PLACES[domain];
  for (let index = offset - (offset % 2); index < offset + n; index += 2) {
    philox.pair(index, uniform);
    for (const half of [0, 1]) {
      const at = index + half - offset;
      if (at >= 0 && at < n) place(uniform, 4 * half, points, d * at);
    }
  }
  return points;
}

function check(name: string, value: number, least: number): void {
  if (!Number.isSafeInteger(value) || value < least) {
    throw new RangeError(`${name} is ${value}, it must be a whole number from ${least} on`);
  }
}

type Place = (u: Float64Array, from: number, points: Float32Array, at: number) => void;

/** Turn four numbers in [0, 1), of `u` from `from` on, into a point of the domain. */
const PLACES: Readonly<Record<Domain, Place>> = {
  cube: (u, from, points, at) => {
    for (const axis of [0, 1, 2]) points[at + axis] = 2 * u[from + axis] - 1;
  },
  sphere: (u, from, points, at) => direct(u[from + 1], u[from + 2], 1, points, at),
  ball: (u, from, points, at) => direct(u[from + 1], u[from + 2], Math.cbrt(u[from]), points, at),
  ball4: (u, from, points, at) => {
    const [a, b] = [2 * Math.PI * u[from + 2], 2 * Math.PI * u[from + 3]];
    const radius = Math.sqrt(Math.sqrt(u[from]));
    const [near, far] = [radius * Math.sqrt(1 - u[from + 1]), radius * Math.sqrt(u[from + 1])];
    points.set([near * Math.sin(a), near * Math.cos(a), far * Math.sin(b), far * Math.cos(b)], at);
  },
};

/** A direction uniform on the sphere, times a radius: cos(polar angle) = 1 - 2u, azimuth = 2 pi v. */
function direct(u: number, v: number, radius: number, points: Float32Array, at: number): void {
  const across = 2 * Math.sqrt(u * (1 - u)) * radius; // sine of the polar angle
  points[at] = across * Math.cos(2 * Math.PI * v);
  points[at + 1] = across * Math.sin(2 * Math.PI * v);
  points[at + 2] = (1 - 2 * u) * radius;
}
