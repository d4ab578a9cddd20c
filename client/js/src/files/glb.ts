// Binary glTF 2.0 of surfaces and points. glTF's frame is the object frame: right-handed, +Y up, front +Z.

import type { Surface } from "../sampling/surface.js";

type Numbers = Float32Array | Uint32Array;

interface Attribute {
  array: Numbers;
  type: "SCALAR" | "VEC3";
  target: number;
}

const [FLOAT, UINT, ARRAY, ELEMENTS] = [5126, 5125, 34962, 34963];
const [POINTS, TRIANGLES] = [0, 4];
const WHITE = [1, 1, 1, 1]; // keeps the colors of vertices
const [GRAY_SURFACE, GRAY_POINTS] = [
  [0.5, 0.5, 0.53, 1],
  [0.18, 0.18, 0.2, 1],
];

/** Write a surface as GLB, with its normals and colors. */
export function surfaceGlb({ vertices, normals, triangles, colors }: Surface): Uint8Array<ArrayBuffer> {
  const attributes = { POSITION: vec3(vertices), NORMAL: vec3(normals), ...(colors && { COLOR_0: vec3(linear(colors)) }) };
  const material = { pbrMetallicRoughness: base(colors ? WHITE : GRAY_SURFACE), doubleSided: true };
  const indices: Attribute = { array: triangles, type: "SCALAR", target: ELEMENTS };
  return glb({ ...attributes, indices }, TRIANGLES, { materials: [material] });
}

/** Write points, (n, 3), as GLB, with their colors. */
export function pointsGlb(points: Float32Array, colors?: Uint8Array): Uint8Array<ArrayBuffer> {
  const attributes = { POSITION: vec3(points), ...(colors && { COLOR_0: vec3(linear(colors)) }) };
  const unlit = "KHR_materials_unlit";
  const material = { pbrMetallicRoughness: base(colors ? WHITE : GRAY_POINTS), extensions: { [unlit]: {} } };
  return glb(attributes, POINTS, { extensionsUsed: [unlit], materials: [material] });
}

function vec3(array: Float32Array): Attribute {
  return { array, type: "VEC3", target: ARRAY };
}

function base(baseColorFactor: number[]): object {
  return { baseColorFactor, metallicFactor: 0, roughnessFactor: 1 };
}

/** Convert sRGB levels to linear light in [0, 1]. */
function linear(colors: Uint8Array): Float32Array {
  return Float32Array.from(colors, (value) => {
    const level = value / 255;
    return level <= 0.04045 ? level / 12.92 : ((level + 0.055) / 1.055) ** 2.4;
  });
}

function glb(parts: Record<string, Attribute>, mode: number, more: object): Uint8Array<ArrayBuffer> {
  const names = Object.keys(parts);
  const arrays = Object.values(parts);
  const at = (name: string) => names.indexOf(name);
  const attributes = Object.fromEntries(names.filter((name) => name !== "indices").map((name) => [name, at(name)]));
  const indices = names.includes("indices") ? { indices: at("indices") } : {};
  const starts = arrays.map((_, index) => arrays.slice(0, index).reduce((sum, { array }) => sum + array.byteLength, 0));
  const byteLength = arrays.reduce((sum, { array }) => sum + array.byteLength, 0);
  const document = {
    asset: { version: "2.0", generator: "hof" },
    scene: 0,
    scenes: [{ nodes: [0] }],
    nodes: [{ mesh: 0 }],
    meshes: [{ primitives: [{ attributes, ...indices, material: 0, mode }] }],
    ...more,
    accessors: arrays.map(({ array, type }, view) => ({
      bufferView: view,
      componentType: array instanceof Uint32Array ? UINT : FLOAT,
      count: array.length / (type === "VEC3" ? 3 : 1),
      type,
      ...(names[view] === "POSITION" && boundsOf(array)),
    })),
    bufferViews: arrays.map(({ array, target }, view) => ({
      buffer: 0,
      byteOffset: starts[view],
      byteLength: array.byteLength,
      target,
    })),
    buffers: [{ byteLength }],
  };
  return container(document, arrays, byteLength);
}

function boundsOf(array: Numbers): { min: number[]; max: number[] } {
  const [min, max] = [Array(3).fill(Infinity), Array(3).fill(-Infinity)];
  array.forEach((value, at) => {
    min[at % 3] = Math.min(min[at % 3], value);
    max[at % 3] = Math.max(max[at % 3], value);
  });
  return { min, max };
}

/** The file: a header, a chunk of JSON, and a chunk of numbers. */
function container(document: object, arrays: Attribute[], byteLength: number): Uint8Array<ArrayBuffer> {
  const json = new TextEncoder().encode(JSON.stringify(document));
  const padded = Math.ceil(json.length / 4) * 4;
  const file = new Uint8Array(28 + padded + byteLength).fill(0x20, 20, 20 + padded);
  const view = new DataView(file.buffer);
  [0x46546c67, 2, file.length, padded, 0x4e4f534a].forEach((word, index) => view.setUint32(4 * index, word, true));
  file.set(json, 20);
  [byteLength, 0x004e4942].forEach((word, index) => view.setUint32(20 + padded + 4 * index, word, true));
  let at = 28 + padded;
  for (const { array } of arrays) {
    file.set(new Uint8Array(array.buffer, array.byteOffset, array.byteLength), at);
    at += array.byteLength;
  }
  return file;
}
