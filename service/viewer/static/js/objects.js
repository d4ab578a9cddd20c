// Objects and their files by name: addresses, paths and sizes, the same with a service and without one.

const ADDRESS = /^#\/objects\/(\w+)$/; // of an object, after the page's own
const BYTES_PER_POINT = 12; // three float32
const BYTES_PER_COLORED_POINT = 16; // three float32, then blue, green, red, 0

/** The id in the page's address; undefined without one. */
export function addressedId() {
  return ADDRESS.exec(location.hash)?.[1];
}

/** The request body for the word of objects, the last one applied first. */
export function wordBody(objects) {
  return JSON.stringify({ objects: objects.map(({ id }) => id) });
}

/** The path of an object's file; `of` is `points`, `mesh`, `weights` or `picture`. */
export function filePath(object, of, query) {
  return `objects/${object.id}/${of}?${new URLSearchParams(query)}`;
}

/** Wait for the addresses of blobs: for all, or for none, since one that nobody gets would stay in memory. */
export async function allOrNone(fetches) {
  const results = await Promise.allSettled(fetches);
  const failure = results.find(({ status }) => status === "rejected");
  const addresses = results.map(({ value }) => value);
  if (!failure) return addresses;
  revoke(addresses);
  throw failure.reason;
}

/** Give up the blobs of addresses; undefined is none. */
export function revoke(addresses) {
  for (const address of addresses) if (address) URL.revokeObjectURL(address);
}

/** Bytes of one point of the object in a stream. */
export function bytesPerPoint(object) {
  return object.color ? BYTES_PER_COLORED_POINT : BYTES_PER_POINT;
}
