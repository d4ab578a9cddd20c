// The mapping function f_theta on the processor (service/mapping/spec.py).

import type { Spec } from "../function/weights.js";

/** Replaces a point, the first numbers of `x`, by its image. */
type Apply = (x: Float64Array) => void;

/** Map canonical points through a word of functions, the last one first: (n, d) -> (n, 3) numbers. */
export function mapped(spec: Spec, word: readonly Float32Array[], points: Float32Array): Float32Array {
  const functions = new Map<Float32Array, Apply>();
  for (const theta of word) if (!functions.has(theta)) functions.set(theta, applied(spec, theta));
  const steps = word.map((theta) => functions.get(theta) as Apply).reverse();
  const d = spec.input_dim;
  const n = points.length / d;
  const images = new Float32Array(3 * n);
  const x = new Float64Array(Math.max(d, 3));
  for (let point = 0; point < n; point++) {
    for (let axis = 0; axis < d; axis++) x[axis] = points[d * point + axis];
    for (const step of steps) step(x);
    for (let axis = 0; axis < 3; axis++) images[3 * point + axis] = x[axis];
  }
  return images;
}

function applied(spec: Spec, theta: Float32Array): Apply {
  const widths = [spec.input_dim, ...spec.hidden, spec.output_dim];
  const size = widths.slice(1).reduce((sum, width, layer) => sum + width * (widths[layer] + 1), 0);
  if (theta.length !== size) throw new RangeError(`theta has ${theta.length} numbers, ${spec.name} needs ${size}`);
  const isOneLayer = spec.hidden.length === 1 && spec.activation === "relu" && spec.input_dim === 3;
  return isOneLayer ? oneLayer(spec.hidden[0], theta) : layered(widths, spec.activation, theta);
}

/** One hidden layer of ReLUs from 3D to 3D: of each unit its weights, its bias and its column of the second layer. */
function oneLayer(units: number, theta: Float32Array): Apply {
  const [bias, second, last] = [3 * units, 4 * units, 7 * units]; // places in theta: W, b, V, c
  const packed = new Float64Array(7 * units);
  for (let unit = 0; unit < units; unit++) {
    for (let axis = 0; axis < 3; axis++) {
      packed[7 * unit + axis] = theta[3 * unit + axis];
      packed[7 * unit + 4 + axis] = theta[second + axis * units + unit];
    }
    packed[7 * unit + 3] = theta[bias + unit];
  }
  return (point) => {
    const [x, y, z] = [point[0], point[1], point[2]];
    let [a, b, c] = [theta[last], theta[last + 1], theta[last + 2]];
    for (let at = 0; at < packed.length; at += 7) {
      const value = packed[at] * x + packed[at + 1] * y + packed[at + 2] * z + packed[at + 3];
      if (value <= 0) continue;
      a += packed[at + 4] * value;
      b += packed[at + 5] * value;
      c += packed[at + 6] * value;
    }
    point[0] = a;
    point[1] = b;
    point[2] = c;
  };
}

/** Any network: layer by layer W row-major (out, in), then b (out). */
function layered(widths: readonly number[], activation: Spec["activation"], theta: Float32Array): Apply {
  const values = widths.map((width) => new Float64Array(width));
  const nonlinear = activation === "relu" ? (value: number) => Math.max(0, value) : Math.tanh;
  return (point) => {
    values[0].set(point.subarray(0, widths[0]));
    let place = 0;
    for (let layer = 1; layer < widths.length; layer++) {
      const [from, to] = [values[layer - 1], values[layer]];
      const biases = place + from.length * to.length;
      for (let row = 0; row < to.length; row++) {
        let sum = theta[biases + row];
        for (let column = 0; column < from.length; column++) sum += theta[place + row * from.length + column] * from[column];
        to[row] = layer < widths.length - 1 ? nonlinear(sum) : sum;
      }
      place = biases + to.length;
    }
    point.set(values[values.length - 1]);
  };
}
