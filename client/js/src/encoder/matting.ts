// The object's matte in front of any background, by a matte network (service/encoding/matting.py): a look at the whole photo,
// then one at a square around what it found.

import * as ort from "onnxruntime-web/wasm";

import { boxOf, MATTING_FLOOR, type Matte } from "./masks.js";
import { blank, crop, overWhite, resize, roundHalfToEven, type Box, type Pixels } from "./pixels.js";
import { openSession, type Runtime } from "./session.js";

const [INPUT, OUTPUT] = ["image", "matte"]; // names in the graph
const MARGIN = 0.15; // around the object's box in the second look, of its longer side

/** One matte network. */
export class Matting {
  readonly #session: ort.InferenceSession;
  readonly #side: number; // pixels of its square input and output

  private constructor(session: ort.InferenceSession) {
    const [, , side] = shapeOf(session);
    this.#session = session;
    this.#side = Number(side);
  }

  /** Open an ONNX file of `hof-model matte`. */
  static async open(model: Uint8Array, runtime: Runtime = {}): Promise<Matting> {
    return new Matting(await openSession(model, runtime));
  }

  /** The matte of an opaque photo. */
  async matteOf(photo: Pixels): Promise<Matte> {
    const { width, height } = photo;
    const whole = await this.#look(photo);
    const box = squareAround(whole, photo);
    if (!box) return whole;
    const [left, top, right, bottom] = box;
    if ((right - left) * (bottom - top) >= width * height) return whole;
    const inner = await this.#look(crop(photo, box));
    const matte = new Uint8Array(width * height);
    for (let y = top; y < bottom; y++) {
      const row = (y - top) * (right - left);
      matte.set(inner.subarray(row, row + right - left), y * width + left);
    }
    return matte;
  }

  /** The matte of an image that the network sees as a whole. */
  async #look(image: Pixels): Promise<Matte> {
    const side = this.#side;
    const tensor = overWhite(resize(image, side));
    const outputs = await this.#session.run({ [INPUT]: new ort.Tensor("float32", tensor, [1, 3, side, side]) });
    const shown = blank(side, side);
    (outputs[OUTPUT].data as Float32Array).forEach((share, at) => shown.data.set([255 * share, 0, 0, 255], 4 * at));
    const enlarged = resize(shown, image.width, image.height, "interpolated");
    return Uint8Array.from({ length: image.width * image.height }, (_, at) => enlarged.data[4 * at]);
  }
}

function shapeOf(session: ort.InferenceSession): readonly (number | string)[] {
  const input = session.inputMetadata.find(({ name }) => name === INPUT);
  if (!input?.isTensor || !session.outputNames.includes(OUTPUT)) {
    throw new Error(`the model is no matte network: it needs an input ${INPUT} and an output ${OUTPUT}`);
  }
  return input.shape;
}

/** A square around the object, moved into the image, or cut where it is larger; undefined if there is no object. */
function squareAround(matte: Matte, { width, height }: Pixels): Box | undefined {
  const box = boxOf(matte, { width, height }, MATTING_FLOOR);
  if (!box) return undefined;
  const [left, top, right, bottom] = box;
  const side = roundHalfToEven((1 + 2 * MARGIN) * Math.max(right - left, bottom - top));
  const [first, last] = movedWithin(left, right, side, width);
  const [upper, lower] = movedWithin(top, bottom, side, height);
  return [first, upper, last, lower];
}

/** The range of `side` around the middle of a range, moved into 0 to `length`; all of it if that is less. */
function movedWithin(low: number, high: number, side: number, length: number): [number, number] {
  if (side >= length) return [0, length];
  const first = Math.min(Math.max(0, Math.floor((low + high - side) / 2)), length - side);
  return [first, first + side];
}
