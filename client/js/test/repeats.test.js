// Repeats and errors, against a server that answers as the test says.

import assert from "node:assert/strict";
import { createServer } from "node:http";
import { test } from "node:test";

import { Client, ConnectionFailed, HofError, UnexpectedAnswer } from "hof-client";

const LIVE = { status: "live" };
const BUSY = { type: "urn:hof:problem:overloaded", title: "Overloaded", status: 429, detail: "full", error: "full" };
const retry = { firstS: 0.01, longestS: 0.02 };

/** Run a server that gives one call after the other its answer, while `use` runs. Returns the times of the calls. */
async function scripted(answers, use) {
  const calls = [];
  const server = createServer((request, response) => {
    const answer = answers[calls.length];
    calls.push({ at: performance.now(), method: request.method });
    if (answer === undefined) return void request.socket.destroy();
    const { status = 200, type = "application/json", headers = {}, body } = answer;
    response.writeHead(status, { "Content-Type": type, Connection: "close", ...headers });
    if (answer.cut) response.write(body, () => request.socket.destroy());
    else response.end(typeof body === "string" ? body : JSON.stringify(body));
  });
  await new Promise((done) => server.listen(0, "127.0.0.1", done));
  try {
    await use(new Client(`http://127.0.0.1:${server.address().port}/`, { retry, apiKey: "secret" }));
  } finally {
    server.closeAllConnections();
    await new Promise((done) => server.close(done));
  }
  return calls;
}

const busy = (seconds) => ({
  status: 429,
  type: "application/problem+json",
  headers: seconds === undefined ? {} : { "Retry-After": seconds },
  body: BUSY,
});

test("a busy service is asked again, not before Retry-After", async () => {
  const calls = await scripted([busy("1"), { body: LIVE }], async (hof) => {
    assert.deepEqual(await hof.call("GET /health/live"), LIVE);
  });
  assert.equal(calls.length, 2);
  assert.ok(calls[1].at - calls[0].at >= 1000);
});

test("a Retry-After past the limit is an error at once, with its seconds", async () => {
  const calls = await scripted([busy("61")], async (hof) => {
    await assert.rejects(hof.call("GET /health/live"), { type: BUSY.type, retryAfterS: 61 });
  });
  assert.equal(calls.length, 1);
});

test("repeats end after their number", async () => {
  const calls = await scripted(Array(9).fill(busy()), async (hof) => {
    await assert.rejects(hof.call("GET /health/live"), { status: 429 });
  });
  assert.equal(calls.length, 5);
});

test("a connection that breaks is tried again, except for a deletion", async () => {
  const calls = await scripted([undefined, { body: LIVE }], async (hof) => {
    assert.deepEqual(await hof.call("GET /health/live"), LIVE);
  });
  assert.equal(calls.length, 2);
  const deletions = await scripted([undefined], async (hof) => {
    await assert.rejects(hof.call("DELETE /objects/{id}", { path: { id: "0" } }), ConnectionFailed);
  });
  assert.equal(deletions.length, 1);
});

test("points that break off are asked for again, and never returned", async () => {
  const bytes = (n) => Buffer.from(new Float32Array(3 * n).fill(0.5).buffer);
  const type = "application/octet-stream";
  const cut = { type, headers: { "Content-Length": "24" }, body: bytes(1), cut: true };
  const calls = await scripted([cut, cut, cut, cut, cut], async (hof) => {
    await assert.rejects(hof.points("0", { n: 2 }), ConnectionFailed);
  });
  assert.equal(calls.length, 5);
});

test("an answer of another service is an UnexpectedAnswer, a proxy's page a Problem", async () => {
  await scripted([{ type: "text/html", body: "<p>Hello" }], async (hof) => {
    await assert.rejects(hof.call("GET /models"), UnexpectedAnswer);
  });
  await scripted([{ status: 404, type: "text/html", body: "<p>Nothing here" }], async (hof) => {
    await assert.rejects(hof.call("GET /models"), { type: "about:blank", status: 404, detail: "<p>Nothing here" });
  });
});

test("an aborted call throws the signal's reason and is not repeated", async () => {
  const calls = await scripted([busy("30")], async (hof) => {
    const signal = AbortSignal.timeout(300);
    const error = await hof.call("GET /health/live", { signal }).catch((error) => error);
    assert.equal(error, signal.reason);
    assert.equal(error instanceof HofError, false);
  });
  assert.equal(calls.length, 1);
});
