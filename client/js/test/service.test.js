// Calls of a running service: HOF_URL is its address, PHOTO a file.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { test } from "node:test";

import { Client, Problem } from "hof-client";

const hof = new Client(process.env.HOF_URL);
const photo = new Blob([await readFile(process.env.PHOTO)]);

test("encode of a photo gives an object that get, list, label and delete know", async () => {
  const { id, image } = await hof.encode(photo);
  assert.equal(image.width > 0, true);
  assert.equal((await hof.call("GET /objects/{id}", { path: { id } })).id, id);
  const form = new FormData();
  form.append("image", photo);
  assert.equal((await hof.call("POST /encode", { body: form })).id, id);
  const { items } = await hof.call("GET /objects", { query: { limit: 1 } });
  assert.deepEqual(items.map((each) => each.id), [id]);
  const labeled = await hof.call("PATCH /objects/{id}", { path: { id }, body: { label: "Disc" } });
  assert.equal(labeled.label, "Disc");
  assert.equal(await hof.call("DELETE /objects/{id}", { path: { id } }), undefined);
  await assert.rejects(hof.call("GET /objects/{id}", { path: { id } }), { type: "urn:hof:problem:not-found" });
});

test("points fill one array, and each part of it is passed on once", async () => {
  const { id } = await hof.encode(photo);
  const parts = [];
  const take = (part, offset) => parts.push([offset, part.length / 3]);
  const points = await hof.points(id, { n: 200_000, seed: 7 }, { take });
  assert.equal(points.length, 600_000);
  let next = 0;
  for (const [offset, count] of parts) {
    assert.equal(offset, next);
    next += count;
  }
  assert.equal(next, 200_000);
  assert.ok(parts.length > 1);
  const { points: expected } = await (
    await hof.fetch("GET /objects/{id}/points", { path: { id }, query: { n: 5, seed: 7, format: "json" } })
  ).json();
  assert.deepEqual([...points.subarray(0, 15)], expected.flat().map(Math.fround));
});

test("weights are read, and imported again", async () => {
  const { id, spec, frame } = await hof.encode(photo);
  const functions = await hof.functions(id);
  assert.deepEqual(functions.spec, spec);
  assert.deepEqual(functions.frame, frame);
  const bytes = await hof.bytes("GET /objects/{id}/weights", { path: { id } });
  assert.equal(functions.bytes, bytes.byteLength);
  const imported = await hof.call("POST /objects", { body: bytes });
  assert.equal(imported.kind, "imported");
  const word = await hof.call("POST /compose", { body: { objects: [id, imported.id] } });
  assert.equal((await hof.functions(word.id)).rows.length, spec.k);
});

test("a refusal is a Problem with its type and its parameters", async () => {
  const { id } = await hof.encode(photo);
  const error = await hof.points(id, { n: 0 }).catch((error) => error);
  assert.ok(error instanceof Problem);
  assert.equal(error.type, "urn:hof:problem:invalid-parameter");
  assert.equal(error.status, 422);
  assert.deepEqual(error.errors.map(({ field }) => field), ["n"]);
  assert.match(error.message, /^422 Invalid parameter: n/);
  assert.notEqual(error.requestId, "");
  await assert.rejects(hof.encode(new Blob(["x"])), { type: "urn:hof:problem:unsupported-media-type" });
});
