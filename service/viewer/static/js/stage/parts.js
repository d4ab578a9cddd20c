// Everything that draws on the stage. It needs three.js, so the page loads it later than the rest: see open.js.
export { Cloud } from "./cloud.js";
export { ComputedPoints } from "./function.js";
export { Stage } from "./stage.js";
export { fetchSurface } from "./surface.js";
export * as way from "./way.js";
