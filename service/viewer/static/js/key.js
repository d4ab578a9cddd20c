// The API key, if the service needs one: entered once, kept until the tab is closed.
const STORED = "hof-key";
const dialog = document.getElementById("key");

let pending = null; // resolves when the open dialog closes

/** Headers that carry the key; empty before a key was entered. */
export function authorization() {
  const key = sessionStorage.getItem(STORED);
  return key ? { Authorization: `Bearer ${key}` } : {};
}

/** The curl option for the key, as a shell variable: the key itself is never copied. */
export function curlAuthorization() {
  return sessionStorage.getItem(STORED) ? '-H "Authorization: Bearer $HOF_KEY"' : "";
}

/** Ask for a key, with one dialog for all waiting calls. Returns whether a key was entered.
 * `isWrong`: the service refused the key that was entered before. */
export function askForKey(isWrong) {
  if (!dialog) return Promise.resolve(false); // in a frame of another page
  document.getElementById("key-wrong").hidden = !isWrong;
  pending ??= new Promise((done) => {
    dialog.returnValue = "";
    dialog.addEventListener("close", () => done(keep()), { once: true });
    dialog.showModal();
  });
  return pending;
}

function keep() {
  pending = null;
  const input = dialog.querySelector("input");
  const key = dialog.returnValue === "use" ? input.value.trim() : "";
  input.value = "";
  if (key) sessionStorage.setItem(STORED, key);
  return key !== "";
}
