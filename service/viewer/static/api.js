// The service's calls. What goes wrong is a Problem, with the title and detail that the service gave.

const BYTES_PER_POINT = 12; // three float32

/** An error as the service tells it (RFC 9457). */
export class Problem extends Error {
  constructor(title, detail) {
    super(detail);
    this.title = title;
  }
}

async function call(path, options) {
  let answer;
  try {
    answer = await fetch(path, options);
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Problem("No answer", "The service cannot be reached.");
  }
  if (answer.ok) return answer;
  const told = answer.headers.get("Content-Type")?.startsWith("application/problem+json");
  const problem = told ? await answer.json() : { title: `Error ${answer.status}`, detail: answer.statusText };
  throw new Problem(problem.title, problem.detail);
}

/** A photo (File) becomes an object, stored. */
export async function encode(photo) {
  const form = new FormData();
  form.append("image", photo);
  return (await call("/encode", { method: "POST", body: form })).json();
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

/** Where points of an object are. */
export function pointsPath(object, query) {
  return `${object.links.points}?${new URLSearchParams(query)}`;
}

/** Fetch points, float32, and hand on their bytes (Uint8Array) as they arrive. */
export async function streamPoints(object, query, signal, take) {
  const answer = await call(pointsPath(object, { ...query, format: "f32" }), { signal });
  const reader = answer.body.getReader();
  for (;;) {
    const { done, value } = await reader.read();
    if (done || signal?.aborted) return;
    take(value);
  }
}

/** Fetch points, float32, at once: x, y, z of each, flat. */
export async function fetchPoints(object, query) {
  return new Float32Array(await fetchBytes(pointsPath(object, { ...query, format: "f32" })));
}

export { BYTES_PER_POINT };
