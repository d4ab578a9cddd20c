// Pixels of a photo: 8-bit RGBA, resized as Pillow does it, so that the encoder sees what the service would show it.

/** An image: red, green, blue and alpha of each pixel, row by row; `ImageData` is one. */
export interface Pixels {
  readonly width: number;
  readonly height: number;
  readonly data: Uint8ClampedArray;
}

const ONE = 2 ** 22; // weights are whole numbers, as Pillow's

/** left, top, right and bottom, pixels. */
export type Box = readonly [number, number, number, number];

export function blank(width: number, height: number): Pixels {
  return { width, height, data: new Uint8ClampedArray(4 * width * height) };
}

/** Round as Python does. */
export function roundHalfToEven(value: number): number {
  const below = Math.floor(value);
  const rest = value - below;
  return rest > 0.5 || (rest === 0.5 && below % 2 === 1) ? below + 1 : below;
}

/** Whether some pixel is transparent. */
export function isTransparent({ data }: Pixels): boolean {
  for (let at = 3; at < data.length; at += 4) if (data[at] < 255) return true;
  return false;
}

/** Composite over white: (3, height, width) numbers in [0, 1]. */
export function overWhite({ width, height, data }: Pixels): Float32Array {
  const count = width * height;
  const tensor = new Float32Array(3 * count);
  for (let at = 0; at < count; at++) {
    const alpha = data[4 * at + 3] / 255;
    for (let channel = 0; channel < 3; channel++) {
      tensor[channel * count + at] = (data[4 * at + channel] / 255) * alpha + (1 - alpha);
    }
  }
  return tensor;
}

/** Cut out a box; pixels outside the image are transparent. */
export function crop(image: Pixels, [left, top, right, bottom]: Box): Pixels {
  const result = blank(right - left, bottom - top);
  const [first, last] = [Math.max(0, left), Math.min(image.width, right)];
  for (let y = Math.max(0, top); y < Math.min(image.height, bottom); y++) {
    const row = image.data.subarray(4 * (y * image.width + first), 4 * (y * image.width + last));
    result.data.set(row, 4 * ((y - top) * result.width + first - left));
  }
  return result;
}

/**
 * Make an image smaller by a whole number: the mean of each block, those at the right and the bottom being smaller.
 * Pillow multiplies by the rounded inverse of a block's size instead of dividing.
 */
export function reduce(image: Pixels, factor: number): Pixels {
  const source = premultiplied(image);
  const result = blank(Math.ceil(image.width / factor), Math.ceil(image.height / factor));
  for (let y = 0; y < result.height; y++) {
    const bottom = Math.min(image.height, (y + 1) * factor);
    for (let x = 0; x < result.width; x++) {
      const right = Math.min(image.width, (x + 1) * factor);
      const sums = [0, 0, 0, 0];
      for (let v = y * factor; v < bottom; v++) {
        for (let at = 4 * (v * image.width + x * factor); at < 4 * (v * image.width + right); at += 4) {
          for (let channel = 0; channel < 4; channel++) sums[channel] += source[at + channel];
        }
      }
      const count = (bottom - y * factor) * (right - x * factor);
      const inverse = Math.floor(Math.fround(2 ** 24 / count));
      for (let channel = 0; channel < 4; channel++) {
        const mean = Math.floor(((sums[channel] + (count >> 1)) * inverse) / 2 ** 24);
        result.data[4 * (y * result.width + x) + channel] = mean;
      }
    }
  }
  return unpremultiply(result);
}

/**
 * Resize an image. `averaged`: each pixel is the mean of those that it covers, which is the default where the width does
 * not grow. `interpolated`: linearly; of a larger image, over as many pixels as there are for one.
 */
export function resize(
  image: Pixels,
  width: number,
  height = width,
  by: "averaged" | "interpolated" = image.width >= width ? "averaged" : "interpolated",
): Pixels {
  const isAveraged = by === "averaged";
  const across = along(premultiplied(image), image.width, image.height, width, isAveraged); // transposed
  const down = along(across, image.height, width, height, isAveraged);
  return unpremultiply({ width, height, data: down });
}

/** Resize rows of `width` pixels to `size`, and exchange rows and columns. */
function along(
  source: Uint8ClampedArray,
  width: number,
  height: number,
  size: number,
  isAveraged: boolean,
): Uint8ClampedArray {
  const result = new Uint8ClampedArray(4 * size * height);
  for (let x = 0; x < size; x++) {
    const [first, weights] = weightsOf(x, width, size, isAveraged);
    for (let y = 0; y < height; y++) {
      for (let channel = 0; channel < 4; channel++) {
        let sum = ONE / 2;
        let at = 4 * (y * width + first) + channel;
        for (let index = 0; index < weights.length; index++, at += 4) sum += weights[index] * source[at];
        result[4 * (x * height + y) + channel] = Math.floor(sum / ONE);
      }
    }
  }
  return result;
}

/**
 * The first source pixel of a pixel, and the weights from there on, in parts of ONE: of a box, or of a triangle. Borders
 * of pixels often meet exactly, so each number is rounded as in Pillow's precompute_coeffs.
 */
function weightsOf(x: number, width: number, size: number, isAveraged: boolean): [number, number[]] {
  const center = (x + 0.5) * (width / size);
  const scale = Math.max(1, width / size);
  const support = (isAveraged ? 0.5 : 1) * scale;
  const toUnit = 1 / scale;
  const first = Math.max(0, Math.floor(center - support + 0.5));
  const end = Math.min(width, Math.floor(center + support + 0.5));
  const weights = Array.from({ length: end - first }, (_, index) => {
    const distance = (index + first - center + 0.5) * toUnit;
    if (isAveraged) return distance > -0.5 && distance <= 0.5 ? 1 : 0;
    return Math.max(0, 1 - Math.abs(distance));
  });
  const sum = weights.reduce((total, weight) => total + weight, 0);
  return [first, weights.map((weight) => Math.floor((weight / sum) * ONE + 0.5))];
}

function premultiplied({ data }: Pixels): Uint8ClampedArray {
  const result = data.slice();
  for (let at = 0; at < data.length; at += 4) {
    const alpha = data[at + 3];
    if (alpha === 255) continue;
    for (let channel = at; channel < at + 3; channel++) result[channel] = Math.floor((data[channel] * alpha) / 255 + 0.5);
  }
  return result;
}

function unpremultiply(image: Pixels): Pixels {
  const { data } = image;
  for (let at = 0; at < data.length; at += 4) {
    const alpha = data[at + 3];
    if (alpha === 255 || alpha === 0) continue;
    for (let channel = at; channel < at + 3; channel++) data[channel] = Math.floor((255 * data[channel]) / alpha);
  }
  return image;
}
