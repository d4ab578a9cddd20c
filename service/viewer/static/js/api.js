// Calls to the service. A failed call throws a Problem with the title and detail that the service sent. Paths are
// relative to the page, so that it works under the prefix of a proxy.

import { askForKey, authorization } from "./key.js";
import { notify } from "./notice.js";
import { filePath } from "./objects.js";
import { text } from "./text.js";

const BUSY = [429, 503];
const TRIES = 6; // of a call that the service is too busy for
const MAX_WAIT_S = 60;

export const HAS_ADDRESSES = true; // of files, which other apps can fetch

const PCD_HEAD_ENDS = "DATA binary\n";

/** An error answer of the service (RFC 9457); `isBusy`: the service was too busy, however often it was tried. */
export class Problem extends Error {
  constructor(title, detail) {
    super(detail);
    this.title = title;
  }
}

/** `isQuiet`: the visitor is not told that the service is busy. */
async function call(path, { isQuiet, ...options } = {}) {
  for (let tries = 1; ; tries++) {
    const answer = await send(path, options);
    if (answer.ok) return answer;
    if (!BUSY.includes(answer.status) || tries === TRIES) throw await problemOf(answer);
    await wait(answer.headers.get("Retry-After"), options.signal, isQuiet);
  }
}

/** Wait as long as a busy service asks for, and tell the visitor. Throws AbortError if the call is aborted. */
async function wait(retryAfter, signal, isQuiet) {
  const seconds = Math.min(MAX_WAIT_S, Math.max(1, Number(retryAfter) || 1));
  const hide = isQuiet ? () => {} : notify(text("busy", { seconds }));
  try {
    await new Promise((done, failed) => {
      setTimeout(done, 1000 * seconds);
      signal?.addEventListener("abort", () => failed(signal.reason), { once: true });
    });
  } finally {
    hide();
  }
}

async function problemOf(answer) {
  const isProblem = answer.headers.get("Content-Type")?.startsWith("application/problem+json");
  const { title, detail } = isProblem
    ? await answer.json()
    : { title: text("error", { status: answer.status }), detail: answer.statusText };
  return Object.assign(new Problem(title, detail), { isBusy: BUSY.includes(answer.status) });
}

/** Send a call, with a key if one is needed; return its answer, whatever its status. */
async function send(path, options) {
  const credentials = authorization();
  let answer;
  try {
    answer = await fetch(path, { ...options, headers: { ...options.headers, ...credentials } });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Problem(text("noAnswer"), text("unreachable"));
  }
  const keyIsNew = credentials.Authorization !== authorization().Authorization; // entered during this call
  if (answer.status === 401 && (keyIsNew || (await askForKey("Authorization" in credentials)))) return send(path, options);
  return answer;
}

/** Fetch the loaded models, the default one first. */
export async function listModels() {
  return (await (await call("models")).json()).models;
}

/** The path that encodes a photo or scan; `query` has what differs from the service's defaults. */
export function encodePath(query) {
  const parameters = new URLSearchParams(query);
  return parameters.size ? `encode?${parameters}` : "encode";
}

/** Encode a photo (File) and return the stored object. */
export function encode(photo, query, signal) {
  return post(encodePath(query), "image", photo, signal);
}

/** Complete a scan or mesh (File) and return the stored object. */
export function complete(scan, signal) {
  return post(encodePath(), "points", scan, signal);
}

/** Send a form with a file in it, and return the answer's object. */
async function post(path, field, file, signal) {
  const form = new FormData();
  form.append(field, file);
  return (await call(path, { method: "POST", body: form, signal })).json();
}

/** Whether pages of other sites may show an object of this service in a frame. */
export async function isEmbeddable() {
  const policy = (await call("embed", { method: "HEAD" })).headers.get("Content-Security-Policy");
  return policy !== null && !policy.includes("frame-ancestors 'none'"); // a proxy that drops the policy tells nothing
}

/** Fetch one object by its id. */
export async function fetchObject(id) {
  return (await call(`objects/${encodeURIComponent(id)}`)).json();
}

/** Give an object another label, or none (""). Returns the object. */
export async function relabel(id, label) {
  const headers = { "Content-Type": "application/json" };
  return (await call(`objects/${id}`, { method: "PATCH", headers, body: JSON.stringify({ label }) })).json();
}

/** Delete an object. `last`: the page is being closed. */
export async function deleteObject(id, last = false) {
  await call(`objects/${id}`, { method: "DELETE", keepalive: last });
}

/** Fetch a page of the stored objects, newest first: {items, next}. */
export async function listObjects(cursor, limit) {
  const query = new URLSearchParams(cursor ? { limit, cursor } : { limit });
  return (await call(`objects?${query}`)).json();
}

/** Post a body of `wordBody`; return the word's object. */
export async function compose(body) {
  const headers = { "Content-Type": "application/json" };
  return (await call("compose", { method: "POST", headers, body })).json();
}

/** Plan a path around an object; `body`: JSON of start, goal and clearance. Returns {path, length, straight, reason}. */
export async function planPath(id, body, signal) {
  const headers = { "Content-Type": "application/json" };
  return (await call(`objects/${id}/path`, { method: "POST", headers, body, signal })).json();
}

/** Fetch a file of the service: {blob, name}. `options`: {signal, isQuiet} of `call`. */
export async function fetchFile(path, options) {
  const answer = await call(path, options);
  const name = /filename="(.+)"/.exec(answer.headers.get("Content-Disposition"))?.[1] ?? path.split("/").at(-1);
  return { blob: await answer.blob(), name };
}

/** Fetch a picture of an object: the address of a blob. `options`: {signal, isQuiet} of `call`. */
export async function fetchPicture(object, size, options) {
  const { blob } = await fetchFile(filePath(object, "picture", { size, format: "webp" }), options);
  return URL.createObjectURL(blob);
}

/** Fetch the object as its photo shows it, if the object has that: the address of a blob. */
export async function fetchPhoto(object) {
  return URL.createObjectURL((await fetchFile(`objects/${object.id}/photo`, { isQuiet: true })).blob);
}

/** Fetch a path and return all its bytes (ArrayBuffer). */
export async function fetchBytes(path, signal) {
  return (await call(path, { signal })).arrayBuffer();
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
