// Triangles on a square of pixels, without a graphics card: the nearest one at each pixel, and how deep it lies.

const BEHIND = -10; // depth of the background
const REACHES = [1 / 160, 1 / 80, 1 / 40]; // distances at which a pixel may be shaded, shares of the picture's side
const DEEPEST = 0.15; // a larger difference in depth shades no more than this
const SHADE = 10; // light falls to 1 / e if all neighbors are nearer by 1 / SHADE

/**
 * Draw triangles (three `indices` of vertices each) over an image, three numbers a pixel, and return each pixel's depth.
 *
 * `places`: (v, 3) column, row and depth of vertices, the nearest with the greatest depth; `colors`: (v, 3).
 */
export function rasterize(image, side, places, colors, indices) {
  const depths = new Float32Array(side * side).fill(BEHIND);
  for (let at = 0; at < indices.length; at += 3) {
    fill(image, depths, side, places, colors, [3 * indices[at], 3 * indices[at + 1], 3 * indices[at + 2]]);
  }
  return depths;
}

function fill(image, depths, side, places, colors, [a, b, c]) {
  const [ax, ay, bx, by, cx, cy] = [a, b, c].flatMap((corner) => [places[corner], places[corner + 1]]);
  const area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
  if (!area) return; // seen from its side
  const [left, right] = [Math.max(0, Math.ceil(Math.min(ax, bx, cx))), Math.min(side - 1, Math.max(ax, bx, cx))];
  const [top, bottom] = [Math.max(0, Math.ceil(Math.min(ay, by, cy))), Math.min(side - 1, Math.max(ay, by, cy))];
  for (let y = top; y <= bottom; y++) {
    for (let x = left; x <= right; x++) {
      const v = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area;
      const w = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area;
      const u = 1 - v - w;
      if (u < 0 || v < 0 || w < 0) continue;
      const depth = u * places[a + 2] + v * places[b + 2] + w * places[c + 2];
      const pixel = y * side + x;
      if (depth <= depths[pixel]) continue;
      depths[pixel] = depth;
      for (let channel = 0; channel < 3; channel++) {
        image[3 * pixel + channel] = u * colors[a + channel] + v * colors[b + channel] + w * colors[c + channel];
      }
    }
  }
}

/** Darken the pixels of an object that lie behind their neighbors: eye-dome lighting (Boucheny 2009). */
export function shadeEdges(image, side, depths) {
  const steps = REACHES.map((reach) => Math.max(1, Math.round(reach * side)));
  const ways = steps.flatMap((step) => [-step, 0, step].flatMap((down) => [-step, 0, step].map((across) => [across, down])));
  for (let pixel = 0; pixel < depths.length; pixel++) {
    const depth = depths[pixel];
    if (depth === BEHIND) continue;
    const [x, y] = [pixel % side, Math.floor(pixel / side)];
    let nearer = 0;
    for (const [across, down] of ways) {
      const [column, row] = [x + across, y + down];
      if (column < 0 || row < 0 || column >= side || row >= side) continue;
      nearer += Math.min(DEEPEST, Math.max(0, depths[row * side + column] - depth));
    }
    const light = Math.exp((-SHADE / (8 * steps.length)) * nearer);
    for (let channel = 0; channel < 3; channel++) image[3 * pixel + channel] *= light;
  }
}
