// A photo -> the encoder's input, framed as the service does it (service/encoding/framing.py).

import { FLOOR, MATTING_FLOOR, TRACE, matteOf, type Mask, type Matte, type MattingFunction } from "./masks.js";
import { crop, overWhite, reduce, resize, roundHalfToEven, type Box, type Pixels } from "./pixels.js";

export type Background = "auto" | "keep" | "remove";

/** An encoder's input and its origin in the photo. */
export interface Framed {
  /** (3, size, size) numbers in [0, 1], RGB, the object over white. */
  tensor: Float32Array;
  /** The whole photo as a second input, like `tensor`, if the mask is of a network and the object large. */
  whole?: Float32Array;
  mask: Mask;
  /** The object in the photo. */
  box: Box;
  /** Mean of the matte, weighted by itself; undefined without a mask. */
  confidence?: number;
  width: number;
  height: number;
}

/** A photo in which no object can be told from its background. */
export class NoObjectFound extends Error {
  override name = "NoObjectFound";
}

const WORK_SIDE = 1024; // pixels of the longest side at which masks and crops are computed
const MIN_CONFIDENCE = 0.7; // of a matte from a network
const MOST_MOVED = 0.06; // of the square's side; further from the middle, encoders make more errors
const LARGE = [0.6, 0.7]; // of the photo's longer side: where whole photos begin to count, and where they do in full
const MIN_FOREGROUND = 5e-4; // of the image's pixels
const SPECKS = 2e-4; // of the foreground, which are cut from each end

/**
 * Crop a square around the object and resize it. `size`: side of the input, pixels; `ratio`: share of it that the
 * object's longer side takes. `matting`: tells the object from any background. Throws NoObjectFound.
 */
export async function frame(
  photo: Pixels,
  size: number,
  ratio: number,
  background: Background = "auto",
  matting?: MattingFunction,
): Promise<Framed> {
  const { width, height } = photo;
  const factor = Math.max(1, Math.ceil(Math.max(width, height) / WORK_SIDE));
  const work = factor > 1 ? reduce(photo, factor) : photo;
  const { mask, matte } = background === "keep" ? { mask: "none" as const, matte: undefined } : await matteOf(work, matting);
  if (!matte) {
    if (background === "remove") {
      throw new NoObjectFound("the background cannot be removed: the image has neither transparency nor a uniform border");
    }
    return { tensor: wholeOf(work, size), mask, box: [0, 0, width, height], width, height };
  }
  const box = foregroundBox(matte, work, mask === "matting" ? MATTING_FLOOR : FLOOR);
  const confidence = confidenceOf(matte);
  if (mask === "matting" && confidence < MIN_CONFIDENCE) {
    throw new NoObjectFound("no object found in the image: nothing in it stands out clearly enough");
  }
  const around = squareAround(box, ratio);
  const ofNetwork = mask === "matting";
  const [alpha, square] = ofNetwork ? [withTrace(matte, work), within(around, work)] : [matte, around];
  const tensor = overWhite(resize(crop(withAlpha(work, alpha), square), size));
  const [left, top, right, bottom] = box.map((edge) => factor * edge);
  const inPhoto: Box = [left, top, Math.min(right, width), Math.min(bottom, height)];
  const whole = ofNetwork && weightOfWhole(box, work) ? wholeOf(withAlpha(work, visible(work)), size) : undefined;
  return { tensor, ...(whole && { whole }), mask, box: inPhoto, confidence, width, height };
}

/** A picture with a margin along its longer sides, as an encoder's input. */
function wholeOf(work: Pixels, size: number): Float32Array {
  return overWhite(resize(crop(work, squareAround([0, 0, work.width, work.height], 1)), size));
}

/** How much a whole picture counts, 0 to 1. It changes steadily with the share that the box takes. */
export function weightOfWhole([left, top, right, bottom]: Box, { width, height }: Size): number {
  const [least, full] = LARGE;
  const share = Math.max(right - left, bottom - top) / Math.max(width, height);
  return Math.min(1, Math.max(0, (share - least) / (full - least)));
}

/** The matte of all pixels that are not fully transparent. */
function visible({ width, height, data }: Pixels): Matte {
  return new Uint8Array(width * height).map((_, at) => (data[4 * at + 3] > 0 ? 255 : 0));
}

interface Size {
  width: number;
  height: number;
}

function squareAround([left, top, right, bottom]: Box, ratio: number): Box {
  const side = Math.max(1, roundHalfToEven(Math.max(right - left, bottom - top) / ratio));
  const [x, y] = [Math.floor((left + right - side) / 2), Math.floor((top + bottom - side) / 2)];
  return [x, y, x + side, y + side];
}

/** A square no larger than a picture's longer side, moved toward the picture by MOST_MOVED at most. */
function within([left, top, right]: Box, { width, height }: Pixels): Box {
  const side = Math.min(right - left, Math.max(width, height));
  const most = roundHalfToEven(MOST_MOVED * side);
  const middle = Math.floor((right - left - side) / 2);
  const moved = (low: number, length: number) => low + Math.max(-most, Math.min(most, wayInto(low, side, length)));
  const [x, y] = [moved(left + middle, width), moved(top + middle, height)];
  return [x, y, x + side, y + side];
}

/** How far a range of `side` from `low` on has to move to lie within 0 to `length`; 0 if it is longer. */
function wayInto(low: number, side: number, length: number): number {
  return side <= length ? Math.min(Math.max(0, low), length - side) - low : 0;
}

/** A matte that leaves a trace of what it removes: it may have been the object. */
function withTrace(matte: Matte, { data }: Pixels): Matte {
  return matte.map((value, at) => Math.max(value, Math.min(TRACE, data[4 * at + 3])));
}

function withAlpha(image: Pixels, matte: Matte): Pixels {
  const data = image.data.slice();
  matte.forEach((value, at) => (data[4 * at + 3] = value));
  return { width: image.width, height: image.height, data };
}

function confidenceOf(matte: Matte): number {
  let [sum, squares] = [0, 0];
  for (const value of matte) {
    sum += value;
    squares += value * value;
  }
  return squares / sum / 255;
}

/** The bounding box of the pixels above the floor, without specks. */
function foregroundBox(matte: Matte, { width, height }: Pixels, floor: number): Box {
  const [columns, rows] = [new Float64Array(width), new Float64Array(height)];
  matte.forEach((value, at) => {
    if (value <= floor) return;
    columns[at % width]++;
    rows[Math.floor(at / width)]++;
  });
  const solid = rows.reduce((sum, count) => sum + count, 0);
  if (solid / (width * height) < MIN_FOREGROUND) {
    throw new NoObjectFound("no object found in the image: nothing stands out from its background");
  }
  const [left, right] = span(columns, solid);
  const [top, bottom] = span(rows, solid);
  return [left, top, right, bottom];
}

/** The first index and one past the last, after specks are cut from each end. */
function span(counts: Float64Array, total: number): [number, number] {
  const slack = Math.floor(total * SPECKS);
  let [sum, first, last] = [0, -1, -1];
  counts.forEach((count, index) => {
    sum += count;
    if (first < 0 && sum > slack) first = index;
    if (last < 0 && sum >= total - slack) last = index;
  });
  return [first, last + 1];
}
