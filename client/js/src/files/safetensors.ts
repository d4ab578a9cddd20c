// The weights file of functions, as the service writes it (service/formats/weights.py).

import type { Functions, Spec } from "../function/weights.js";

/** Write functions as a safetensors file. `word`: ids of the objects of a composed object's rows. */
export function writeFunctions(functions: Functions, model: string, word: readonly string[] = []): Uint8Array<ArrayBuffer> {
  const { spec, rows, colorSpec, colorRows, frame } = functions;
  const metadata = {
    format: word.length ? "hof-word-1" : "hof-theta-1",
    model,
    spec: sorted(spec),
    ...(frame && { frame: JSON.stringify({ low: frame.low, high: frame.high }) }),
    ...(word.length && { word: `["${word.join('", "')}"]` }),
    ...(colorSpec && { color_spec: sorted(colorSpec) }),
  };
  const tensors: [string, readonly Float32Array[]][] = [["theta", rows]];
  if (colorSpec) tensors.push(["color", colorRows]);
  const head: Record<string, object> = { __metadata__: metadata };
  let end = 0;
  for (const [name, thetas] of tensors) {
    const size = thetas[0].length;
    const shape = word.length ? [thetas.length, size] : [size];
    const begin = end;
    end += 4 * size * thetas.length;
    head[name] = { dtype: "F32", shape, data_offsets: [begin, end] };
  }
  const json = new TextEncoder().encode(JSON.stringify(head));
  const padded = Math.ceil(json.length / 8) * 8; // tensors start at a multiple of 8 bytes
  const file = new Uint8Array(8 + padded + end).fill(0x20, 8, 8 + padded);
  new DataView(file.buffer).setBigUint64(0, BigInt(padded), true);
  file.set(json, 8);
  let at = 8 + padded;
  for (const theta of tensors.flatMap(([, thetas]) => thetas)) {
    file.set(new Uint8Array(theta.buffer, theta.byteOffset, theta.byteLength), at);
    at += theta.byteLength;
  }
  return file;
}

function sorted(spec: Spec): string {
  return JSON.stringify(Object.fromEntries(Object.entries(spec).sort(([a], [b]) => (a < b ? -1 : 1))));
}
