// Draws clouds and surfaces in a grid, all from the same camera, softly lit; pointer and keys turn them.
import { Color, MathUtils, PerspectiveCamera, Spherical, WebGLRenderer } from "three";
import { OrbitControls } from "three/controls";

import { colors, isDark, onColorsChange } from "./colors.js";
import { EyeDome } from "./eyedome.js";
import { pointMaterials } from "./points.js";
import { surfaceMaterials } from "./surface.js";
import { Turntable } from "./turntable.js";

const DISTANCE = 3.1; // of the camera; the longest side of an object is 1
const FIELD_OF_VIEW = 26; // degrees
const START = { azimuth: 30, elevation: 20 }; // degrees; azimuth 0 looks at the front
const STEP = 10; // degrees per key press
const ZOOM = 1.15; // factor per key press
const POINT_SIZE = { least: 1.5, most: 10, share: 2.2 }; // CSS pixels; share of a cell's side divided by sqrt(n)
const [TOO_LIGHT, TOO_DARK] = [0.7, 0.25]; // mean lightness of objects that a light or a dark stage would hide
const MAX_RATIO = 2; // device pixels per CSS pixel; more cannot be told apart and takes a phone's battery

export class Stage {
  /** Throws if the browser has no WebGL. */
  constructor(canvas) {
    this.canvas = canvas;
    this.clouds = [];
    this.shown = 0; // points to draw of each cloud
    this.dotSize = 1; // factor
    this.inColor = true;
    this.onDraw = () => {}; // called after each frame
    this.renderer = new WebGLRenderer({ canvas, alpha: true, antialias: false }); // the target of EyeDome is smoothed
    this.renderer.setClearColor(0x000000, 0);
    this.renderer.autoClear = false;
    this.uniforms = {
      size: { value: 2 },
      distance: { value: DISTANCE },
      near: { value: new Color() },
      far: { value: new Color() },
    };
    this.materials = { points: pointMaterials(this.uniforms), surface: surfaceMaterials(this.uniforms) };
    this.eyeDome = new EyeDome();
    this.camera = new PerspectiveCamera(FIELD_OF_VIEW, 1, 0.1, 20);
    this.#control();
    this.turntable = new Turntable(canvas, this.controls);
    onColorsChange(() => this.redraw());
    this.reset();
  }

  #control() {
    this.controls = new OrbitControls(this.camera, this.canvas);
    this.controls.enablePan = false;
    this.controls.minDistance = 1;
    this.controls.maxDistance = 8;
    this.controls.addEventListener("change", () => this.redraw());
    this.canvas.style.touchAction = "pan-y"; // one finger: up and down scroll the page, across turns the object
    this.canvas.addEventListener("keydown", (event) => this.#key(event));
    new ResizeObserver(() => this.redraw()).observe(this.canvas);
  }

  /** Show these clouds and no others, on a slow turntable until the visitor takes over. */
  set(clouds) {
    for (const cloud of this.clouds) cloud.dispose();
    this.clouds = clouds;
    if (clouds.length) this.turntable.start();
    this.redraw();
  }

  /** Show the first n points of each cloud. */
  show(n) {
    this.shown = n;
    this.redraw();
  }

  /** Draw points larger or smaller by a factor. */
  resizeDots(factor) {
    this.dotSize = factor;
    this.redraw();
  }

  /** Show objects in color, or all shaded. */
  paint(inColor) {
    this.inColor = inColor;
    this.redraw();
  }

  /** Columns and rows of the cells. */
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

  /** Look as a camera does: {azimuth, elevation}, degrees, and distance from the object's center. */
  lookFrom({ azimuth, elevation, distance }) {
    this.turntable.stop();
    const radius = MathUtils.clamp(distance, this.controls.minDistance, this.controls.maxDistance);
    this.#look(new Spherical(radius, MathUtils.degToRad(90 - elevation), MathUtils.degToRad(azimuth)));
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
    const ratio = Math.min(devicePixelRatio, MAX_RATIO);
    const [cellWidth, cellHeight] = [width / columns, height / rows];
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
    this.#uniforms(Math.min(cellWidth, cellHeight), ratio);
    this.camera.aspect = cellWidth / cellHeight;
    this.camera.fov = this.camera.aspect < 1 ? FIELD_OF_VIEW / this.camera.aspect : FIELD_OF_VIEW;
    this.camera.updateProjectionMatrix();
    this.#tone();
    this.eyeDome.begin(this.renderer, width * ratio, height * ratio);
    this.clouds.forEach((cloud, index) => {
      cloud.show(this.shown);
      cloud.paint(this.inColor);
      const [x, y] = [index % columns, Math.floor(index / columns)];
      const cell = [x * cellWidth, height - (y + 1) * cellHeight, cellWidth, cellHeight].map((side) => side * ratio);
      this.eyeDome.draw(this.renderer, cell, cloud.scene, this.camera);
    });
    this.eyeDome.end(this.renderer, this.camera);
    this.onDraw();
  }

  /** Make the stage light or dark, as the page is, unless the objects would be lost on it. */
  #tone() {
    const lightnesses = this.inColor ? this.clouds.map((cloud) => cloud.lightness).filter((each) => each) : [];
    const mean = lightnesses.reduce((sum, each) => sum + each, 0) / lightnesses.length; // NaN for none: as the page
    const dark = isDark() ? !(mean < TOO_DARK) : mean > TOO_LIGHT;
    this.canvas.parentElement.dataset.tone = dark ? "dark" : "light";
  }

  #uniforms(side, ratio) {
    const { uniforms } = this;
    const { least, most, share } = POINT_SIZE;
    const arrived = Math.min(this.shown, ...this.clouds.map((cloud) => cloud.count)); // few are drawn larger
    const size = MathUtils.clamp((share * side) / Math.sqrt(arrived || 1), least, most);
    uniforms.size.value = ratio * this.dotSize * size;
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
    this.turntable.stop();
    event.preventDefault();
  }
}
