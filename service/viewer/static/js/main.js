// The page: encode a photo, show objects, mix two of them.
import { compose, fetchObject } from "./api.js";
import { showCurl } from "./object/curl.js";
import { markCards, reloadGallery, startGallery, updateCard } from "./gallery/gallery.js";
import { startPictures } from "./gallery/thumbnails.js";
import { hideName, showName, startNaming } from "./object/name.js";
import { watchConnection } from "./notice.js";
import { addressedId, wordBody } from "./objects.js";
import { hasPhoto, hidePhoto, showModels, startPhotos } from "./photo/photo.js";
import { attempt } from "./problem.js";
import { text, translatePage } from "./text.js";
import { clearView, focusStage, showObject, showWords, startView, stopWorking } from "./object/view.js";

const PATIENCE_MS = 3000; // for the object that the page begins with

const galleryLine = document.querySelector('.curl[data-of="gallery"]');

/** Show an object and put its id into the page's address. Resolves when the object is drawn. */
function show(object) {
  const hash = `#/objects/${object.id}`;
  if (location.hash !== hash) history.pushState(null, "", hash);
  return present(object);
}

/** Show an object with its name, and mark its card. Resolves when the object is drawn. */
function present(object) {
  showName(object);
  markCards({ [object.id]: "" });
  return showObject(object);
}

function open(object) {
  hidePhoto();
  attempt(() => show(object));
  focusStage();
}

function composeTwo(first, second) {
  return attempt(async () => {
    const labels = labelsFor(first.spec.k);
    const objects = [];
    for (const label of labels) objects.push(await objectOf(label, { A: first, B: second }));
    const letters = { [first.id]: "A", [second.id]: "B" };
    const about = text("aboutWords", { word: labels[1], formula: formula(labels[1]) });
    await reloadGallery();
    hidePhoto();
    hideName();
    markCards(letters);
    const drawn = showWords({ objects, labels, way: objects.filter((_, index) => labels[index] !== "BA"), about });
    focusStage();
    await drawn;
  });
}

/** The words from A to B, one letter after the other; of two letters, the other order too. Copies are no words. */
function labelsFor(k) {
  const between = Array.from({ length: k - 1 }, (_, index) => "A".repeat(k - 1 - index) + "B".repeat(index + 1));
  return ["A", ...between, ...(k === 2 ? ["BA"] : []), "B"];
}

/** The object of a label; a word is composed, with its curl line, unless it is one of the two objects. */
async function objectOf(label, letters) {
  if (label.length === 1) return letters[label];
  const body = wordBody([...label].map((letter) => letters[letter]));
  showCurl(galleryLine, `-H "Content-Type: application/json" -d '${body}'`, "compose");
  return compose(body);
}

/** The formula of a word: AB is A(B(x)). */
function formula(word) {
  return `${[...word].join("(")}(x${")".repeat(word.length)}`;
}

/** Show the object of the page's address, if it names one, unless the visitor wants something else meanwhile. */
async function showAddressed() {
  const id = addressedId();
  if (!id) return;
  hidePhoto();
  const object = await fetchObject(id);
  if (addressedId() === id && !hasPhoto()) await show(object);
}

/** Show the gallery and the object of the page's address, or the newest one if the visitor wants nothing else. */
async function begin() {
  const [newest] = await Promise.all([reloadGallery(), showAddressed()]);
  if (newest && !addressedId() && !hasPhoto()) await present(newest);
}

translatePage();
watchConnection();
startView(open);
startGallery({ open, compose: composeTwo });
startNaming(updateCard);
startPhotos({
  begin: () => {
    clearView();
    hideName();
  },
  done: async (object) => {
    await attempt(() => show(object)); // first: the gallery's pictures take the service's time
    await reloadGallery();
  },
  fail: stopWorking,
});
showCurl(galleryLine, "", "objects");
addEventListener("popstate", () => attempt(showAddressed));
attempt(showModels);
Promise.race([attempt(begin), new Promise((done) => setTimeout(done, PATIENCE_MS))]).then(startPictures);
