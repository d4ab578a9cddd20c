// The functions of an object: its weights file (safetensors), read.
import { fetchBytes, filePath } from "../api.js";

/** Fetch the functions of an object: {spec, rows, colorSpec, colorRows, bytes}; rows are thetas (Float32Array). */
export async function fetchFunctions(object) {
  return readFunctions(await fetchBytes(filePath(object, "weights", { format: "safetensors" })));
}

/** Read a safetensors file of the service (ArrayBuffer). Of a word, there is a row for each step. */
export function readFunctions(bytes) {
  const headBytes = Number(new DataView(bytes).getBigUint64(0, true));
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 8, headBytes)));
  const rowsOf = (name) => {
    if (!(name in head)) return [];
    const { shape, data_offsets: [begin, end] } = head[name];
    const numbers = new Float32Array(bytes.slice(8 + headBytes + begin, 8 + headBytes + end));
    const size = shape.at(-1);
    return Array.from({ length: numbers.length / size }, (_, row) => numbers.subarray(row * size, (row + 1) * size));
  };
  const { spec, color_spec: colorSpec } = head.__metadata__;
  return {
    spec: JSON.parse(spec),
    rows: rowsOf("theta"),
    colorSpec: colorSpec && JSON.parse(colorSpec),
    colorRows: rowsOf("color"),
    bytes: bytes.byteLength,
  };
}

/** The form of an object, for ComputedPoints: the same theta k times, or a row for each step. */
export function formOf({ spec, rows, colorRows }, frame) {
  const word = Array.from({ length: spec.k }, (_, step) => {
    const row = rows.length > 1 ? step : 0;
    return [row, row, 0];
  });
  return { word, frame, colorShares: colorRows.map(() => 1 / colorRows.length) };
}
