// The functions of an object, read from its weights file (safetensors), and the form in which they are an object.

/**
 * @typedef {object} Spec Shape and canonical domain of a mapping function.
 * @property {string} name
 * @property {number} input_dim
 * @property {number[]} hidden
 * @property {number} output_dim
 * @property {"relu" | "tanh"} activation
 * @property {number} k
 * @property {"ball" | "sphere" | "ball4" | "cube"} domain
 */

/**
 * @typedef {object} Frame The box of an object in its function's own numbers: two corners, x, y and z each.
 * @property {number[]} low
 * @property {number[]} high
 */

/**
 * @typedef {object} Functions The functions of an object.
 * @property {Spec} spec
 * @property {Float32Array[]} rows thetas: one, or of a word one for each step, the last one applied first
 * @property {Spec} [colorSpec]
 * @property {Float32Array[]} colorRows
 * @property {Frame} [frame] undefined if it was not measured
 * @property {number} bytes of the file
 */

/**
 * @typedef {object} Form How functions make up an object.
 * @property {[number, number, number][]} word of each step [row, other row, blend], the last one applied first; the
 *   step is a blend of the two
 * @property {Frame} frame
 * @property {number[]} colorShares of each row of colors; 1 in all
 */

/**
 * Read a safetensors file of the service, float32. Of a word, there is a row for each step.
 * @param {ArrayBuffer} bytes
 * @returns {Functions}
 */
export function readFunctions(bytes) {
  const headBytes = Number(new DataView(bytes).getBigUint64(0, true));
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 8, headBytes)));
  const rowsOf = (/** @type {string} */ name) => {
    if (!(name in head)) return [];
    const { dtype, shape, data_offsets: [begin, end] } = head[name];
    if (dtype !== "F32") throw new Error(`the file has ${name} as ${dtype}, it must be F32: ask for dtype=float32`);
    const numbers = new Float32Array(bytes.slice(8 + headBytes + begin, 8 + headBytes + end));
    const size = shape.at(-1);
    return Array.from({ length: numbers.length / size }, (_, row) => numbers.subarray(row * size, (row + 1) * size));
  };
  const { spec, color_spec: colorSpec, frame } = head.__metadata__;
  return {
    spec: JSON.parse(spec),
    rows: rowsOf("theta"),
    colorSpec: colorSpec && JSON.parse(colorSpec),
    colorRows: rowsOf("color"),
    frame: frame && JSON.parse(frame),
    bytes: bytes.byteLength,
  };
}

/**
 * The form of an object: the same theta k times, or a row for each step.
 * @param {Functions} functions
 * @param {Frame} frame
 * @returns {Form}
 */
export function formOf({ spec, rows, colorRows }, frame) {
  const word = Array.from({ length: spec.k }, (_, step) => {
    const row = rows.length > 1 ? step : 0;
    return /** @type {[number, number, number]} */ ([row, row, 0]);
  });
  return { word, frame, colorShares: colorRows.map(() => 1 / colorRows.length) };
}
