// One object on the graphics card: points that were fetched or computed there, or its surface.
import {
  BufferGeometry,
  DynamicDrawUsage,
  InterleavedBuffer,
  InterleavedBufferAttribute,
  Points,
  Scene,
} from "three";

import { shadowOf } from "./ground.js";
import { bytesPerPoint } from "../objects.js";

const MEASURED = 1000; // points that tell an object's lightness

/** A growing cloud. The first m of n points are the points of m, so a larger cloud only appends. */
export class Cloud {
  /** `materials`: {points, surface}, each {shaded, painted}; `painted` is for objects with color. */
  constructor(object, materials) {
    this.object = object;
    this.size = bytesPerPoint(object); // bytes of a point
    this.materials = materials;
    this.scene = new Scene();
    this.points = new Points(new BufferGeometry(), materials.points.shaded);
    this.points.frustumCulled = false; // always in view: an object fills the object frame
    this.scene.add(this.points);
    if (object.dimensions) this.shadow = shadowOf(object.dimensions); // lists lack those of older objects
    if (this.shadow) this.scene.add(this.shadow);
    this.clear();
  }

  /** Remove all points. */
  clear() {
    this.setComputed();
    this.bytes = new Uint8Array(0);
    this.filled = 0; // bytes received
  }

  /** Number of points that have arrived in full, or were computed. */
  get count() {
    if (this.computed) return this.computed.done;
    return Math.floor(this.filled / this.size);
  }

  /** Make room for n points and drop a partly received one. */
  reserve(n) {
    this.filled = this.count * this.size;
    if (n * this.size <= this.bytes.length) return;
    const bytes = new Uint8Array(n * this.size);
    bytes.set(this.bytes.subarray(0, this.filled));
    this.bytes = bytes;
    this.points.geometry.dispose();
    this.points.geometry = new BufferGeometry();
    this.buffers = [this.#attribute("position", Float32Array, 0)];
    if (this.object.color) this.buffers.push(this.#attribute("bgr", Uint8Array, 12));
  }

  /** Append the bytes of points. */
  append(bytes) {
    const before = this.count;
    this.bytes.set(bytes, this.filled);
    this.filled += bytes.length;
    for (const buffer of this.buffers) {
      buffer.addUpdateRange(buffer.stride * before, buffer.stride * (this.count - before));
      buffer.needsUpdate = true;
    }
  }

  /**
   * Mean lightness of the colors, from 0 to 1; undefined without colors, and before any has arrived. Kept once it is
   * measured on a surface or on enough points: the two differ a little, and the stage's tone must not turn with it.
   */
  get lightness() {
    if (this.kept === undefined) {
      const lightness = this.#lightness();
      if (!this.surface && this.count < MEASURED) return lightness;
      this.kept = lightness;
    }
    return this.kept;
  }

  #lightness() {
    const paint = this.surface?.geometry.getAttribute("paint");
    if (paint) return mean(paint.array, 1) ** (1 / 2.2);
    if (this.computed) return this.computed.lightness;
    if (!this.object.color || !this.count) return undefined;
    const channels = [12, 13, 14].map((first) => mean(this.bytes.subarray(first, this.count * this.size), this.size));
    return channels.reduce((sum, channel) => sum + channel) / (3 * 255);
  }

  /** Choose the material: painted if `inColor` and the object has color, else shaded. */
  paint(inColor) {
    const kind = inColor && this.object.color ? "painted" : "shaded";
    this.points.material = this.materials.points[kind];
    if (this.computed) this.computed.points.material = this.materials.points[kind];
    if (this.surface) this.surface.material = this.materials.surface[kind];
  }

  /** Add an attribute: three numbers of each point from its byte `offset` on, as a view that copies nothing. */
  #attribute(name, Numbers, offset) {
    const size = Numbers.BYTES_PER_ELEMENT;
    const buffer = new InterleavedBuffer(new Numbers(this.bytes.buffer), this.size / size).setUsage(DynamicDrawUsage);
    const attribute = new InterleavedBufferAttribute(buffer, 3, offset / size, Numbers === Uint8Array);
    this.points.geometry.setAttribute(name, attribute);
    return buffer;
  }

  /** Draw the first n points, at most those that have arrived. */
  show(n) {
    if (this.computed) this.computed.show(n);
    else this.points.geometry.setDrawRange(0, Math.min(n, this.count));
    if (this.shadow) this.shadow.visible = Boolean(this.surface || this.count);
  }

  /** Draw a surface (Mesh) instead of the points; without an argument, draw the points again. */
  setSurface(mesh) {
    if (this.surface) {
      this.scene.remove(this.surface);
      this.surface.geometry.dispose();
    }
    this.surface = mesh;
    if (mesh) this.scene.add(mesh);
    this.points.visible = !mesh && !this.computed;
    if (this.computed) this.computed.points.visible = !mesh;
  }

  /** Draw points that are computed here (ComputedPoints); without an argument, those that were fetched. */
  setComputed(computed) {
    if (this.computed) {
      this.scene.remove(this.computed.points);
      this.computed.dispose();
    }
    this.computed = computed;
    if (computed) {
      computed.points.visible = !this.surface;
      this.scene.add(computed.points);
    }
    this.points.visible = !this.surface && !computed;
  }

  dispose() {
    this.setSurface();
    this.setComputed();
    this.points.geometry.dispose();
  }
}

/** Mean of every `step`-th number, of up to a thousand of them. */
function mean(numbers, step) {
  const stride = step * Math.max(1, Math.floor(numbers.length / step / 1000));
  let [sum, count] = [0, 0];
  for (let at = 0; at < numbers.length; at += stride, count++) sum += numbers[at];
  return sum / count;
}
