// Shell lines that repeat what the page just did, each with a button that copies it.

import { curlAuthorization } from "./key.js";

/** Show a curl line in a `.curl` element: options `before`, then the address of `path`. */
export function showCurl(element, before, path) {
  const address = new URL(path, document.baseURI).href;
  const quoted = /[?&]/.test(address) ? `"${address}"` : address;
  const code = document.createElement("code");
  code.textContent = ["curl", curlAuthorization(), before, quoted].filter(Boolean).join(" ");
  const button = document.createElement("button");
  button.type = "button";
  button.textContent = "Copy";
  button.addEventListener("click", () => copy(code, button));
  element.replaceChildren(code, button);
  element.hidden = false;
}

async function copy(code, button) {
  try {
    await navigator.clipboard.writeText(code.textContent);
    button.textContent = "Copied";
  } catch {
    // No permission, or no HTTPS: select the line, so that one key copies it.
    getSelection().selectAllChildren(code);
    button.textContent = "Selected";
  }
  setTimeout(() => (button.textContent = "Copy"), 2000);
}
