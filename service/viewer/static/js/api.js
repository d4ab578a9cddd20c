// Calls to the service. A failed call throws a Problem with the title and detail that the service sent. Paths are
// relative to the page, so that it works under the prefix of a proxy.

import { askForKey, authorization } from "./key.js";

const BYTES_PER_POINT = 12; // three float32
const BYTES_PER_COLORED_POINT = 16; // three float32, then blue, green, red, 0
const PCD_HEAD_ENDS = "DATA binary\n";

/** An error answer of the service (RFC 9457). */
export class Problem extends Error {
  constructor(title, detail) {
    super(detail);
    this.title = title;
  }
}

async function call(path, options = {}) {
  const credentials = authorization();
  let answer;
  try {
    answer = await fetch(path, { ...options, headers: { ...options.headers, ...credentials } });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Problem("No answer", "The service cannot be reached.");
  }
  if (answer.ok) return answer;
  const keyIsNew = credentials.Authorization !== authorization().Authorization; // entered during this call
  if (answer.status === 401 && (keyIsNew || (await askForKey("Authorization" in credentials)))) return call(path, options);
  const isProblem = answer.headers.get("Content-Type")?.startsWith("application/problem+json");
  const problem = isProblem ? await answer.json() : { title: `Error ${answer.status}`, detail: answer.statusText };
  throw new Problem(problem.title, problem.detail);
}

/** Fetch the loaded models, the default one first. */
export async function listModels() {
  return (await (await call("models")).json()).models;
}

/** The path that encodes a photo; an empty model means the default one. */
export function encodePath(model) {
  return model ? `encode?${new URLSearchParams({ model })}` : "encode";
}

/** Encode a photo (File) and return the stored object. */
export async function encode(photo, model) {
  const form = new FormData();
  form.append("image", photo);
  return (await call(encodePath(model), { method: "POST", body: form })).json();
}

/** Fetch a page of the stored objects, newest first: {items, next}. */
export async function listObjects(cursor, limit) {
  const query = new URLSearchParams(cursor ? { limit, cursor } : { limit });
  return (await call(`objects?${query}`)).json();
}

/** The request body for all words over two objects. */
export function allWords(first, second) {
  return JSON.stringify({ objects: [first.id, second.id], mode: "all" });
}

/** Post a body of `allWords`; return the words' objects in lexicographic order. */
export async function compose(body) {
  const headers = { "Content-Type": "application/json" };
  return (await (await call("compose", { method: "POST", headers, body })).json()).objects;
}

/** Fetch a file of the service: {blob, name}. */
export async function fetchFile(path) {
  const answer = await call(path);
  const name = /filename="(.+)"/.exec(answer.headers.get("Content-Disposition"))?.[1] ?? path.split("/").at(-1);
  return { blob: await answer.blob(), name };
}

/** Fetch a path and return all its bytes (ArrayBuffer). */
export async function fetchBytes(path, signal) {
  return (await call(path, { signal })).arrayBuffer();
}

/** The path of an object's file; `of` is `points`, `mesh` or `weights`. */
export function filePath(object, of, query) {
  return `objects/${object.id}/${of}?${new URLSearchParams(query)}`;
}

/** Bytes of one point of the object in a stream. */
export function bytesPerPoint(object) {
  return object.color ? BYTES_PER_COLORED_POINT : BYTES_PER_POINT;
}

/** Fetch points, colored if the object is, and pass their bytes (Uint8Array) to `take` as they arrive. */
export async function streamPoints(object, query, signal, take) {
  const format = object.color ? "pcd" : "f32"; // PCD is the colored format whose points are whole 32-bit words
  const answer = await call(filePath(object, "points", { ...query, format }), { signal });
  const reader = answer.body.getReader();
  let head = object.color ? "" : null; // null after the header, and where there is none
  for (;;) {
    const { done, value } = await reader.read();
    if (done || signal?.aborted) return;
    if (head === null) take(value);
    else {
      const before = head.length;
      head += String.fromCharCode(...value.subarray(0, 512)); // the header is shorter
      const end = head.indexOf(PCD_HEAD_ENDS);
      if (end < 0) continue;
      take(value.subarray(end + PCD_HEAD_ENDS.length - before));
      head = null;
    }
  }
}

/** Fetch points and return all their bytes (Uint8Array). */
export async function fetchPoints(object, query) {
  const bytes = new Uint8Array(query.n * bytesPerPoint(object));
  let filled = 0;
  await streamPoints(object, query, undefined, (part) => {
    bytes.set(part, filled);
    filled += part.length;
  });
  return bytes;
}
