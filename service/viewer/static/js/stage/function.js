// Points that the graphics card computes of an object's functions, as an object of three.js.
import { BufferGeometry, GLBufferAttribute, Points, Sphere } from "three";

import { CardPoints } from "../function/card.js";

/** Points of functions, computed part by part where three.js draws them. */
export class ComputedPoints extends CardPoints {
  /** `functions` and `form`: see function/weights.js. */
  constructor(renderer, functions, form, seed = 0n) {
    super(renderer.getContext(), functions, form, seed);
    this.renderer = renderer;
    this.points = new Points(new BufferGeometry());
    this.points.frustumCulled = false;
    renderer.resetState();
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
    super.dispose();
    this.points.geometry.dispose();
  }

  reserve(n) {
    if (!super.reserve(n)) return false;
    const { gl } = this;
    this.points.geometry.dispose();
    this.points.geometry = new BufferGeometry();
    this.points.geometry.boundingSphere = new Sphere(); // three.js cannot measure these points
    const [point, paint] = this.buffers;
    this.points.geometry.setAttribute("position", new GLBufferAttribute(point, gl.FLOAT, 3, 4, n));
    this.points.geometry.setAttribute("bgr", new GLBufferAttribute(paint, gl.UNSIGNED_BYTE, 4, 1, n, true));
    this.renderer.resetState();
    return true;
  }

  draw(begin, n) {
    super.draw(begin, n);
    this.renderer.resetState();
  }
}

/** Mean of blue, green and red of points, four bytes each. */
function meanOf(paint) {
  const sum = paint.reduce((total, byte) => total + byte); // every fourth byte is 0
  return sum / (0.75 * 255 * paint.length);
}
