// Pictures of objects: until the stage has drawn them, and instead of it where it cannot open.
import { fetchPicture } from "../api.js";
import { allOrNone, revoke } from "../objects.js";
import { isDark } from "../stage/colors.js";

const SIDE = 512; // of a picture instead of the stage, pixels
const BRIEF_SIDE = 320; // of a picture until the stage has drawn: the surface, which is computed meanwhile, has room beside it
const PATIENCE_MS = 1000; // for a picture that stands in for the stage

const box = document.getElementById("stills");

let fetching = new AbortController();

/** Show pictures of objects once they are here. Throws AbortError if pictures are hidden or others wanted meanwhile. */
export async function showStills(objects, side = SIDE) {
  fetching.abort();
  fetching = new AbortController();
  const { signal } = fetching;
  const addresses = await allOrNone(objects.map((object) => fetchPicture(object, side, { signal })));
  if (signal.aborted) revoke(addresses);
  signal.throwIfAborted();
  forget();
  box.replaceChildren(...addresses.map((src) => Object.assign(new Image(), { src, alt: "" })));
  box.hidden = false;
}

/**
 * Show pictures of objects until the stage has drawn them. Returns the promise of `showStills`, which does not have to be handled; on dark
 * pages nothing, since pictures are white.
 */
export function standIn(objects) {
  if (isDark()) return undefined;
  const picture = showStills(objects, BRIEF_SIDE);
  picture.catch(() => {}); // whoever has no stage either fetches larger ones
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
  forget();
}

/** Give up the pictures that were shown. */
function forget() {
  revoke([...box.children].map((image) => image.src));
  box.replaceChildren();
}
