// A picture of an object for its card: its points as discs, far to near, from the right and above.
import { sample, sampleColors } from "hof-client";

const POINTS = 6000;
const EXTENT = 1.8; // width of the picture, longest sides
const DISC = 1.1; // radius of a point: this / sqrt(points) of the picture
const AZIMUTH = Math.PI / 6;
const ELEVATION = Math.PI / 9;

/** Draw a picture of `size` pixels with a transparent background; returns a Blob (PNG). */
export async function pictureOf(functions, size) {
  const canvas = Object.assign(document.createElement("canvas"), { width: size, height: size });
  const context = canvas.getContext("2d");
  const places = seen(sample(functions, POINTS));
  const colors = sampleColors(functions, POINTS);
  const order = Array.from({ length: POINTS }, (_, point) => point).sort((a, b) => places[a].near - places[b].near);
  for (const point of order) {
    const { x, y, near } = places[point];
    const light = 0.6 + 0.4 * Math.min(1, Math.max(0, near + 0.5));
    const channels = colors ? [...colors.subarray(3 * point, 3 * point + 3)] : [150, 160, 175];
    context.fillStyle = `rgb(${channels.map((channel) => Math.round(light * channel)).join()})`;
    context.beginPath();
    context.arc(size / 2 + (x * size) / EXTENT, size / 2 - (y * size) / EXTENT, (DISC * size) / POINTS ** 0.5, 0, 7);
    context.fill();
  }
  return new Promise((done) => canvas.toBlob(done));
}

/** Where points lie in the picture: to the right, up, and toward the camera. */
function seen(points) {
  const [sin, cos, rise, run] = [AZIMUTH, ELEVATION].flatMap((angle) => [Math.sin(angle), Math.cos(angle)]);
  return Array.from({ length: points.length / 3 }, (_, point) => {
    const [x, y, z] = points.subarray(3 * point, 3 * point + 3);
    const front = x * sin + z * cos;
    return { x: x * cos - z * sin, y: y * run - front * rise, near: front * run + y * rise };
  });
}
