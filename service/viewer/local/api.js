// The page's API without a service: the same exports as js/api.js, which the import map of the static page replaces by
// this module. Photos are encoded and objects are drawn here; objects are kept until the tab is closed.

import { decode, Encoder, Matting, NoObjectFound } from "hof-client/encoder";

import { fileOf } from "./files.js";
import { pictureOf } from "./picture.js";
import { Store } from "./store.js";
import { points } from "./points.js";

export const HAS_ADDRESSES = false; // files are written here: other apps cannot fetch them

const MODEL = "hof1-k2";
const MATTE = "hof-matte";
const FORMATS = { mesh: ["glb"], points: ["ply", "glb", "f32"], weights: ["safetensors"] }; // that files.js writes

const store = new Store();
let encoder; // a promise, once a photo was given
let matting; // a promise, once a photo needed it

/** An error with a title, as a service answers it. */
export class Problem extends Error {
  constructor(title, detail) {
    super(detail);
    this.title = title;
  }
}

/** There is one model, so the page offers none. */
export async function listModels() {
  return [];
}

/** The page shows this path in a curl line, which the static page hides. */
export function encodePath() {
  return "encode";
}

/** Encode a photo (File) and return the object. */
export async function encode(photo, { background } = {}, signal) {
  encoder ??= openEncoder();
  encoder.catch(() => (encoder = undefined)); // another photo tries again
  const [opened, pixels] = await Promise.all([encoder, decoded(photo)]);
  signal?.throwIfAborted();
  try {
    const encoded = await opened.encode(pixels, background, matteOf);
    signal?.throwIfAborted();
    return store.add(encoded, opened.metadata.name);
  } catch (error) {
    if (error instanceof NoObjectFound) throw new Problem("No object found", error.message);
    throw error;
  }
}

/** Scans are completed by a service: the page has no model of points. */
export async function complete() {
  throw new Problem("Unsupported media type", "scans and meshes are completed by a service");
}

async function openEncoder() {
  return Encoder.open(await fetchModel(MODEL));
}

/** Tell the object of a photo from a background that is neither transparent nor plain. */
async function matteOf(pixels) {
  matting ??= fetchModel(MATTE).then((model) => Matting.open(model));
  matting.catch(() => (matting = undefined)); // another photo tries again
  return (await matting).matteOf(pixels);
}

async function fetchModel(name) {
  const answer = await fetch(new URL(`../models/${name}.onnx`, import.meta.url));
  if (!answer.ok) throw new Problem("No model", `the web server answered ${answer.status} for the model's file`);
  return new Uint8Array(await answer.arrayBuffer());
}

async function decoded(photo) {
  try {
    return await decode(photo);
  } catch {
    throw new Problem("Unsupported media type", "this browser cannot read the file as an image");
  }
}

/** Objects are kept in this tab alone, so no other page can show them. */
export async function isEmbeddable() {
  return false;
}

/** Return one object by its id. */
export async function fetchObject(id) {
  return entryOf(id).object;
}

/** Give an object another label, or none (""). Returns the object. */
export async function relabel(id, label) {
  return store.relabel(id, label);
}

/** Delete an object. */
export async function deleteObject(id) {
  store.delete(id);
}

/** Return all objects, newest first: {items, next}. */
export async function listObjects() {
  return { items: store.list(), next: null };
}

/** Make the object of a word. */
export async function compose(body) {
  return store.compose(JSON.parse(body).objects);
}

/** Paths are planned by a service; the static page hides what asks for one. */
export async function planPath() {
  throw new Problem("Not found", "paths are planned by a service");
}

/** Write the file of a path: {blob, name}. */
export async function fetchFile(path) {
  const { id, of, query } = parsed(path);
  const file = fileOf(entryOf(id), of, query);
  return { blob: new Blob([file]), name: `${id}.${query.format}` };
}

/** Draw a picture of an object: the address of a blob. */
export async function fetchPicture(object, size) {
  return URL.createObjectURL(await pictureOf(entryOf(object.id).functions, size));
}

/** Photos are not kept, so no object has one. */
export async function fetchPhoto() {
  throw new Problem("Not found", "no photos are kept");
}

/** Write the file of a path and return all its bytes (ArrayBuffer). */
export async function fetchBytes(path, signal) {
  const { blob } = await fetchFile(path);
  signal?.throwIfAborted();
  return blob.arrayBuffer();
}

/** Compute points, colored if the object is, and pass their bytes (Uint8Array) to `take` part by part. */
export async function streamPoints(object, { n, seed, offset = 0 }, signal, take) {
  const { functions } = entryOf(object.id);
  const range = { n: Number(n), seed: BigInt(seed), offset: Number(offset) };
  for await (const part of points(functions, range)) {
    if (signal?.aborted) return;
    take(part);
  }
}

function entryOf(id) {
  const entry = store.get(id);
  if (!entry) throw new Problem("Not found", "this object is not in this tab: give its photo again");
  return entry;
}

function parsed(path) {
  const [, id, of, query] = /^objects\/(\w+)\/(\w+)\?(.*)$/.exec(path);
  return { id, of, query: Object.fromEntries(new URLSearchParams(query)) };
}

/** Leave out what needs a service, before the page starts: file formats, and the title of the list of objects. */
function adapt() {
  for (const group of document.querySelectorAll("#format optgroup")) {
    const formats = FORMATS[group.dataset.of] ?? [];
    for (const option of [...group.children]) if (!formats.includes(option.value)) option.remove();
    if (!group.children.length) group.remove();
  }
  document.getElementById("gallery-title").dataset.text = "galleryHere";
}

adapt();
