// Draws clouds in a grid, all from the same camera; pointer and keys turn them.
import { Color, MathUtils, PerspectiveCamera, ShaderMaterial, Spherical, WebGLRenderer } from "three";
import { OrbitControls } from "three/controls";

import { colors, onColorsChange } from "./colors.js";
import { surfaceMaterials } from "./surface.js";

const DISTANCE = 3.1; // of the camera; the longest side of an object is 1
const FIELD_OF_VIEW = 26; // degrees
const START = { azimuth: 30, elevation: 20 }; // degrees; azimuth 0 looks at the front
const STEP = 10; // degrees per key press
const ZOOM = 1.15; // factor per key press
const DIMMEST = 0.7; // brightness of the farthest points, as a share of their color
const POINT_SIZE = { least: 1.4, most: 4, share: 0.42 }; // CSS pixels; share of a cell's side divided by sqrt(n)

const VERTEX = `
  uniform float size;
  uniform float distance;
  varying float depth; // 0 nearest, 1 farthest
  #ifdef PAINTED
    attribute vec3 bgr; // sRGB
    varying vec3 paint;
  #endif
  void main() {
    #ifdef PAINTED
      paint = bgr.bgr;
    #endif
    vec4 viewed = modelViewMatrix * vec4(position, 1.0);
    depth = clamp(-viewed.z - distance + 0.5, 0.0, 1.0);
    gl_Position = projectionMatrix * viewed;
    gl_PointSize = size;
  }`;
const FRAGMENT = `
  uniform vec3 near;
  uniform vec3 far;
  varying float depth;
  #ifdef PAINTED
    varying vec3 paint;
  #endif
  void main() {
    if (length(gl_PointCoord - 0.5) > 0.5) discard;
    #ifdef PAINTED
      gl_FragColor = vec4(mix(1.0, DIMMEST, depth) * paint, 1.0);
    #else
      gl_FragColor = vec4(mix(near, far, depth), 1.0);
    #endif
  }`;

export class Stage {
  /** Throws if the browser has no WebGL. */
  constructor(canvas) {
    this.canvas = canvas;
    this.clouds = [];
    this.shown = 0; // points to draw of each cloud
    this.renderer = new WebGLRenderer({ canvas, alpha: true, antialias: true });
    this.renderer.setClearColor(0x000000, 0);
    this.inColor = true;
    this.uniforms = {
      size: { value: 2 },
      distance: { value: DISTANCE },
      near: { value: new Color() },
      far: { value: new Color() },
    };
    this.materials = {
      points: { shaded: this.#material({}), painted: this.#material({ PAINTED: "", DIMMEST }) },
      surface: surfaceMaterials(this.uniforms),
    };
    this.camera = new PerspectiveCamera(FIELD_OF_VIEW, 1, 0.1, 20);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enablePan = false;
    this.controls.minDistance = 1;
    this.controls.maxDistance = 8;
    this.controls.addEventListener("change", () => this.redraw());
    canvas.addEventListener("keydown", (event) => this.#key(event));
    new ResizeObserver(() => this.redraw()).observe(canvas);
    onColorsChange(() => this.redraw());
    this.reset();
  }

  /** Show these clouds and no others. */
  set(clouds) {
    for (const cloud of this.clouds) cloud.dispose();
    this.clouds = clouds;
    this.redraw();
  }

  /** Show the first n points of each cloud. */
  show(n) {
    this.shown = n;
    this.redraw();
  }

  /** Show objects in color, or all shaded. */
  paint(inColor) {
    this.inColor = inColor;
    this.redraw();
  }

  /** Columns and rows of the grid, as square as possible. */
  get grid() {
    const columns = Math.max(1, Math.ceil(Math.sqrt(this.clouds.length)));
    return { columns, rows: Math.max(1, Math.ceil(this.clouds.length / columns)) };
  }

  /** Return the camera to its start. */
  reset() {
    this.#look(
      new Spherical(DISTANCE, MathUtils.degToRad(90 - START.elevation), MathUtils.degToRad(START.azimuth)),
    );
  }

  /** Draw in the next frame. */
  redraw() {
    this.frame ??= requestAnimationFrame(() => {
      this.frame = undefined;
      this.#draw();
    });
  }

  #draw() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    const { columns, rows } = this.grid;
    const [cellWidth, cellHeight] = [width / columns, height / rows];
    const ratio = devicePixelRatio;
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
    this.#uniforms(Math.min(cellWidth, cellHeight), ratio);
    this.camera.aspect = cellWidth / cellHeight;
    this.camera.fov = this.camera.aspect < 1 ? FIELD_OF_VIEW / this.camera.aspect : FIELD_OF_VIEW;
    this.camera.updateProjectionMatrix();
    this.renderer.setScissorTest(false);
    this.renderer.clear();
    this.renderer.setScissorTest(true);
    this.clouds.forEach((cloud, index) => {
      cloud.show(this.shown);
      cloud.paint(this.inColor);
      const [x, y] = [index % columns, Math.floor(index / columns)];
      const cell = [x * cellWidth, height - (y + 1) * cellHeight, cellWidth, cellHeight];
      this.renderer.setViewport(...cell);
      this.renderer.setScissor(...cell);
      this.renderer.render(cloud.scene, this.camera);
    });
  }

  #material(defines) {
    return new ShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      uniforms: this.uniforms,
      defines,
    });
  }

  #uniforms(side, ratio) {
    const { uniforms } = this;
    const { least, most, share } = POINT_SIZE;
    uniforms.size.value = ratio * MathUtils.clamp((share * side) / Math.sqrt(this.shown || 1), least, most);
    uniforms.distance.value = this.camera.position.length();
    const { near, far } = colors();
    uniforms.near.value.setRGB(...near.map((channel) => channel / 255));
    uniforms.far.value.setRGB(...far.map((channel) => channel / 255));
  }

  #look(spherical) {
    this.camera.position.setFromSpherical(spherical.makeSafe());
    this.controls.update();
    this.redraw();
  }

  #key(event) {
    const at = new Spherical().setFromVector3(this.camera.position);
    const step = MathUtils.degToRad(STEP);
    const { minDistance, maxDistance } = this.controls;
    const moves = {
      ArrowLeft: () => (at.theta += step),
      ArrowRight: () => (at.theta -= step),
      ArrowUp: () => (at.phi -= step),
      ArrowDown: () => (at.phi += step),
      "+": () => (at.radius = Math.max(minDistance, at.radius / ZOOM)),
      "-": () => (at.radius = Math.min(maxDistance, at.radius * ZOOM)),
    };
    if (event.key === "Home") this.reset();
    else if (moves[event.key]) {
      moves[event.key]();
      at.phi = MathUtils.clamp(at.phi, 0.01, Math.PI - 0.01);
      this.#look(at);
    } else return;
    event.preventDefault();
  }
}
