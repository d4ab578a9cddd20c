// The objects of this tab: the answers that a service would give, beside the functions.
import { dimensionsOf, measureFrame } from "hof-client";

const BYTES_PER_NUMBER = 4;

/** Objects by id, in the order in which they were made. */
export class Store {
  #entries = new Map(); // by id: {object, functions, word}

  /** Keep an object of a photo. `encoded`: of hof-client's Encoder. Returns the object. */
  async add({ functions, image, shapeConfidence }, model) {
    const { mask, box, confidence, width, height } = image;
    const report = { mask, box, width, height, ...(confidence && { confidence: Number(confidence.toFixed(3)) }) };
    const fit = shapeConfidence === undefined ? {} : { shape_confidence: Number(shapeConfidence.toFixed(3)) };
    const about = { kind: "encoded", model, image: report, ...fit };
    return this.#keep(await idOf(functions.rows), about, functions, []);
  }

  /** Keep the object of a word, the last one applied first. Returns the object. */
  async compose(word) {
    const parts = word.map((id) => this.#entries.get(id));
    const [{ object, functions: first }] = parts;
    const rows = parts.map(({ functions }) => functions.rows[0]);
    const colored = parts.map(({ functions }) => functions).filter(({ colorSpec }) => colorSpec);
    const functions = {
      spec: first.spec,
      rows,
      ...(colored.length && { colorSpec: colored[0].colorSpec }),
      colorRows: colored.map(({ colorRows }) => colorRows[0]),
      frame: measureFrame({ spec: first.spec, rows }),
      bytes: BYTES_PER_NUMBER * rows.length * rows[0].length,
    };
    return this.#keep(await idOf(rows), { kind: "composed", model: object.model, word }, functions, word);
  }

  get(id) {
    return this.#entries.get(id);
  }

  /** Return all objects, newest first. */
  list() {
    return [...this.#entries.values()].map(({ object }) => object).reverse();
  }

  /** Give an object another label, or none (""). Returns the object. */
  relabel(id, label) {
    const entry = this.#entries.get(id);
    const { label: _, ...rest } = entry.object;
    entry.object = label ? { ...rest, label } : rest;
    return entry.object;
  }

  delete(id) {
    this.#entries.delete(id);
  }

  #keep(id, about, functions, word) {
    const object = this.#entries.get(id)?.object ?? {
      id,
      created_at: new Date().toISOString(),
      spec: functions.spec,
      ...(functions.colorSpec && { color: functions.colorSpec }),
      bytes: functions.bytes,
      dimensions: dimensionsOf(functions.frame),
      frame: functions.frame,
      links: {},
      ...about,
    };
    this.#entries.set(id, { object, functions, word });
    return object;
  }
}

/** A digest of thetas, 32 digits. Browsers have SHA-256 on secure pages alone; elsewhere ids are random. */
async function idOf(rows) {
  const bytes = crypto.subtle
    ? new Uint8Array(await crypto.subtle.digest("SHA-256", await new Blob(rows).arrayBuffer()))
    : crypto.getRandomValues(new Uint8Array(16));
  return Array.from(bytes.subarray(0, 16), (byte) => byte.toString(16).padStart(2, "0")).join("");
}
