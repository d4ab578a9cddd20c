// The pictures of the cards: fetched for those in view, two at a time, and the latest ones kept. They wait for the object
// on the stage, and leave it room: a service draws so much for one visitor at a time.
import { fetchPhoto, fetchPicture } from "../api.js";
import { showProblem } from "../problem.js";

const SIDE = 240; // of a picture, pixels
const AT_A_TIME = 2; // cards whose pictures are fetched together
const KEPT = 300; // cards whose pictures are kept

const kept = new Map(); // {picture, photo}, addresses by `keyOf`; the last one was drawn last
const waiting = new Map(); // {object, item} by id, of cards in view
let fetching = 0;
let isHeld = true; // until `startPictures`

/** Begin to fetch pictures. */
export function startPictures() {
  isHeld = false;
  next();
}

/** Draw the pictures of a card, when its turn comes. */
export function wantPictures(card) {
  waiting.set(card.object.id, card);
  next();
}

/** Do not fetch the pictures of a card that went out of view. */
export function dropPictures({ object }) {
  waiting.delete(object.id);
}

/** Build the images of a card, with the pictures if they are there. */
export function imagesOf(object) {
  const picture = Object.assign(new Image(SIDE, SIDE), { alt: "", draggable: false });
  const photo = Object.assign(new Image(), { alt: "", className: "photo", draggable: false, hidden: true });
  const pictures = kept.get(keyOf(object));
  if (pictures) put(pictures, picture, photo);
  return [picture, photo];
}

function next() {
  while (!isHeld && fetching < AT_A_TIME && waiting.size) {
    const [id, card] = [...waiting].at(-1); // whoever scrolls on wants what came into view last
    waiting.delete(id);
    fetching++;
    draw(card)
      .catch(showProblem)
      .finally(() => {
        fetching--;
        next();
      });
  }
}

async function draw({ object, item }) {
  const key = keyOf(object);
  if (!kept.has(key)) {
    const fetches = [fetchPicture(object, SIDE, { isQuiet: true }), object.links.photo && fetchPhoto(object)];
    const [picture, photo] = await Promise.all(fetches);
    keep(key, { picture, photo });
  }
  const images = item.querySelectorAll("img");
  if (images.length) put(kept.get(key), ...images);
}

function put({ picture, photo }, image, inset) {
  image.src = picture;
  if (photo) inset.src = photo;
  inset.hidden = !photo;
}

/** An object may get its photo later, by a repeat. */
function keyOf({ id, links }) {
  return `${id} ${links.photo ?? ""}`;
}

function keep(key, pictures) {
  kept.set(key, pictures);
  if (kept.size <= KEPT) return;
  const [[oldest, addresses]] = kept;
  kept.delete(oldest);
  Object.values(addresses).forEach((address) => address && URL.revokeObjectURL(address));
}
