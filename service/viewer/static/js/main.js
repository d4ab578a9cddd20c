// The page: encode a photo, show objects, compose two of them.
import { allWords, compose } from "./api.js";
import { showCurl } from "./curl.js";
import { markCards, reloadGallery, startGallery } from "./gallery.js";
import { onEncoded, showModels } from "./photo.js";
import { attempt } from "./problem.js";
import { focusStage, showObject, showWords } from "./view.js";

const galleryLine = document.querySelector("#gallery .curl");

function show(object) {
  showObject(object);
  markCards({ [object.id]: "" });
}

function open(object) {
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
    markCards(letters);
    showWords(objects, labels, about);
    focusStage();
  });
}

/** The formula of a word: AB is A(B(x)). */
function formula(word) {
  return `${[...word].join("(")}(x${")".repeat(word.length)}`;
}

startGallery({ open, compose: composeTwo });
onEncoded(async (object) => {
  await reloadGallery();
  show(object);
});
showCurl(galleryLine, "", "objects");
attempt(showModels);
attempt(async () => {
  const newest = await reloadGallery();
  if (newest) show(newest);
});
