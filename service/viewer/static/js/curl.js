// The line of shell that does what the page just did, and a button that copies it.

import { curlAuthorization } from "./key.js";

/** Show a line in a `.curl` element: what comes before and after the service's address. */
export function showCurl(element, before, path) {
  const address = `${location.origin}${path}`;
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
    // Not allowed here, or no HTTPS: selected, one key copies it.
    getSelection().selectAllChildren(code);
    button.textContent = "Selected";
  }
  setTimeout(() => (button.textContent = "Copy"), 2000);
}
