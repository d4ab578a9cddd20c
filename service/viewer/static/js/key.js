// The API key, where the service needs one: asked for once, kept until the tab is closed.
const STORED = "hof-key";
const dialog = document.getElementById("key");

let asking = null;

/** Headers of a call; none where no key was needed yet. */
export function authorization() {
  const key = sessionStorage.getItem(STORED);
  return key ? { Authorization: `Bearer ${key}` } : {};
}

/** What a curl line needs beside its address: the key itself stays out of what is copied. */
export function curlAuthorization() {
  return sessionStorage.getItem(STORED) ? '-H "Authorization: Bearer $HOF_KEY"' : "";
}

/** Ask for a key, once however many calls wait for it. Returns whether one was given. */
export function askForKey() {
  asking ??= new Promise((done) => {
    dialog.returnValue = "";
    dialog.addEventListener("close", () => done(keep()), { once: true });
    dialog.showModal();
  });
  return asking;
}

function keep() {
  asking = null;
  const input = dialog.querySelector("input");
  const key = dialog.returnValue === "use" ? input.value.trim() : "";
  input.value = "";
  if (key) sessionStorage.setItem(STORED, key);
  return key !== "";
}
