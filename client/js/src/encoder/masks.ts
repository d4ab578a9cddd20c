// The object's matte in a photo: from its transparency, from a uniform border, or from a matte network
// (service/encoding/masks.py).

import { blank, crop, isTransparent, type Box, type Pixels } from "./pixels.js";

export type Mask = "alpha" | "border" | "matting" | "none";

/** A value from 0 for background to 255 for the object, of each pixel. */
export type Matte = Uint8Array;

/** Returns the matte of an opaque image in front of any background; `Matting` has such a function. */
export type MattingFunction = (image: Pixels) => Promise<Matte>;

/** A source, and the matte; no matte if no source applies. */
interface Masked {
  mask: Mask;
  matte?: Matte;
}

export const FLOOR = 8; // of 255; fainter pixels are background
export const MATTING_FLOOR = 128; // of 255; in a matte from a network, pixels above it are object
export const TRACE = 20; // of 255; that much of a pixel stays where a network removes it, as it may have been the object
const MIN_TRANSPARENT = 0.05; // of the pixels; less is rounded corners or stray pixels, and separates nothing
const BORDER_TOLERANCE = 12; // of 255, largest channel difference to the border's median
const BORDER_SOFTNESS = 16; // of 255; over this the matte rises from 0 to 1
const BORDER_SHARE = 0.8; // of the border's pixels must be alike for a uniform border

/** Return the source of the mask, and the matte; no matte if no source applies. */
export async function matteOf(image: Pixels, matting?: MattingFunction): Promise<Masked> {
  if (!isTransparent(image)) {
    const matte = borderMatte(image);
    if (matte) return { mask: "border", matte };
    return matting ? { mask: "matting", matte: await matting(image) } : { mask: "none" };
  }
  const alpha = Uint8Array.from({ length: image.width * image.height }, (_, index) => image.data[4 * index + 3]);
  return separates(alpha, image) ? { mask: "alpha", matte: alpha } : matteWithin(image, alpha, matting);
}

/** Whether an alpha tells an object from a background, not counting a thin frame. */
function separates(alpha: Matte, { width, height }: Pixels): boolean {
  const highest = alpha.reduce((most, value) => Math.max(most, value), 0);
  if (highest <= FLOOR) return true;
  const edge = edgeOf(width, height);
  const frame = Math.min(width, height) > 2 * edge ? edge : 0;
  let transparent = 0;
  for (let y = frame; y < height - frame; y++) {
    for (let x = frame; x < width - frame; x++) if (2 * alpha[y * width + x] < highest) transparent++;
  }
  return transparent / ((width - 2 * frame) * (height - 2 * frame)) >= MIN_TRANSPARENT;
}

/** The matte of an image as if its few transparent pixels were more of its border. */
async function matteWithin(image: Pixels, alpha: Matte, matting?: MattingFunction): Promise<Masked> {
  const { width } = image;
  const highest = alpha.reduce((most, value) => Math.max(most, value), 0);
  const opacity = alpha.map((value) => Math.floor((value / highest) * 255));
  const box = boxOf(opacity, image, 127) ?? [0, 0, width, image.height];
  const inner = crop(image, box);
  const opacityAt = (x: number, y: number) => opacity[(y + box[1]) * width + x + box[0]];
  const fill = medianOf(inner, ring(inner).filter((at) => opacityAt(at % inner.width, Math.floor(at / inner.width)) >= 128));
  const filled = blank(inner.width, inner.height);
  for (let at = 0; at < inner.width * inner.height; at++) {
    const share = opacityAt(at % inner.width, Math.floor(at / inner.width)) / 255;
    for (let channel = 0; channel < 3; channel++) {
      filled.data[4 * at + channel] = Math.round(share * inner.data[4 * at + channel] + (1 - share) * fill[channel]);
    }
    filled.data[4 * at + 3] = 255;
  }
  const { mask, matte } = await matteOf(filled, matting);
  if (!matte) return { mask };
  const whole = new Uint8Array(alpha.length);
  matte.forEach((value, at) => {
    const [x, y] = [at % inner.width, Math.floor(at / inner.width)];
    whole[(y + box[1]) * width + x + box[0]] = Math.min(value, opacityAt(x, y));
  });
  return { mask, matte: whole };
}

/** The matte of the pixels that differ from a uniform border; undefined if the border is not uniform. */
function borderMatte(image: Pixels): Matte | undefined {
  const border = ring(image);
  const color = medianOf(image, border);
  const { data } = image;
  const [red, green, blue] = color;
  const farthest = new Uint8Array(image.width * image.height);
  for (let index = 0, at = 0; index < farthest.length; index++, at += 4) {
    const differences = Math.max(Math.abs(data[at] - red), Math.abs(data[at + 1] - green));
    farthest[index] = Math.max(differences, Math.abs(data[at + 2] - blue));
  }
  const alike = border.filter((index) => farthest[index] <= BORDER_TOLERANCE);
  if (alike.length / border.length < BORDER_SHARE) return undefined;
  return farthest.map((value) =>
    Math.min(255, Math.max(0, Math.floor((value - BORDER_TOLERANCE) * (255 / BORDER_SOFTNESS)))),
  );
}

/** The box of the pixels above a floor; undefined if there are none. */
export function boxOf(matte: Matte, { width, height }: { width: number; height: number }, floor: number): Box | undefined {
  const box: [number, number, number, number] = [width, height, 0, 0];
  matte.forEach((value, at) => {
    if (value <= floor) return;
    const [x, y] = [at % width, Math.floor(at / width)];
    box[0] = Math.min(box[0], x);
    box[1] = Math.min(box[1], y);
    box[2] = Math.max(box[2], x + 1);
    box[3] = Math.max(box[3], y + 1);
  });
  return box[2] ? box : undefined;
}

/** The width of an image's border, pixels. */
function edgeOf(width: number, height: number): number {
  return Math.max(1, Math.floor(Math.min(width, height) / 64));
}

/** Indices of the pixels within the border, corners twice. */
function ring({ width, height }: Pixels): number[] {
  const edge = edgeOf(width, height);
  const indices: number[] = [];
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      const at = y * width + x;
      if (y < edge) indices.push(at);
      if (y >= height - edge) indices.push(at);
      if (x < edge) indices.push(at);
      if (x >= width - edge) indices.push(at);
    }
  }
  return indices;
}

/** The median of each color of some pixels, rounded down. */
function medianOf({ data }: Pixels, indices: readonly number[]): number[] {
  return [0, 1, 2].map((channel) => {
    const levels = indices.map((index) => data[4 * index + channel]).sort((a, b) => a - b);
    const middle = Math.floor(levels.length / 2);
    return levels.length % 2 ? levels[middle] : Math.floor((levels[middle - 1] + levels[middle]) / 2);
  });
}
