// Pictures of objects: until the stage has drawn them, and instead of it where it cannot open.
import { fetchPicture } from "../api.js";
import { isDark } from "../stage/colors.js";

const SIDE = 512; // of a picture, pixels
const PATIENCE_MS = 1000; // for a picture that stands in for the stage

const box = document.getElementById("stills");

let fetching = new AbortController();

/** Show pictures of objects instead of those before. Throws AbortError if they are hidden meanwhile. */
export async function showStills(objects) {
  hideStills();
  fetching = new AbortController();
  const { signal } = fetching;
  const addresses = await Promise.all(objects.map((object) => fetchPicture(object, SIDE, signal)));
  signal.throwIfAborted();
  box.replaceChildren(...addresses.map((src) => Object.assign(new Image(), { src, alt: "" })));
  box.hidden = false;
}

/**
 * Show pictures of objects until the stage has drawn them. Returns the promise of `showStills`; on dark pages nothing,
 * since pictures are white.
 */
export function standIn(objects) {
  if (isDark()) return undefined;
  const picture = showStills(objects);
  picture.catch(() => {}); // whoever has no stage either tells
  return picture;
}

/** Wait for a picture, if there is one, but not for long. Does not throw. */
export async function briefly(picture) {
  const patience = new Promise((done) => setTimeout(done, PATIENCE_MS));
  if (picture) await Promise.race([picture, patience]).catch(() => {});
}

/** Hide the pictures, and give up those that are on their way. */
export function hideStills() {
  fetching.abort();
  box.hidden = true;
}
