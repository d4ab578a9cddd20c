// The image encoder without the service: a photo becomes functions, by onnxruntime-web.

import * as ort from "onnxruntime-web/wasm";

import type { Functions } from "../function/weights.js";
import { measureFrame } from "../sampling/frame.js";
import { frame, weightOfWhole, type Background, type Framed } from "./framing.js";
import type { MattingFunction } from "./masks.js";
import { readMetadata, type Metadata } from "./metadata.js";
import type { Pixels } from "./pixels.js";
import { openSession, type Runtime } from "./session.js";

export { frame, NoObjectFound, type Background, type Framed } from "./framing.js";
export { Matting } from "./matting.js";
export type { Mask, Matte, MattingFunction } from "./masks.js";
export type { Metadata } from "./metadata.js";
export type { Box, Pixels } from "./pixels.js";
export type { Runtime } from "./session.js";

const FAVOR = 8; // of the surer look at a photo: 0.1 more confidence counts 2.2 times as much

/** A photo's object, and how it was told from its background. */
export interface Encoded {
  functions: Functions;
  image: Omit<Framed, "tensor" | "whole">;
  /** Expected F-score at 2% of the longest side, 0 to 1, if the model estimates it. */
  shapeConfidence?: number;
}

/** One image encoder. */
export class Encoder {
  readonly metadata: Metadata;
  readonly #session: ort.InferenceSession;

  private constructor(metadata: Metadata, session: ort.InferenceSession) {
    this.metadata = metadata;
    this.#session = session;
  }

  /** Open an ONNX file of `hof-model export`. */
  static async open(model: Uint8Array, runtime: Runtime = {}): Promise<Encoder> {
    return new Encoder(readMetadata(model), await openSession(model, runtime));
  }

  /** Encode a photo. `matting`: tells the object from any background. Throws NoObjectFound. */
  async encode(photo: Pixels, background: Background = "auto", matting?: MattingFunction): Promise<Encoded> {
    const { spec, colorSpec, framing } = this.metadata;
    const framed = await frame(photo, framing.size, framing.foreground_ratio, background, matting);
    const { tensor, whole, ...image } = framed;
    const looks: ort.InferenceSession.OnnxValueMapType[] = [];
    for (const each of whole ? [tensor, whole] : [tensor]) {
      const input = new ort.Tensor("float32", each, [1, 3, framing.size, framing.size]);
      looks.push(await this.#session.run({ image: input }));
    }
    const of = (output: string) => looks.map((each) => each[output].data as Float32Array);
    const hasConfidence = "shape_confidence" in looks[0];
    const confidences = looks.map((each) => (hasConfidence ? (each.shape_confidence.data as Float32Array)[0] : 0));
    const shares = sharesOf(confidences, [1, weightOfWhole(image.box, image)]);
    const rows = [mean(of("theta"), shares)];
    const functions: Functions = {
      spec,
      rows,
      ...(colorSpec && { colorSpec }),
      colorRows: colorSpec ? [mean(of("color"), shares)] : [],
      frame: measureFrame({ spec, rows }),
      bytes: 4 * rows[0].length,
    };
    return { functions, image, ...(hasConfidence && { shapeConfidence: mean(of("shape_confidence"), shares)[0] }) };
  }
}

/** Decode the file of a photo, upright and in sRGB, as a browser does it. */
export async function decode(file: Blob): Promise<Pixels> {
  const bitmap = await createImageBitmap(file);
  const canvas = new OffscreenCanvas(bitmap.width, bitmap.height);
  const context = canvas.getContext("2d", { willReadFrequently: true });
  if (!context) throw new Error("the browser draws no pictures");
  context.drawImage(bitmap, 0, 0);
  bitmap.close();
  return context.getImageData(0, 0, canvas.width, canvas.height);
}

/** How much each look at a photo counts: surer ones count more. */
function sharesOf(confidences: number[], ofLooks: number[]): number[] {
  const weights = confidences.map((confidence, index) => ofLooks[index] * Math.exp(FAVOR * confidence));
  const total = weights.reduce((sum, weight) => sum + weight, 0);
  return weights.map((weight) => weight / total);
}

function mean(arrays: Float32Array[], shares: number[]): Float32Array {
  if (arrays.length === 1) return arrays[0].slice();
  return arrays[0].map((_, at) => arrays.reduce((sum, array, index) => sum + shares[index] * array[at], 0));
}
