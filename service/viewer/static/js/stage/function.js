// An object's functions on the graphics card, and the points that they give there. Nothing but theta is fetched.
import { BufferGeometry, GLBufferAttribute, Points, Sphere } from "three";

import { FRAGMENT, VERTEX } from "./function_shader.js";

const DOMAINS = { ball: 0, sphere: 1, cube: 2 };
const MAX_K = 8;
const MAX_UNITS = 4000; // of the hidden layer: two texels each, in a texture as wide as every card allows
const PART = { first: 16_384, least: 4096, most: 1_048_576 }; // points of one draw call
const [TOO_FAST_MS, TOO_SLOW_MS] = [15, 60]; // of a draw call
const POINT_BYTES = 12;
const PAINT_BYTES = 4;

/** Whether the shader can be an object's function: one hidden layer of ReLUs from 3D to 3D. */
export function isComputable({ spec, color, frame }) {
  const isSuited = ({ hidden, activation, input_dim: inputs, output_dim: outputs }) =>
    hidden.length === 1 && hidden[0] <= MAX_UNITS && activation === "relu" && inputs === 3 && outputs === 3;
  return isSuited(spec) && spec.k <= MAX_K && spec.domain in DOMAINS && Boolean(frame) && (!color || isSuited(color));
}

/** Points of functions, computed part by part. */
export class ComputedPoints {
  /** `functions`: of object/weights.js, {spec, rows, colorSpec, colorRows}; for the rest see `change`. */
  constructor(renderer, functions, form, seed = 0n) {
    this.renderer = renderer;
    this.gl = renderer.getContext();
    this.functions = functions;
    this.seed = BigInt(seed);
    this.part = PART.first;
    this.capacity = 0;
    this.count = 0; // points that can be drawn
    this.points = new Points(new BufferGeometry());
    this.points.frustumCulled = false;
    this.#build();
    this.change(form);
  }

  /**
   * Compute other points with the same functions. Those that are there are drawn until then.
   * `form`: {word, frame, colorShares}. `word`: of each step [row, other row, blend], the last one applied first; the
   * step is a blend of the two. `frame`: {low, high}, the box. `colorShares`: of each row of colors; 1 in all.
   */
  change(form) {
    this.form = form;
    this.done = 0; // points computed in this form
  }

  /** Compute one more part of n points, after the part that is being computed. Resolves when the card has done it. */
  async extend(n) {
    const before = this.busy;
    let end;
    this.busy = new Promise((done) => (end = done));
    try {
      await before;
      if (!this.isDisposed) await this.#extend(n);
    } finally {
      end();
    }
  }

