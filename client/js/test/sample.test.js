// Functions drawn in Node, beside the points of a running service: HOF_URL is its address, PHOTO a file.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { test } from "node:test";

import { canonicalPoints, Client, measureFrame, sample, sampleColors } from "hof-client";

const TOLERANCE = 1e-4; // longest sides of the object

const hof = new Client(process.env.HOF_URL);
const object = await hof.encode(new Blob([await readFile(process.env.PHOTO)]));
const functions = await hof.functions(object.id);

function assertClose(actual, expected, tolerance = TOLERANCE) {
  assert.equal(actual.length, expected.length);
  const farthest = actual.reduce((most, value, at) => Math.max(most, Math.abs(value - expected[at])), 0);
  assert.ok(farthest <= tolerance, `${farthest} apart`);
}

for (const seed of [0, 7, 2 ** 53 - 1]) {
  test(`points of seed ${seed} are those of the service`, async () => {
    assertClose(sample(functions, 20_001, { seed }), await hof.points(object.id, { n: 20_001, seed }));
  });
}

test("points from an offset on, and larger ones, are those of the service", async () => {
  const query = { n: 1001, offset: 2 ** 33 + 1, scale: 0.5 };
  assertClose(sample(functions, 1001, query), await hof.points(object.id, query));
});

test("points of a word are those of the service", async () => {
  const other = await hof.call("POST /objects", { body: await hof.bytes("GET /objects/{id}/weights", { path: object }) });
  const word = await hof.call("POST /compose", { body: { objects: [object.id, other.id] } });
  assertClose(sample(await hof.functions(word.id), 2000), await hof.points(word.id, { n: 2000 }));
});

test("colors are those of the service", async () => {
  const query = { n: 2000, seed: 7, format: "json" };
  const { colors } = await (await hof.fetch("GET /objects/{id}/points", { path: object, query })).json();
  assertClose(sampleColors(functions, 2000, { seed: 7 }), colors.flat(), 1);
});

test("the box that is measured here is that of the service", () => {
  const { low, high } = measureFrame(functions);
  assertClose([...low, ...high], [...object.frame.low, ...object.frame.high], 1e-3);
  const unmeasured = { ...functions };
  delete unmeasured.frame;
  assertClose(sample(unmeasured, 1000), sample(functions, 1000), 1e-3);
});

test("numbers out of range are refused by name", () => {
  assert.throws(() => canonicalPoints("ball", 0), /n is 0/);
  assert.throws(() => canonicalPoints("ball", 1, -1), /seed is -1/);
  assert.throws(() => canonicalPoints("ball", 1, 2n ** 64n), /seed is 18446744073709551616/);
  assert.throws(() => canonicalPoints("ball", 1, 0, 0.5), /offset is 0.5/);
});
