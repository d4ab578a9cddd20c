// A small picture of a cloud on a 2D canvas: orthographic, near points over far ones, shaded by depth.
import { colours } from "./colours.js";

const AZIMUTH = (30 * Math.PI) / 180;
const ELEVATION = (20 * Math.PI) / 180;
const EXTENT = 1.35; // of the object frame, from edge to edge

/** Draw points: x, y, z of each, flat. */
export function drawThumbnail(canvas, points) {
  const context = canvas.getContext("2d");
  const side = canvas.width;
  const scale = side / EXTENT;
  const seen = project(points).sort((a, b) => a.depth - b.depth);
  const { near, far } = colours();
  const size = side / 110;
  context.clearRect(0, 0, side, side);
  for (const { x, y, depth } of seen) {
    const share = Math.min(1, Math.max(0, depth + 0.5)); // 1 is nearest
    const colour = far.map((channel, index) => Math.round(channel + (near[index] - channel) * share));
    context.fillStyle = `rgb(${colour})`;
    context.fillRect(side / 2 + x * scale - size / 2, side / 2 - y * scale - size / 2, size, size);
  }
}

function project(points) {
  const [sinA, cosA, sinE, cosE] = [Math.sin(AZIMUTH), Math.cos(AZIMUTH), Math.sin(ELEVATION), Math.cos(ELEVATION)];
  return Array.from({ length: points.length / 3 }, (_, index) => {
    const [x, y, z] = points.subarray(3 * index, 3 * index + 3);
    const ahead = x * sinA + z * cosA;
    return { x: x * cosA - z * sinA, y: y * cosE - ahead * sinE, depth: ahead * cosE + y * sinE };
  });
}
