// A stream of float32 points, read into an array.

import { ConnectionFailed, UnexpectedAnswer } from "./problems.js";

/** Read the points of an answer whose Content-Length tells their number; `take` gets each part that is complete. */
export async function readPoints(
  answer: Response,
  take?: (part: Float32Array, offset: number) => void,
): Promise<Float32Array> {
  const length = Number(answer.headers.get("Content-Length"));
  if (!answer.body || !Number.isInteger(length) || length < 12 || length % 12) {
    throw new UnexpectedAnswer(`${answer.url} answered ${length} bytes, which are no points: is this a HOF service?`);
  }
  const points = new Float32Array(length / 4);
  const bytes = new Uint8Array(points.buffer);
  let [filled, passed] = [0, 0]; // bytes that have arrived, points that were passed on
  for (const reader = answer.body.getReader(); ; ) {
    const { done, value } = await reader.read();
    if (done) break;
    if (filled + value.length > length) throw new UnexpectedAnswer(`${answer.url} answered more than ${length} bytes`);
    bytes.set(value, filled);
    filled += value.length;
    const whole = Math.floor(filled / 12);
    if (whole > passed) take?.(points.subarray(3 * passed, 3 * whole), passed);
    passed = whole;
  }
  if (filled < length) throw new ConnectionFailed(`the answer of ${answer.url} broke off after ${filled} bytes`);
  return points;
}
