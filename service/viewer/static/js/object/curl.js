// Lines of code that repeat what the page just did, each with a button that copies it.

import { curlAuthorization } from "../key.js";
import { text } from "../text.js";

/** Show a curl line in a `.curl` element: options `before`, then the address of `path`. */
export function showCurl(element, before, path) {
  const address = new URL(path, document.baseURI).href;
  const quoted = /[?&]/.test(address) ? `"${address}"` : address;
  showCode(element, ["curl", curlAuthorization(), before, quoted].filter(Boolean).join(" "));
}

/** Show code in a `.curl` element. */
export function showCode(element, content) {
  const code = document.createElement("code");
  code.textContent = content;
  const button = document.createElement("button");
  button.type = "button";
  button.textContent = text("copy");
  button.addEventListener("click", () => copyText(code.textContent, button, code));
  element.replaceChildren(code, button);
  element.hidden = false;
}

/** Copy a text and tell it on the button; where that is not allowed, select `element`, if it is there. */
export async function copyText(content, button, element) {
  const label = button.textContent;
  try {
    await navigator.clipboard.writeText(content);
    button.textContent = text("copied");
  } catch {
    // No permission, or no HTTPS: select the line, so that one key copies it.
    if (!element) return;
    getSelection().selectAllChildren(element);
    button.textContent = text("selected");
  }
  setTimeout(() => (button.textContent = label), 2000);
}
