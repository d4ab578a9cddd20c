// Points computed part by part, so that the page stays responsive.
import { sample, sampleColors } from "hof-client";

const PART = 2048; // points: some tens of milliseconds

/** Yield the bytes of points: three float32 of each, and blue, green, red, 0 if the functions have a color. */
export async function* points(functions, { n, seed, offset = 0 }) {
  for (let begin = 0; begin < n; begin += PART) {
    const count = Math.min(PART, n - begin);
    const options = { seed, offset: offset + begin };
    yield packed(sample(functions, count, options), sampleColors(functions, count, options));
    await new Promise((done) => setTimeout(done));
  }
}

function packed(places, colors) {
  const bytes = new Uint8Array(places.buffer);
  if (!colors) return bytes;
  const result = new Uint8Array((bytes.length / 12) * 16);
  for (let point = 0; point < bytes.length / 12; point++) {
    result.set(bytes.subarray(12 * point, 12 * point + 12), 16 * point);
    for (let channel = 0; channel < 3; channel++) result[16 * point + 12 + channel] = colors[3 * point + 2 - channel];
  }
  return result;
}
