// Scans and meshes: files that a model of points completes. Browsers know no types of theirs, so the name decides.
import { Problem } from "../api.js";
import { text } from "../text.js";

const ENDINGS = [".ply", ".pcd", ".npy", ".xyz", ".glb", ".obj", ".stl"];

const input = document.getElementById("file");
const hint = document.getElementById("scans");

let isTaken; // whether a loaded model takes scans; undefined until that is known

/** Return whether a File is a scan or mesh. */
export function isScan({ name }) {
  return ENDINGS.some((ending) => name.toLowerCase().endsWith(ending));
}

/** Offer to choose scans if one of the loaded models takes them. */
export function offerScans(models) {
  isTaken = models.some(({ points }) => points);
  hint.hidden = !isTaken;
  hint.classList.remove("unknown");
  if (!isTaken) return;
  input.accept = [input.accept, ...ENDINGS].join(",");
  input.setAttribute("aria-describedby", hint.id);
}

/** Throw a Problem if no model takes scans. Until that is known, the service decides. */
export function checkScans() {
  if (isTaken === false) throw new Problem(text("photosOnly"), text("noScans"));
}
