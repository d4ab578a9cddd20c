// What went wrong, told where everyone sees it.
import { Problem } from "./api.js";

const box = document.getElementById("problem");

/** Show an error until it is closed or something works; what was broken off on purpose is none. */
export function showProblem(error) {
  if (error.name === "AbortError") return;
  if (!(error instanceof Problem)) console.error(error);
  box.querySelector("strong").textContent = error.title ?? "The page failed";
  box.querySelector("span").textContent = error.message;
  box.hidden = false;
}

export function hideProblem() {
  box.hidden = true;
}

/** Run something that may fail, and tell where it does. */
export async function attempt(action) {
  hideProblem();
  try {
    await action();
  } catch (error) {
    showProblem(error);
  }
}

box.querySelector("button").addEventListener("click", hideProblem);
