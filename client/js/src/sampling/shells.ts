// Closed meshes in a canonical domain: nested shells, each an icosphere.

import { DIMENSIONS, type Domain } from "./canonical.js";

/** Points of a canonical domain, (n, d), and triangles, (t, 3), facing outward. */
export interface Shells {
  points: Float32Array;
  triangles: Uint32Array;
}

type Triple = readonly [number, number, number];

const SHELLS: Readonly<Record<Domain, number>> = { sphere: 1, ball: 24, cube: 24, ball4: 24 };

/** Each shell lies in the middle of an equal share of the volume; in four dimensions it is a sphere in three of them. */
export function shellsOf(domain: Domain, resolution: number): Shells {
  const count = SHELLS[domain];
  const sphere = icosphere(Math.max(1, Math.round(resolution / Math.sqrt(count))));
  if (domain === "sphere") return sphere;
  const d = DIMENSIONS[domain];
  const size = sphere.points.length / 3;
  const points = new Float32Array(d * size * count);
  const triangles = new Uint32Array(sphere.triangles.length * count);
  for (let shell = 0; shell < count; shell++) {
    const radius = ((shell + 0.5) / count) ** (1 / d);
    for (let index = 0; index < size; index++) {
      const point = [...sphere.points.subarray(3 * index, 3 * index + 3)];
      const length = domain === "cube" ? Math.max(...point.map(Math.abs)) : 1;
      const scaled = point.map((value) => (value / length) * radius);
      if (d === 4) scaled.splice(shell % 4, 0, 0);
      points.set(scaled, d * (shell * size + index));
    }
    triangles.set(sphere.triangles.map((corner) => corner + shell * size), shell * sphere.triangles.length);
  }
  return { points, triangles };
}

/** Divide each edge of an icosahedron in r parts: a unit sphere of 20 r^2 triangles and 10 r^2 + 2 points. */
function icosphere(r: number): Shells {
  const numbers = new Map<string, number>(); // faces share their borders
  const points: number[] = [];
  const triangles: number[] = [];
  for (const face of icosahedron()) {
    const corner = (i: number, j: number) => {
      const point = [0, 1, 2].map((axis) => i * face[0][axis] + j * face[1][axis] + (r - i - j) * face[2][axis]);
      const key = point.map((value) => Math.round(value) || 0).join(); // different points are at least 2 apart
      const known = numbers.get(key);
      if (known !== undefined) return known;
      points.push(...point.map((value) => value / Math.hypot(...point)));
      numbers.set(key, numbers.size);
      return numbers.size - 1;
    };
    for (let i = 0; i < r; i++) {
      for (let j = 0; i + j < r; j++) {
        triangles.push(corner(i, j), corner(i + 1, j), corner(i, j + 1));
        if (i + j < r - 1) triangles.push(corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1));
      }
    }
  }
  return { points: Float32Array.from(points), triangles: Uint32Array.from(triangles) };
}

/** The 20 faces, with edges of length 2, counter-clockwise seen from outside. */
function icosahedron(): [Triple, Triple, Triple][] {
  const golden = (1 + Math.sqrt(5)) / 2;
  const corners: Triple[] = [-1, 1].flatMap((a) =>
    [-golden, golden].flatMap((b): Triple[] => [[0, a, b], [b, 0, a], [a, b, 0]]),
  );
  const isNear = (a: Triple, b: Triple) => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]) < 2.1;
  const faces: [Triple, Triple, Triple][] = [];
  corners.forEach((a, first) => {
    corners.slice(first + 1).forEach((b, between) => {
      for (const c of corners.slice(first + between + 2)) {
        if (isNear(a, b) && isNear(a, c) && isNear(b, c)) faces.push(isOutward(a, b, c) ? [a, b, c] : [a, c, b]);
      }
    });
  });
  return faces;
}

function isOutward([ax, ay, az]: Triple, [bx, by, bz]: Triple, [cx, cy, cz]: Triple): boolean {
  return ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx) > 0;
}
