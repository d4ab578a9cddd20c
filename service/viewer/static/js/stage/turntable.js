// Turns the object slowly until the visitor touches it.

const SPEED = 1; // of OrbitControls: a turn in 60 seconds
const SLOW_FRAME_MS = 150; // a browser that draws slower than this, over several frames, does not turn
const SLOW_FRAMES = 8;

export class Turntable {
  constructor(canvas, controls) {
    this.controls = controls;
    this.isSeen = true;
    controls.autoRotateSpeed = SPEED;
    for (const event of ["pointerdown", "wheel"]) canvas.addEventListener(event, () => this.stop(), { passive: true });
    new IntersectionObserver((entries) => {
      this.isSeen = entries.at(-1).isIntersecting;
      this.#next();
    }).observe(canvas);
  }

  /** Turn, unless the visitor prefers less motion or has stopped it by touching an object. */
  start() {
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) return;
    this.controls.autoRotate = true;
    this.slowFrames = 0;
    this.#next();
  }

  stop() {
    this.controls.autoRotate = false;
  }

  /** Hold still while something else has the screen; then go on. */
  hold(isHeld) {
    this.isHeld = isHeld;
    this.#next();
  }

  #next() {
    if (!this.controls.autoRotate || !this.isSeen || this.isHeld) return;
    const asked = performance.now();
    this.frame ??= requestAnimationFrame((now) => {
      this.frame = undefined;
      const seconds = this.last && now - this.last < 1000 ? (now - this.last) / 1000 : 0;
      this.last = now;
      this.slowFrames = performance.now() - asked > SLOW_FRAME_MS ? this.slowFrames + 1 : 0;
      if (this.slowFrames > SLOW_FRAMES) this.stop();
      this.controls.update(seconds);
      this.#next();
    });
  }
}