  async #extend(n) {
    this.#reserve(n);
    const { form } = this;
    const more = Math.min(this.part, n - this.done);
    if (more <= 0) return;
    const began = performance.now();
    this.#draw(this.done, more);
    await this.#finished();
    if (form !== this.form) return;
    this.done += more;
    this.count = Math.max(this.count, this.done);
    const took = performance.now() - began;
    if (took < TOO_FAST_MS) this.part = Math.min(PART.most, 2 * this.part);
    else if (took > TOO_SLOW_MS) this.part = Math.max(PART.least, this.part / 2);
  }

  /** Read points back: {points: Float32Array, paint: Uint8Array of blue, green, red, 0}. */
  read(begin, n) {
    const { gl } = this;
    const [points, paint] = [new Float32Array(3 * n), new Uint8Array(PAINT_BYTES * n)];
    for (const [buffer, size, array] of [[this.buffers[0], POINT_BYTES, points], [this.buffers[1], PAINT_BYTES, paint]]) {
      gl.bindBuffer(gl.COPY_READ_BUFFER, buffer);
      gl.getBufferSubData(gl.COPY_READ_BUFFER, begin * size, array);
    }
    gl.bindBuffer(gl.COPY_READ_BUFFER, null);
    return { points, paint };
  }

  /** Mean lightness of the colors, from 0 to 1; undefined without colors, and before any was computed. */
  get lightness() {
    if (!this.functions.colorRows.length || !this.count) return undefined;
    this.mean ??= meanOf(this.read(0, Math.min(this.count, 1000)).paint);
    return this.mean;
  }

  /** Draw the first n points, at most those that can be drawn. */
  show(n) {
    this.points.geometry.setDrawRange(0, Math.min(n, this.count));
  }

  dispose() {
    const { gl } = this;
    this.isDisposed = true;
    for (const buffer of this.buffers ?? []) gl.deleteBuffer(buffer);
    for (const texture of this.textures) gl.deleteTexture(texture);
    gl.deleteProgram(this.program);
    gl.deleteTransformFeedback(this.feedback);
    gl.deleteVertexArray(this.array);
    this.points.geometry.dispose();
  }

  #build() {
    const { gl, functions } = this;
    this.program = linked(gl);
    this.feedback = gl.createTransformFeedback();
    this.array = gl.createVertexArray();
    this.textures = [textureOf(gl, functions.spec, functions.rows)];
    if (functions.colorSpec) this.textures.push(textureOf(gl, functions.colorSpec, functions.colorRows));
    this.renderer.resetState();
  }

  /** Make room for n points, and keep those that are there. */
  #reserve(n) {
    if (n <= this.capacity) return;
    const { gl } = this;
    const buffers = [POINT_BYTES, PAINT_BYTES].map((size, index) => grown(gl, this.buffers?.[index], this.count * size, n * size));
    this.buffers?.forEach((buffer) => gl.deleteBuffer(buffer));
    this.buffers = buffers;
    this.capacity = n;
    this.points.geometry.dispose();
    this.points.geometry = new BufferGeometry();
    this.points.geometry.boundingSphere = new Sphere(); // three.js cannot measure these points
    const [point, paint] = buffers;
    this.points.geometry.setAttribute("position", new GLBufferAttribute(point, gl.FLOAT, 3, 4, n));
    this.points.geometry.setAttribute("bgr", new GLBufferAttribute(paint, gl.UNSIGNED_BYTE, 4, 1, n, true));
    this.renderer.resetState();
  }

  #draw(begin, n) {
    const { gl } = this;
    gl.useProgram(this.program);
    gl.bindVertexArray(this.array);
    this.#set(begin);
    gl.bindBuffer(gl.ARRAY_BUFFER, null); // three.js may have left the points there, which then cannot be written
    gl.bindTransformFeedback(gl.TRANSFORM_FEEDBACK, this.feedback);
    [POINT_BYTES, PAINT_BYTES].forEach((size, index) => {
      gl.bindBufferRange(gl.TRANSFORM_FEEDBACK_BUFFER, index, this.buffers[index], begin * size, n * size);
    });
    gl.enable(gl.RASTERIZER_DISCARD);
    gl.beginTransformFeedback(gl.POINTS);
    gl.drawArrays(gl.POINTS, 0, n);
    gl.endTransformFeedback();
    gl.disable(gl.RASTERIZER_DISCARD);
    for (const index of [0, 1]) gl.bindBufferBase(gl.TRANSFORM_FEEDBACK_BUFFER, index, null);
    gl.bindTransformFeedback(gl.TRANSFORM_FEEDBACK, null);
    this.renderer.resetState();
  }

  /** Set the uniforms for the points from `begin` on. */
  #set(begin) {
    const { gl, functions } = this;
    const { word, frame, colorShares } = this.form;
    const at = (name) => gl.getUniformLocation(this.program, name);
    gl.uniform1ui(at("begin"), begin);
    gl.uniform2ui(at("seed"), Number(this.seed & 0xffffffffn), Number(this.seed >> 32n));
    gl.uniform1i(at("domain"), DOMAINS[functions.spec.domain]);
    gl.uniform1i(at("units"), functions.spec.hidden[0]);
    gl.uniform1i(at("k"), word.length);
    gl.uniform2iv(at("word"), word.flatMap(([row, other]) => [row, other]));
    gl.uniform1fv(at("blend"), word.map(([, , blend]) => blend));
    const sides = frame.high.map((high, axis) => high - frame.low[axis]);
    gl.uniform3fv(at("center"), frame.high.map((high, axis) => (high + frame.low[axis]) / 2));
    gl.uniform1f(at("factor"), 1 / (Math.max(...sides) > 1e-20 ? Math.max(...sides) : 1));
    gl.uniform1i(at("colorUnits"), functions.colorSpec?.hidden[0] ?? 0);
    gl.uniform1i(at("colorRows"), functions.colorRows.length);
    if (colorShares.length) gl.uniform1fv(at("colorShares"), colorShares);
    ["thetas", "colors"].forEach((name, unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, this.textures[unit] ?? this.textures[0]);
      gl.uniform1i(at(name), unit);
    });
  }

  /** Resolve when the card has done all that was asked of it. */
  #finished() {
    const { gl } = this;
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    return new Promise((done, failed) => {
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

/** Mean of blue, green and red of points, four bytes each. */
function meanOf(paint) {
  const sum = paint.reduce((total, byte) => total + byte); // every fourth byte is 0
  return sum / (0.75 * 255 * paint.length);
}

function linked(gl) {
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
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

/** Put functions of one spec into a float texture, one a row: see function_shader.js. */
function textureOf(gl, { hidden: [units] }, rows) {
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

/** Return a new buffer of `size` bytes, with the first `kept` bytes of another one. */
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
