// Cut a surface where the mapping function tears it, along a smooth line (service/mapping/tears.py).

const MOST_STRETCH = 8; // growth of squared lengths, in medians of all triangles
const NEAR = 0.1; // a cut passes no nearer to a vertex, in lengths of the edge
const LEAST = 1e-9; // stretch, in medians, that its logarithm distinguishes from none

/** Points on cut edges (m, d), and triangles of all n + m points. */
export interface Cut {
  points: Float32Array;
  triangles: Uint32Array;
}

/** Cut a closed mesh of canonical points (n, d), whose images are (n, 3), where it is stretched far more than most. */
export function withoutTears(points: Float32Array, d: number, images: Float32Array, triangles: Uint32Array): Cut {
  const levels = stretches(points, d, images, triangles).map((stretch) => stretch - Math.log(MOST_STRETCH));
  const count = points.length / d;
  const numbers = new Map<number, number>(); // of points on cut edges
  const fresh: number[] = [];
  const kept: number[] = [];
  const cut = (from: number, to: number): number => {
    const [first, second] = from < to ? [from, to] : [to, from];
    const edge = first * count + second;
    const number = numbers.get(edge) ?? count + numbers.size;
    if (!numbers.has(edge)) {
      numbers.set(edge, number);
      const share = Math.min(1 - NEAR, Math.max(NEAR, levels[first] / (levels[first] - levels[second])));
      for (let axis = 0; axis < d; axis++) {
        fresh.push((1 - share) * points[d * first + axis] + share * points[d * second + axis]);
      }
    }
    return number;
  };
  for (let at = 0; at < triangles.length; at += 3) {
    const corners = triangles.subarray(at, at + 3);
    const flags = Array.from(corners, (corner) => levels[corner] <= 0);
    const inside = flags.filter(Boolean).length;
    if (inside === 3) kept.push(...corners);
    if (inside === 0 || inside === 3) continue;
    const lone = flags.indexOf(inside === 1); // the corner on its own side of the cut
    const [a, b, c] = [0, 1, 2].map((step) => corners[(lone + step) % 3]);
    const [ab, ac] = [cut(a, b), cut(a, c)];
    if (inside === 1) kept.push(a, ab, ac);
    else kept.push(ab, b, c, ab, c, ac);
  }
  return { points: new Float32Array(fresh), triangles: new Uint32Array(kept) };
}

/** The logarithm of how much the triangles at each point are stretched, in medians of all; smoothed once. */
function stretches(points: Float32Array, d: number, images: Float32Array, triangles: Uint32Array): Float64Array {
  const [before, after] = [longestOf(points, d, triangles), longestOf(images, 3, triangles)];
  const sorted = after.map((length, triangle) => length / before[triangle]).sort();
  const middle = sorted.length >> 1;
  const median = sorted.length % 2 ? sorted[middle] : (sorted[middle - 1] + sorted[middle]) / 2;
  const count = points.length / d;
  if (!median) return new Float64Array(count);
  const [sumsBefore, sumsAfter] = [new Float64Array(count), new Float64Array(count)];
  triangles.forEach((corner, at) => {
    sumsBefore[corner] += before[Math.floor(at / 3)];
    sumsAfter[corner] += after[Math.floor(at / 3)];
  });
  const sharp = sumsAfter.map((sum, point) => Math.log(Math.max(LEAST, sum / (median * sumsBefore[point]))));
  const [around, neighbors] = [new Float64Array(count), new Float64Array(count)];
  triangles.forEach((corner, at) => {
    around[corner] += sharp[triangles[at % 3 === 2 ? at - 2 : at + 1]];
    neighbors[corner] += 1;
  });
  return sharp.map((stretch, point) => (stretch + around[point] / neighbors[point]) / 2);
}

/** The squared length of each triangle's longest edge. */
function longestOf(points: Float32Array, d: number, triangles: Uint32Array): Float64Array {
  const longest = new Float64Array(triangles.length / 3);
  triangles.forEach((from, at) => {
    const to = triangles[at % 3 === 2 ? at - 2 : at + 1];
    let squared = 0;
    for (let axis = 0; axis < d; axis++) squared += (points[d * to + axis] - points[d * from + axis]) ** 2;
    const triangle = Math.floor(at / 3);
    longest[triangle] = Math.max(longest[triangle], squared);
  });
  return longest;
}
