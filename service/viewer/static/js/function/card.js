// An object's functions on the graphics card, and the points that they give there. Nothing but theta is sent to it.

import { FRAGMENT, VERTEX } from "./shader.js";

/** @typedef {import("./weights.js").Spec} Spec */
/** @typedef {import("./weights.js").Functions} Functions */
/** @typedef {import("./weights.js").Form} Form */

/** @type {Readonly<Record<string, number>>} */
const DOMAINS = { ball: 0, sphere: 1, cube: 2 };
const MAX_K = 8;
const MAX_UNITS = 4000; // of the hidden layer: two texels each, in a texture as wide as every card allows
const PART = { first: 16_384, least: 4096, most: 1_048_576 }; // points of one draw call
const [TOO_FAST_MS, TOO_SLOW_MS] = [15, 60]; // of a draw call
const POINT_BYTES = 12;
const PAINT_BYTES = 4;

/**
 * Whether the shader can be an object's function: one hidden layer of ReLUs from 3D to 3D.
 * @param {{spec: Spec, color?: Spec | null, frame?: unknown}} object
 */
export function isComputable({ spec, color, frame }) {
  const isSuited = (/** @type {Spec} */ { hidden, activation, input_dim: inputs, output_dim: outputs }) =>
    hidden.length === 1 && hidden[0] <= MAX_UNITS && activation === "relu" && inputs === 3 && outputs === 3;
  return isSuited(spec) && spec.k <= MAX_K && spec.domain in DOMAINS && Boolean(frame) && (!color || isSuited(color));
}

/** Points of functions, computed part by part into buffers of a WebGL2 context. */
export class CardPoints {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {Functions} functions
   * @param {Form} form
   * @param {bigint | number | string} seed
   */
  constructor(gl, functions, form, seed = 0n) {
    this.gl = gl;
    this.functions = functions;
    this.seed = BigInt(seed);
    this.part = PART.first;
    this.capacity = 0;
    this.count = 0; // points that can be drawn
    this.isDisposed = false;
    /** @type {Promise<void> | undefined} */
    this.busy = undefined;
    /** @type {[WebGLBuffer, WebGLBuffer] | undefined} of points and of paint */
    this.buffers = undefined;
    this.program = linked(gl);
    this.feedback = gl.createTransformFeedback();
    this.array = gl.createVertexArray();
    this.textures = [textureOf(gl, functions.spec, functions.rows)];
    if (functions.colorSpec) this.textures.push(textureOf(gl, functions.colorSpec, functions.colorRows));
    this.form = form;
    this.done = 0; // points computed in this form
  }

  /**
   * Compute other points with the same functions. Those that are there are drawn until then.
   * @param {Form} form
   */
  change(form) {
    this.form = form;
    this.done = 0;
  }

  /**
   * Compute one more part of n points, after the part that is being computed. Resolves when the card has done it.
   * @param {number} n
   */
  async extend(n) {
    const before = this.busy;
    let end = () => {};
    this.busy = new Promise((done) => (end = done));
    try {
      await before;
      if (!this.isDisposed) await this.#extend(n);
    } finally {
      end();
    }
  }

