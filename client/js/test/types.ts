// Calls as the compiler sees them: each line under "expect-error" must be refused. Nothing of this runs.

import { Client, type Answer, type ObjectPage, type StoredObject } from "../src/index.js";

const hof = new Client("http://localhost:8080");

export async function accepted(photo: Blob): Promise<[StoredObject, ObjectPage, Answer<"GET /models">, undefined]> {
  const stored = await hof.call("GET /objects/{id}", { path: { id: "0" } });
  const page = await hof.call("GET /objects", { query: { limit: 10 } });
  await hof.call("POST /compose", { body: { objects: [stored.id, stored.id], mode: "compose" } });
  await hof.call("PATCH /objects/{id}", { path: { id: "0" }, body: { label: "Desk chair" } });
  await hof.bytes("GET /objects/{id}/mesh", { path: { id: "0" }, query: { format: "stl" } });
  await hof.encode(photo, { background: "keep" });
  return [stored, page, await hof.call("GET /models"), await hof.call("DELETE /objects/{id}", { path: { id: "0" } })];
}

export async function refused(): Promise<void> {
  // @ts-expect-error: there is no such call
  await hof.call("GET /object/{id}", { path: { id: "0" } });
  // @ts-expect-error: the path needs an id
  await hof.call("GET /objects/{id}");
  // @ts-expect-error: limit is a number
  await hof.call("GET /objects", { query: { limit: "10" } });
  // @ts-expect-error: there is no such parameter
  await hof.call("GET /objects", { query: { many: 10 } });
  // @ts-expect-error: there is no such format
  await hof.bytes("GET /objects/{id}/mesh", { path: { id: "0" }, query: { format: "doc" } });
  // @ts-expect-error: it answers a file, not JSON
  await hof.call("GET /objects/{id}/mesh", { path: { id: "0" } });
  // @ts-expect-error: there is no such mode
  await hof.call("POST /compose", { body: { objects: ["0", "1"], mode: "mix" } });
  // @ts-expect-error: an object has no such member
  (await hof.call("GET /objects/{id}", { path: { id: "0" } })).color_spec;
}
