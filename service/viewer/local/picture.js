// A picture of an object, as the service draws it (service/drawing/surface.py): its surface in soft light, over its shadow.
import { surfaceFor } from "./files.js";
import { rasterize, shadeEdges } from "./raster.js";

const EXTENT = 1.45; // width of the picture, longest sides
const AZIMUTH = Math.PI / 6;
const ELEVATION = (22 / 180) * Math.PI;
const SUPERSAMPLING = 2;
const [NEAR, FAR] = [[96, 134, 188], [176, 196, 222]]; // of objects without color
const KEY_LIGHT = [-0.4, 0.6, 0.8].map((part) => part / Math.sqrt(1.16)); // right, up, toward the camera
const SHINE_LIGHT = [-0.3, 0.5, 1.3].map((part) => part / Math.sqrt(2.03));
const SHADOW = 0.3; // how dark the ground is under the object's middle
const SPREAD = 1.7; // side of the shadow, relative to the object's
const BELOW = 0.005; // from the object's lowest point down to the ground

const [SIN, COS, RISE, RUN] = [AZIMUTH, ELEVATION].flatMap((angle) => [Math.sin(angle), Math.cos(angle)]);
const AXES = [ // right, up, toward the camera
  [COS, 0, -SIN],
  [-SIN * RISE, RUN, -COS * RISE],
  [SIN * RUN, RISE, COS * RUN],
];

/** Draw a picture of `size` pixels over white; returns a Blob (PNG). */
export async function pictureOf(functions, size) {
  const surface = surfaceFor(functions);
  const side = SUPERSAMPLING * size;
  const places = viewed(surface.vertices);
  const image = groundOf(surface.vertices, side);
  const colors = litColors(surface, places);
  for (let at = 0; at < places.length; at += 3) {
    places[at] = (places[at] * side) / EXTENT + (side - 1) / 2;
    places[at + 1] = (-places[at + 1] * side) / EXTENT + (side - 1) / 2;
  }
  const depths = rasterize(image, side, places, colors, surface.triangles);
  shadeEdges(image, side, depths);
  return fileOf(image, side, size);
}

/** Turn vectors (n, 3) into the camera's frame: right, up, toward it. */
function viewed(vectors) {
  const result = new Float32Array(vectors.length);
  for (let at = 0; at < vectors.length; at += 3) {
    const vector = vectors.subarray(at, at + 3);
    AXES.forEach((axis, index) => (result[at + index] = dot(axis, vector)));
  }
  return result;
}

function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/** The color of each vertex in the light, (v, 3), from 0 to 255; both sides of a surface are lit. */
function litColors({ normals, colors }, places) {
  const turned = viewed(normals);
  const result = new Float32Array(normals.length);
  for (let at = 0; at < result.length; at += 3) {
    const normal = turned.subarray(at, at + 3).map((part, _, { 2: toward }) => (toward < 0 ? -part : part));
    const light = 0.5 + 0.18 * normal[1] + 0.42 * Math.max(0, dot(normal, KEY_LIGHT));
    const shine = 0.07 * Math.max(0, dot(normal, SHINE_LIGHT)) ** 12; // shows what is black, too
    const shade = 0.6 * Math.min(1, Math.max(0, 0.5 - places[at + 2]));
    for (let channel = 0; channel < 3; channel++) {
      result[at + channel] = colors
        ? 255 * Math.min(1, encoded(1.15 * light * linear(colors[at + channel] / 255)) + shine)
        : light * (NEAR[channel] + (FAR[channel] - NEAR[channel]) * shade);
    }
  }
  return result;
}

/** sRGB, 0 to 1, as a linear value (IEC 61966-2-1). */
function linear(level) {
  return level <= 0.04045 ? level / 12.92 : ((level + 0.055) / 1.055) ** 2.4;
}

function encoded(value) {
  return value < 0.0031308 ? 12.92 * value : 1.055 * value ** (1 / 2.4) - 0.055;
}

/** The ground, white, with a soft shadow under the object: three numbers a pixel. */
function groundOf(vertices, side) {
  const image = new Float32Array(3 * side * side);
  const [low, high] = boundsOf(vertices);
  const [right, up, toward] = AXES;
  const reach = [0, 1, 2].map((axis) => (SPREAD / 2) * Math.max(high[axis] - low[axis], 0.2));
  for (let pixel = 0; pixel < side * side; pixel++) {
    const across = ((pixel % side) - (side - 1) / 2) * (EXTENT / side);
    const above = ((side - 1) / 2 - Math.floor(pixel / side)) * (EXTENT / side);
    const along = (low[1] - BELOW - above * up[1]) / toward[1]; // from the picture's plane to the ground
    const [x, z] = [0, 2].map((axis) => {
      const place = across * right[axis] + above * up[axis] + along * toward[axis];
      return (place - (low[axis] + high[axis]) / 2) / reach[axis];
    });
    const share = Math.min(1, Math.max(0, (1 - Math.hypot(x, z)) / 0.9));
    const fade = share * share * (3 - 2 * share);
    image.fill(255 * (1 - SHADOW * fade * fade), 3 * pixel, 3 * pixel + 3);
  }
  return image;
}

function boundsOf(vertices) {
  const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
  vertices.forEach((value, at) => {
    low[at % 3] = Math.min(low[at % 3], value);
    high[at % 3] = Math.max(high[at % 3], value);
  });
  return [low, high];
}

/** Write an image of side^2 pixels as a PNG of size^2. */
function fileOf(image, side, size) {
  const pixels = new ImageData(size, size);
  pixels.data.fill(255);
  const sums = new Float32Array(3 * size * size);
  for (let at = 0; at < image.length; at++) {
    const pixel = Math.floor(at / 3);
    const [x, y] = [pixel % side, Math.floor(pixel / side)].map((place) => Math.floor(place / SUPERSAMPLING));
    sums[3 * (y * size + x) + (at % 3)] += image[at] / SUPERSAMPLING ** 2;
  }
  sums.forEach((value, at) => (pixels.data[4 * Math.floor(at / 3) + (at % 3)] = value)); // rounds
  const canvas = Object.assign(document.createElement("canvas"), { width: size, height: size });
  canvas.getContext("2d").putImageData(pixels, 0, 0);
  return new Promise((done) => canvas.toBlob(done));
}