  /** @param {number} n */
  async #extend(n) {
    this.reserve(n);
    const { form } = this;
    const more = Math.min(this.part, n - this.done);
    if (more <= 0) return;
    const began = performance.now();
    this.draw(this.done, more);
    await this.#finished();
    if (form !== this.form) return;
    this.done += more;
    this.count = Math.max(this.count, this.done);
    const took = performance.now() - began;
    if (took < TOO_FAST_MS) this.part = Math.min(PART.most, 2 * this.part);
    else if (took > TOO_SLOW_MS) this.part = Math.max(PART.least, this.part / 2);
  }

  /**
   * Read points back: {points: Float32Array, paint: Uint8Array of blue, green, red, 0}.
   * @param {number} begin
   * @param {number} n
   */
  read(begin, n) {
    const { gl, buffers } = this;
    const [points, paint] = [new Float32Array(3 * n), new Uint8Array(PAINT_BYTES * n)];
    if (!buffers) throw new Error("no points were computed yet: call extend first");
    gl.bindBuffer(gl.COPY_READ_BUFFER, buffers[0]);
    gl.getBufferSubData(gl.COPY_READ_BUFFER, begin * POINT_BYTES, points);
    gl.bindBuffer(gl.COPY_READ_BUFFER, buffers[1]);
    gl.getBufferSubData(gl.COPY_READ_BUFFER, begin * PAINT_BYTES, paint);
    gl.bindBuffer(gl.COPY_READ_BUFFER, null);
    return { points, paint };
  }

  dispose() {
    const { gl } = this;
    this.isDisposed = true;
    for (const buffer of this.buffers ?? []) gl.deleteBuffer(buffer);
    for (const texture of this.textures) gl.deleteTexture(texture);
    gl.deleteProgram(this.program);
    gl.deleteTransformFeedback(this.feedback);
    gl.deleteVertexArray(this.array);
  }

  /**
   * Make room for n points, and keep those that are there. Returns whether there are new buffers.
   * @param {number} n
   */
  reserve(n) {
    if (n <= this.capacity) return false;
    const { gl, buffers: old, count } = this;
    this.buffers = [
      grown(gl, old?.[0], count * POINT_BYTES, n * POINT_BYTES),
      grown(gl, old?.[1], count * PAINT_BYTES, n * PAINT_BYTES),
    ];
    old?.forEach((buffer) => gl.deleteBuffer(buffer));
    this.capacity = n;
    return true;
  }

  /**
   * Have the card compute points; it does so later.
   * @param {number} begin
   * @param {number} n
   */
  draw(begin, n) {
    const { gl } = this;
    gl.useProgram(this.program);
    gl.bindVertexArray(this.array);
    this.#set(begin);
    gl.bindBuffer(gl.ARRAY_BUFFER, null); // three.js may have left the points there, which then cannot be written
    gl.bindTransformFeedback(gl.TRANSFORM_FEEDBACK, this.feedback);
    [POINT_BYTES, PAINT_BYTES].forEach((size, index) => {
      const buffer = this.buffers?.[index] ?? null;
      gl.bindBufferRange(gl.TRANSFORM_FEEDBACK_BUFFER, index, buffer, begin * size, n * size);
    });
    gl.enable(gl.RASTERIZER_DISCARD);
    gl.beginTransformFeedback(gl.POINTS);
    gl.drawArrays(gl.POINTS, 0, n);
    gl.endTransformFeedback();
    gl.disable(gl.RASTERIZER_DISCARD);
    for (const index of [0, 1]) gl.bindBufferBase(gl.TRANSFORM_FEEDBACK_BUFFER, index, null);
    gl.bindTransformFeedback(gl.TRANSFORM_FEEDBACK, null);
  }

  /**
   * Set the uniforms for the points from `begin` on.
   * @param {number} begin
   */
  #set(begin) {
    const { gl, functions } = this;
    const { word, frame, colorShares } = this.form;
    const at = (/** @type {string} */ name) => gl.getUniformLocation(this.program, name);
    gl.uniform1ui(at("begin"), begin);
    gl.uniform2ui(at("seed"), Number(this.seed & 0xffffffffn), Number(this.seed >> 32n));
    gl.uniform1i(at("domain"), DOMAINS[functions.spec.domain]);
    gl.uniform1i(at("units"), functions.spec.hidden[0]);
    gl.uniform1i(at("k"), word.length);
    gl.uniform2iv(at("word"), word.flatMap(([row, other]) => [row, other]));
    gl.uniform1fv(at("blend"), word.map(([, , blend]) => blend));
    const corners = frame.high.map((high, axis) => /** @type {const} */ ([frame.low[axis], high]));
    const longest = Math.max(...corners.map(([low, high]) => high - low));
    gl.uniform3fv(at("center"), corners.map(([low, high]) => (high + low) / 2));
    gl.uniform1f(at("factor"), 1 / (longest > 1e-20 ? longest : 1));
    gl.uniform1i(at("colorUnits"), functions.colorSpec?.hidden[0] ?? 0);
    gl.uniform1i(at("colorRows"), functions.colorRows.length);
    if (colorShares.length) gl.uniform1fv(at("colorShares"), colorShares);
    ["thetas", "colors"].forEach((name, unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, this.textures[unit] ?? this.textures[0] ?? null);
      gl.uniform1i(at(name), unit);
    });
  }

  /** Resolve when the card has done all that was asked of it. */
  #finished() {
    const { gl } = this;
    const fence = /** @type {WebGLSync} */ (gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0));
    gl.flush();
    return new Promise((/** @type {(_?: void) => void} */ done, failed) => {
      const look = () => {
        const status = gl.clientWaitSync(fence, 0, 0);
        if (status === gl.TIMEOUT_EXPIRED) return void setTimeout(look, 2);
        gl.deleteSync(fence);
        if (status === gl.WAIT_FAILED || gl.isContextLost()) failed(new Error("the graphics card gave up"));
        else done();
      };
      setTimeout(look, 0);
    });
  }
}

