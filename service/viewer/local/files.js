// Files of an object, as the service's calls of the same names write them, and its surface.
import { pointsGlb, pointsPly, sample, sampleColors, surfaceGlb, surfaceOf, writeFunctions } from "hof-client";

let latest = {}; // {functions, inColor, surface}: switching between points and surface computes nothing again

/** Write a file. `entry`: of the store; `of`: `mesh`, `points` or `weights`; `query`: as the service takes it. */
export function fileOf({ object, functions, word }, of, { format, n, seed, color }) {
  if (of === "weights") return writeFunctions(functions, object.model, word);
  const shown = color === "none" ? plain(functions) : functions;
  if (of === "mesh") return surfaceGlb(surfaceFor(functions, color !== "none"));
  const options = { seed: BigInt(seed) };
  const points = sample(shown, Number(n), options);
  if (format === "f32") return points;
  const colors = sampleColors(shown, Number(n), options);
  return format === "glb" ? pointsGlb(points, colors) : pointsPly(points, colors);
}

/** Compute the surface of functions; the latest one is kept. */
export function surfaceFor(functions, inColor = true) {
  if (latest.functions !== functions || latest.inColor !== inColor) {
    latest = { functions, inColor, surface: surfaceOf(inColor ? functions : plain(functions)) };
  }
  return latest.surface;
}

function plain({ colorSpec: _, ...functions }) {
  return { ...functions, colorRows: [] };
}
