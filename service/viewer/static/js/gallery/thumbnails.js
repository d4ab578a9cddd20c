// The pictures of the cards: fetched for those in view, two at a time, and the latest ones kept. They wait for the object
// on the stage, and leave it room: a service draws so much for one visitor at a time.
import { fetchPhoto, fetchPicture } from "../api.js";
import { allOrNone, revoke } from "../objects.js";
import { showProblem } from "../problem.js";

const SIDE = 240; // of a picture, pixels
const AT_A_TIME = 2; // cards whose pictures are fetched together
const BUSY_MS = 10_000; // until a card gets another turn, if the service was too busy for it
const KEPT = 300; // cards whose pictures are kept

const kept = new Map(); // {picture, photo}, addresses by `keyOf`; the last one was drawn last
const inView = new Map(); // cards, {object, item}, by id
const waiting = new Map(); // those of them whose pictures are missing
let fetching = 0;
let isHeld = true; // until `startPictures`

/** Begin to fetch pictures. */
export function startPictures() {
  isHeld = false;
  next();
}

/** Draw the pictures of a card, when its turn comes. */
export function wantPictures(card) {
  inView.set(card.object.id, card);
  waiting.set(card.object.id, card);
  next();
}

/** Do not fetch the pictures of a card that went out of view. */
export function dropPictures({ object }) {
  inView.delete(object.id);
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
      .catch((error) => (error.isBusy ? again(card) : showProblem(error)))
      .finally(() => {
        fetching--;
        next();
      });
  }
}

/** Want a card's pictures later, if it is still in view then: nobody waits for them. */
function again(card) {
  setTimeout(() => inView.get(card.object.id) === card && wantPictures(card), BUSY_MS);
}

async function draw({ object, item }) {
  const key = keyOf(object);
  if (!kept.has(key)) {
    const fetches = [fetchPicture(object, SIDE, { isQuiet: true }), object.links.photo && fetchPhoto(object)];
    const [picture, photo] = await allOrNone(fetches);
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
  revoke(Object.values(addresses));
}
