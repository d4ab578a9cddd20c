// Files of an object, as the service's calls of the same names write them.
import { pointsGlb, pointsPly, sample, sampleColors, surfaceGlb, surfaceOf, writeFunctions } from "hof-client";

/** Write a file. `entry`: of the store; `of`: `mesh`, `points` or `weights`; `query`: as the service takes it. */
export function fileOf({ object, functions, word }, of, { format, n, seed, color }) {
  if (of === "weights") return writeFunctions(functions, object.model, word);
  const shown = color === "none" ? plain(functions) : functions;
  if (of === "mesh") return surfaceGlb(surfaceOf(shown));
  const options = { seed: BigInt(seed) };
  const points = sample(shown, Number(n), options);
  if (format === "f32") return points;
  const colors = sampleColors(shown, Number(n), options);
  return format === "glb" ? pointsGlb(points, colors) : pointsPly(points, colors);
}

function plain({ colorSpec: _, ...functions }) {
  return { ...functions, colorRows: [] };
}
