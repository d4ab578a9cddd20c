// The download menu: a file of the shown object, and the curl line that fetches the same.
import { fetchFile } from "../api.js";
import { showCurl } from "./curl.js";
import { filePath } from "../objects.js";
import { attempt } from "../problem.js";
import { hideAr, showAr, startAr } from "./ar/button.js";
import { hideEmbedding, showEmbedding, startEmbedding } from "./embed.js";

const form = document.getElementById("download");
const format = document.getElementById("format");
const line = document.querySelector('.curl[data-of="download"]');

const STILL = { size: 512 };
const TURNING = { size: 320, frames: 24 };

let chosen; // returns {object, points: {n, seed}, inColor, stage}

/** Set up the menu; `shown` returns the object, its options and the stage: {object, points: {n, seed}, inColor, stage}. */
export function startDownloads(shown) {
  chosen = shown;
  startAr(shown);
  startEmbedding();
  format.addEventListener("change", showDownloads);
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    attempt(save);
  });
}

/** Offer the files of the object that is shown now. */
export function showDownloads() {
  form.hidden = false;
  showAr();
  showEmbedding(chosen().object);
  const { path, suffix } = chosenFile();
  showCurl(line, `-o object.${suffix}`, path);
}

/** Offer nothing. */
export function hideDownloads() {
  form.hidden = line.hidden = true;
  hideAr();
  hideEmbedding();
}

/** Choose the first format of a group: `mesh`, `points` or `weights`. */
export function preferFormat(group) {
  format.querySelector(`[data-of="${group}"]`).firstElementChild.selected = true;
}

/** The chosen file: its path in the API, and its suffix. */
function chosenFile() {
  const { object, points, inColor } = chosen();
  const name = format.value;
  const { of } = format.selectedOptions[0].parentElement.dataset;
  const picture = name === "png" ? STILL : TURNING;
  const query = { ...(of === "points" && points), ...(of === "picture" && picture), format: name };
  if (of !== "weights" && object.color && !inColor) query.color = "none";
  return { path: filePath(object, of, query), suffix: name };
}

async function save() {
  const { blob, name } = await fetchFile(chosenFile().path);
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}
