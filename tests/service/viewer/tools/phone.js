// An Android phone with augmented reality, emulated by iwer, which the page gets before its own scripts: a room whose
// floor is at height 0, a wall 3 m ahead, and fingers, which are the triggers of two controllers.
(() => {
  const { XRDevice, XRFrame, XRSession, metaQuest3 } = IWER;
  const FLOOR = "#003000";
  const WALL = -3; // z, meters
  const PATIENCE_MS = 60_000;

  const device = new XRDevice(
    {
      name: "Phone",
      controllerConfig: metaQuest3.controllerConfig,
      supportedSessionModes: ["inline", "immersive-ar"],
      supportedFeatures: ["viewer", "local", "hit-test", "dom-overlay", "light-estimation"],
      supportedFrameRates: [60],
      internalNominalFrameRate: 60,
      environmentBlendModes: { "immersive-ar": "alpha-blend" },
      interactionMode: "screen-space",
      userAgent: navigator.userAgent,
    },
    { fovy: Math.PI / 3 },
  );
  device.installRuntime({ forceInstall: true });
  device.installSEM(
    class {
      environmentCanvas = document.createElement("canvas");
      trackedPlanes = new Set();
      trackedMeshes = new Set();
      constructor() {
        Object.assign(this.environmentCanvas.style, { position: "absolute", inset: 0, width: "100%", height: "100%" });
        this.environmentCanvas.style.background = FLOOR;
      }
      render() {}
      computeHitTestResults(ray) { // column-major; rays go along -z
        const [origin, direction] = [ray.slice(12, 15), ray.slice(8, 11).map((each) => -each)];
        const point = (distance) => origin.map((each, axis) => each + distance * direction[axis]);
        const down = -origin[1] / direction[1];
        if (down > 0 && point(down)[2] > WALL) return [new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, ...point(down), 1])];
        const ahead = (WALL - origin[2]) / direction[2];
        const wall = [1, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0]; // its normal, the second column, comes to the visitor
        return ahead > 0 ? [new Float32Array([...wall, ...point(ahead), 1])] : [];
      }
    },
  );

  const requested = []; // options of sessions
  let estimate; // of the light, by name as in WebXR
  const start = navigator.xr.requestSession.bind(navigator.xr);
  navigator.xr.requestSession = async (mode, options) => {
    requested.push({ mode, ...options, domOverlay: options.domOverlay?.root.id });
    return start(mode, options);
  };
  XRSession.prototype.requestLightProbe = async () => ({});
  XRFrame.prototype.getLightEstimate = () => estimate ?? null;

  const drawn = { page: 0, room: 0 }; // calls to draw, of the page's stage and of the session
  for (const name of ["drawArrays", "drawElements"]) {
    const draw = WebGL2RenderingContext.prototype[name];
    WebGL2RenderingContext.prototype[name] = function (...parts) {
      drawn[this.canvas.closest?.("#stage") ? "page" : "room"] += 1;
      return draw.apply(this, parts);
    };
  }

  /** Turn a device or a controller: degrees upwards, and to the left. */
  function turn(each, pitch, yaw = 0) {
    const [p, y] = [pitch, yaw].map((angle) => (angle * Math.PI) / 360);
    const [sp, cp, sy, cy] = [Math.sin(p), Math.cos(p), Math.sin(y), Math.cos(y)];
    each.quaternion.set(cy * sp, sy * cp, -sy * sp, cy * cp); // first up, then to the left
  }

  function frames(count = 2) {
    return new Promise((done) => {
      const next = () => (count-- ? requestAnimationFrame(next) : done());
      next();
    });
  }

  globalThis.phone = {
    requested,
    drawn,
    frames,
    /** Wait for more calls to draw on the page's stage, or in the room. */
    async draws(where, more = 1) {
      const before = drawn[where];
      for (const start = Date.now(); drawn[where] < before + more; await frames(1)) {
        if (Date.now() - start > PATIENCE_MS) throw new Error(`${drawn[where] - before} of ${more} draws`);
      }
    },
    session: () => device.activeSession,
    /** The picture of the room, as the address of a PNG: a frame is read when it was just drawn. */
    picture: () =>
      new Promise((done) =>
        device.activeSession.requestAnimationFrame(() => {
          const { canvas } = device.activeSession.renderState.baseLayer.context;
          const copy = Object.assign(document.createElement("canvas"), { width: canvas.width, height: canvas.height });
          const context = copy.getContext("2d");
          context.fillStyle = FLOOR;
          context.fillRect(0, 0, copy.width, copy.height);
          context.drawImage(canvas, 0, 0);
          done(copy.toDataURL());
        }),
      ),
    light: (values) => (estimate = values),
    /** Hold the phone 1.5 m high and look: degrees upwards, and to the left. */
    async look(pitch, yaw) {
      device.position.set(0, 1.5, 0);
      turn(device, pitch, yaw);
      await frames();
    },
    /** Put fingers on the screen, or move them: of each [hand, pitch, yaw], its ray's direction from the phone. */
    async touch(...fingers) {
      for (const [hand, pitch, yaw] of fingers) {
        device.controllers[hand].position.set(0, 1.5, 0);
        turn(device.controllers[hand], pitch, yaw);
        device.controllers[hand].updateButtonValue("trigger", 1);
      }
      await frames();
    },
    async lift() {
      for (const hand of ["left", "right"]) device.controllers[hand].updateButtonValue("trigger", 0);
      await frames();
    },
  };
})();
