// The page: encode a photo, show objects, mix two of them.
import { allWords, compose, fetchObject } from "./api.js";
import { showCurl } from "./curl.js";
import { markCards, reloadGallery, startGallery, updateCard } from "./gallery.js";
import { hideName, showName, startNaming } from "./object/name.js";
import { watchConnection } from "./notice.js";
import { hidePhoto, showModels, startPhotos } from "./photo.js";
import { attempt } from "./problem.js";
import { text, translatePage } from "./text.js";
import { clearView, focusStage, showObject, showWords, startView, stopWorking } from "./object/view.js";

const ADDRESS = /^#\/objects\/(\w+)$/; // of an object, after the page's own
const galleryLine = document.querySelector('.curl[data-of="gallery"]');

/** Show an object and put its id into the page's address. */
function show(object) {
  const hash = `#/objects/${object.id}`;
  if (location.hash !== hash) history.pushState(null, "", hash);
  present(object);
}

/** Show an object with its name, and mark its card. */
function present(object) {
  showObject(object);
  showName(object);
  markCards({ [object.id]: "" });
}

function open(object) {
  hidePhoto();
  show(object);
  focusStage();
}

function composeTwo(first, second) {
  return attempt(async () => {
    const body = allWords(first, second);
    showCurl(galleryLine, `-H "Content-Type: application/json" -d '${body}'`, "compose");
    const objects = await compose(body);
    const letters = { [first.id]: "A", [second.id]: "B" };
    const labels = objects.map((object) => object.word.map((id) => letters[id]).join(""));
    const about = `All words over A and B: ${labels[1]} is ${formula(labels[1])}; the last letter is applied first.`;
    await reloadGallery();
    hidePhoto();
    hideName();
    markCards(letters);
    showWords(objects, labels, text("mixes"), about);
    focusStage();
  });
}

/** The formula of a word: AB is A(B(x)). */
function formula(word) {
  return `${[...word].join("(")}(x${")".repeat(word.length)}`;
}

/** Show the object of the page's address. Returns whether it names one. */
async function showAddressed() {
  const id = ADDRESS.exec(location.hash)?.[1];
  if (id) {
    hidePhoto();
    show(await fetchObject(id));
  }
  return id !== undefined;
}

async function begin() {
  const [isAddressed, newest] = await Promise.all([showAddressed(), reloadGallery()]);
  if (isAddressed || !newest) return;
  present(newest);
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
    show(object);
    await reloadGallery();
  },
  fail: stopWorking,
});
showCurl(galleryLine, "", "objects");
addEventListener("popstate", () => attempt(showAddressed));
attempt(showModels);
attempt(begin);
