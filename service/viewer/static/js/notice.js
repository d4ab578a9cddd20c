// The line at the bottom of the page that tells what goes on: waiting, offline, something that can be undone.
import { text } from "./text.js";

const box = document.getElementById("notice");
const button = box.querySelector("button");

let shown; // the latest notice

/** Show a notice; `action`: {label, run} for its button. Returns a function that hides it, unless it was replaced. */
export function notify(message, action) {
  const notice = {};
  shown = notice;
  box.querySelector("span").textContent = message;
  button.hidden = !action;
  button.textContent = action?.label ?? "";
  button.onclick = action?.run ?? null;
  box.hidden = false;
  return () => {
    if (shown === notice) box.hidden = true;
  };
}

/** Tell when the browser goes offline, until it is back. */
export function watchConnection() {
  let hide = () => {};
  addEventListener("offline", () => (hide = notify(text("offline"))));
  addEventListener("online", () => hide());
  if (!navigator.onLine) hide = notify(text("offline"));
}
