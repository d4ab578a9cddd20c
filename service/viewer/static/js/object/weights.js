// The functions of an object: its weights file, fetched.
import { fetchBytes } from "../api.js";
import { readFunctions } from "../function/weights.js";
import { filePath } from "../objects.js";

/** Fetch the functions of an object: {spec, rows, colorSpec, colorRows, bytes}; rows are thetas (Float32Array). */
export async function fetchFunctions(object) {
  return readFunctions(await fetchBytes(filePath(object, "weights", { format: "safetensors" })));
}
