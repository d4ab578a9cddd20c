// The message at the top of the page that shows an error.
import { Problem } from "./api.js";
import { text } from "./text.js";

const box = document.getElementById("problem");

let isLasting = false; // the error that is shown concerns all that follows

/**
 * Show an error until it is closed or the next action starts; a lasting one until it is closed. Aborted calls are no
 * errors.
 */
export function showProblem(error) {
  if (error.name === "AbortError") return;
  if (!(error instanceof Problem)) console.error(error);
  isLasting = error.isLasting ?? false;
  box.querySelector("strong").textContent = error.title ?? text("pageFailed");
  box.querySelector("span").textContent = error.message;
  box.hidden = false;
}

function hideProblem() {
  box.hidden = true;
  isLasting = false;
}

/** Run an action and show its error, if it fails. */
export async function attempt(action) {
  if (!isLasting) hideProblem();
  try {
    await action();
  } catch (error) {
    showProblem(error);
  }
}

box.querySelector("button").addEventListener("click", hideProblem);
