// The line of HTML that shows an object in a page of another site.
import { isEmbeddable } from "../api.js";
import { showCode } from "./curl.js";
import { authorization } from "../key.js";
import { text } from "../text.js";

const button = document.getElementById("embed");
const line = document.querySelector('.curl[data-of="embed"]');

let allowed; // a promise, once an object is shown: whether the service lets other sites show its objects
let shown; // the object, if one is shown alone

/** Set up the button. */
export function startEmbedding() {
  button.addEventListener("click", () => open(button.getAttribute("aria-expanded") === "false"));
}

/** Offer the line for an object, if other sites may show it. A frame there has no key: with one, nothing is offered. */
export function showEmbedding(object) {
  if (object.id !== shown?.id) open(false);
  shown = object;
  allowed ??= isEmbeddable().catch(() => false); // a service that cannot be asked shows its own error elsewhere
  allowed.then((isAllowed) => (button.hidden = !shown || !isAllowed || "Authorization" in authorization()));
}

export function hideEmbedding() {
  shown = undefined;
  button.hidden = true;
  open(false);
}

function open(isOpen) {
  button.setAttribute("aria-expanded", String(isOpen));
  line.hidden = !isOpen;
  if (isOpen) showCode(line, snippet(shown));
}

function snippet({ id, label }) {
  const attributes = {
    src: new URL(`embed#/objects/${id}`, document.baseURI).href,
    title: label ?? text("object"),
    width: 480,
    height: 360,
    style: "border: 0",
    loading: "lazy",
  };
  const frame = document.createElement("iframe");
  for (const [name, value] of Object.entries(attributes)) frame.setAttribute(name, value);
  return frame.outerHTML;
}
