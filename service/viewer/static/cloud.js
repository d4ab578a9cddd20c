// The points of one object, on the graphics card, and its surface where that is asked for.
import { BufferAttribute, BufferGeometry, DynamicDrawUsage, Points, Scene } from "three";

import { BYTES_PER_POINT } from "./api.js";

/** Points that arrive in order: the first m of n are those of m, so that more of them are appended. */
export class Cloud {
  constructor(object, material) {
    this.object = object;
    this.scene = new Scene();
    this.points = new Points(new BufferGeometry(), material);
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
    return Math.floor(this.filled / BYTES_PER_POINT);
  }

  /** Make room for n points and drop a point that arrived in part. */
  reserve(n) {
    this.filled = this.count * BYTES_PER_POINT;
    if (n * BYTES_PER_POINT <= this.bytes.length) return;
    const bytes = new Uint8Array(n * BYTES_PER_POINT);
    bytes.set(this.bytes.subarray(0, this.filled));
    this.bytes = bytes;
    this.points.geometry.dispose();
    this.points.geometry = new BufferGeometry();
    const positions = new BufferAttribute(new Float32Array(bytes.buffer), 3).setUsage(DynamicDrawUsage);
    this.points.geometry.setAttribute("position", positions);
  }

  /** Append bytes of float32 positions. */
  append(bytes) {
    const positions = this.points.geometry.getAttribute("position");
    const before = this.count;
    this.bytes.set(bytes, this.filled);
    this.filled += bytes.length;
    positions.addUpdateRange(3 * before, 3 * (this.count - before));
    positions.needsUpdate = true;
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
