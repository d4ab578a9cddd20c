// The points of one object, on the graphics card, and its surface where that is asked for.
import {
  BufferGeometry,
  DynamicDrawUsage,
  InterleavedBuffer,
  InterleavedBufferAttribute,
  Points,
  Scene,
} from "three";

import { bytesPerPoint } from "./api.js";

/** Points that arrive in order: the first m of n are those of m, so that more of them are appended. */
export class Cloud {
  /** `materials` of points and of surfaces: what shades them, and what paints those of objects in color. */
  constructor(object, materials) {
    this.object = object;
    this.size = bytesPerPoint(object); // of a point, bytes
    this.materials = materials;
    this.scene = new Scene();
    this.points = new Points(new BufferGeometry(), materials?.points.shaded);
    this.points.frustumCulled = false; // its bounds are those of the object frame
    this.scene.add(this.points);
    this.clear();
  }

  /** Forget all points. */
  clear() {
    this.bytes = new Uint8Array(0);
    this.filled = 0; // of bytes
  }

  /** How many points have arrived whole. */
  get count() {
    return Math.floor(this.filled / this.size);
  }

  /** Make room for n points and drop a point that arrived in part. */
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

  /** Append bytes of points. */
  append(bytes) {
    const before = this.count;
    this.bytes.set(bytes, this.filled);
    this.filled += bytes.length;
    for (const buffer of this.buffers) {
      buffer.addUpdateRange(buffer.stride * before, buffer.stride * (this.count - before));
      buffer.needsUpdate = true;
    }
  }

  /** Show the object's colors, if it has any, or shades. */
  paint(inColor) {
    const way = inColor && this.object.color ? "painted" : "shaded";
    this.points.material = this.materials.points[way];
    if (this.surface) this.surface.material = this.materials.surface[way];
  }

  /** Three numbers of each point, from its byte `offset` on: a view of the bytes, so that nothing is copied. */
  #attribute(name, Numbers, offset) {
    const size = Numbers.BYTES_PER_ELEMENT;
    const buffer = new InterleavedBuffer(new Numbers(this.bytes.buffer), this.size / size).setUsage(DynamicDrawUsage);
    const attribute = new InterleavedBufferAttribute(buffer, 3, offset / size, Numbers === Uint8Array);
    this.points.geometry.setAttribute(name, attribute);
    return buffer;
  }

  /** Draw the first n points, or as many as there are. */
  show(n) {
    this.points.geometry.setDrawRange(0, Math.min(n, this.count));
  }

  /** Draw a surface (Mesh) in place of the points; none brings them back. */
  setSurface(mesh) {
    if (this.surface) {
      this.scene.remove(this.surface);
      this.surface.geometry.dispose();
    }
    this.surface = mesh;
    if (mesh) this.scene.add(mesh);
    this.points.visible = !mesh;
  }

  dispose() {
    this.setSurface();
    this.points.geometry.dispose();
  }
}
