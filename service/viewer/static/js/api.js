// The service's calls. What goes wrong is a Problem, with the title and detail that the service gave.

import { askForKey, authorization } from "./key.js";

const BYTES_PER_POINT = 12; // three float32
const BYTES_PER_COLORED_POINT = 16; // and blue, green, red, 0
const PCD_HEAD_ENDS = "DATA binary\n";

/** An error as the service tells it (RFC 9457). */
export class Problem extends Error {
  constructor(title, detail) {
    super(detail);
    this.title = title;
  }
}

async function call(path, options = {}) {
  const sent = authorization();
  let answer;
  try {
    answer = await fetch(path, { ...options, headers: { ...options.headers, ...sent } });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Problem("No answer", "The service cannot be reached.");
  }
  if (answer.ok) return answer;
  const another = sent.Authorization !== authorization().Authorization; // given while this call was under way
  if (answer.status === 401 && (another || (await askForKey()))) return call(path, options);
  const told = answer.headers.get("Content-Type")?.startsWith("application/problem+json");
  const problem = told ? await answer.json() : { title: `Error ${answer.status}`, detail: answer.statusText };
  throw new Problem(problem.title, problem.detail);
}

/** The loaded models, the default one first. */
export async function listModels() {
  return (await (await call("/models")).json()).models;
}

/** Where a photo is sent; no model stands for the default one. */
export function encodePath(model) {
  return model ? `/encode?${new URLSearchParams({ model })}` : "/encode";
}

/** A photo (File) becomes an object, stored. */
export async function encode(photo, model) {
  const form = new FormData();
  form.append("image", photo);
  return (await call(encodePath(model), { method: "POST", body: form })).json();
}

/** A page of the stored objects, newest first: {items, next}. */
export async function listObjects(cursor, limit) {
  const query = new URLSearchParams(cursor ? { limit, cursor } : { limit });
  return (await call(`/objects?${query}`)).json();
}

/** The body that asks for all words over two objects. */
export function allWords(first, second) {
  return JSON.stringify({ objects: [first.id, second.id], mode: "all" });
}

/** What a body of `allWords` asks for, in lexicographic order. */
export async function compose(body) {
  const headers = { "Content-Type": "application/json" };
  return (await (await call("/compose", { method: "POST", headers, body })).json()).objects;
}

/** A file of the service: its content and its name. */
export async function fetchFile(path) {
  const answer = await call(path);
  const name = /filename="(.+)"/.exec(answer.headers.get("Content-Disposition"))?.[1] ?? path.split("/").at(-1);
  return { blob: await answer.blob(), name };
}

/** The bytes of a path, whole. */
export async function fetchBytes(path, signal) {
  return (await call(path, { signal })).arrayBuffer();
}

/** Where a file of an object is: of its `points`, its `mesh` or its `weights`. */
export function filePath(object, of, query) {
  return `${object.links[of]}?${new URLSearchParams(query)}`;
}

/** How many bytes a point of the object has as it arrives. */
export function bytesPerPoint(object) {
  return object.color ? BYTES_PER_COLORED_POINT : BYTES_PER_POINT;
}

/** Fetch points, with their colors if the object has any, and hand on their bytes (Uint8Array) as they arrive. */
export async function streamPoints(object, query, signal, take) {
  const format = object.color ? "pcd" : "f32"; // of those with colors the one whose points are whole words
  const answer = await call(filePath(object, "points", { ...query, format }), { signal });
  const reader = answer.body.getReader();
  let head = object.color ? "" : null; // none any more
  for (;;) {
    const { done, value } = await reader.read();
    if (done || signal?.aborted) return;
    if (head === null) take(value);
    else {
      const before = head.length;
      head += String.fromCharCode(...value.subarray(0, 512)); // a head is shorter
      const end = head.indexOf(PCD_HEAD_ENDS);
      if (end < 0) continue;
      take(value.subarray(end + PCD_HEAD_ENDS.length - before));
      head = null;
    }
  }
}

/** Fetch points at once: their bytes. */
export async function fetchPoints(object, query) {
  const bytes = new Uint8Array(query.n * bytesPerPoint(object));
  let filled = 0;
  await streamPoints(object, query, undefined, (part) => {
    bytes.set(part, filled);
    filled += part.length;
  });
  return bytes;
}
