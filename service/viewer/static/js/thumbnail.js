// A small picture of a cloud on a 2D canvas: orthographic, far points first, in color or shaded by depth.
import { bytesPerPoint } from "./api.js";
import { colors } from "./stage/colors.js";

const AZIMUTH = (30 * Math.PI) / 180;
const ELEVATION = (20 * Math.PI) / 180;
const EXTENT = 1.35; // side of the picture, in units of the object frame

/** Draw an object's points, given as bytes (Uint8Array). */
export function drawThumbnail(canvas, object, points) {
  const context = canvas.getContext("2d");
  const side = canvas.width;
  const scale = side / EXTENT;
  const projected = project(points, bytesPerPoint(object)).sort((a, b) => a.depth - b.depth);
  const { near, far } = colors();
  const size = side / 110;
  context.clearRect(0, 0, side, side);
  for (const { x, y, depth, start } of projected) {
    const share = Math.min(1, Math.max(0, depth + 0.5)); // 1: nearest
    const shade = far.map((channel, index) => Math.round(channel + (near[index] - channel) * share));
    context.fillStyle = `rgb(${object.color ? points.slice(start + 12, start + 15).reverse() : shade})`;
    context.fillRect(side / 2 + x * scale - size / 2, side / 2 - y * scale - size / 2, size, size);
  }
}

function project(bytes, size) {
  const [sinA, cosA, sinE, cosE] = [Math.sin(AZIMUTH), Math.cos(AZIMUTH), Math.sin(ELEVATION), Math.cos(ELEVATION)];
  return Array.from({ length: bytes.length / size }, (_, index) => {
    const start = size * index;
    const [x, y, z] = new Float32Array(bytes.buffer, start, 3);
    const ahead = x * sinA + z * cosA;
    return { x: x * cosA - z * sinA, y: y * cosE - ahead * sinE, depth: ahead * cosE + y * sinE, start };
  });
}