/** @param {WebGL2RenderingContext} gl */
function linked(gl) {
  const program = gl.createProgram();
  for (const [kind, source] of /** @type {const} */ ([[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]])) {
    const shader = /** @type {WebGLShader} */ (gl.createShader(kind));
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
    gl.deleteShader(shader);
  }
  gl.transformFeedbackVaryings(program, ["point", "paint"], gl.SEPARATE_ATTRIBS);
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) ?? "no program");
  return program;
}

/**
 * Put functions of one spec into a float texture, one a row: see shader.js.
 * @param {WebGL2RenderingContext} gl
 * @param {Spec} spec
 * @param {Float32Array[]} rows
 */
function textureOf(gl, { hidden }, rows) {
  const [units] = hidden;
  const width = 2 * units + 1;
  const texels = new Float32Array(4 * width * rows.length);
  rows.forEach((theta, row) => {
    const [bias, second] = [3 * units, 4 * units]; // places in theta: W, b, V, c
    for (let unit = 0; unit < units; unit++) {
      const at = 4 * (width * row + 2 * unit);
      texels.set(theta.subarray(3 * unit, 3 * unit + 3), at);
      texels[at + 3] = theta[bias + unit];
      for (let axis = 0; axis < 3; axis++) texels[at + 4 + axis] = theta[second + axis * units + unit];
    }
    texels.set(theta.subarray(second + 3 * units), 4 * (width * row + 2 * units));
  });
  const texture = gl.createTexture();
  gl.activeTexture(gl.TEXTURE0);
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, false);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, width, rows.length, 0, gl.RGBA, gl.FLOAT, texels);
  for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
  return texture;
}

/**
 * Return a new buffer of `size` bytes, with the first `kept` bytes of another one.
 * @param {WebGL2RenderingContext} gl
 * @param {WebGLBuffer | undefined} old
 * @param {number} kept
 * @param {number} size
 */
function grown(gl, old, kept, size) {
  const buffer = gl.createBuffer();
  gl.bindBuffer(gl.COPY_WRITE_BUFFER, buffer);
  gl.bufferData(gl.COPY_WRITE_BUFFER, size, gl.DYNAMIC_COPY);
  if (gl.getError() === gl.OUT_OF_MEMORY) throw new Error("the graphics card has no memory left");
  if (old && kept) {
    gl.bindBuffer(gl.COPY_READ_BUFFER, old);
    gl.copyBufferSubData(gl.COPY_READ_BUFFER, gl.COPY_WRITE_BUFFER, 0, 0, kept);
    gl.bindBuffer(gl.COPY_READ_BUFFER, null);
  }
  gl.bindBuffer(gl.COPY_WRITE_BUFFER, null);
  return buffer;
}
