// The photo: chosen, taken, dropped, pasted or an example. It is shown at once, then encoded; the last one wins.
import { encode, encodePath, listModels } from "./api.js";
import { showCurl } from "./curl.js";
import { attempt } from "./problem.js";
import { text } from "./text.js";

const element = (id) => document.getElementById(id);
const [drop, model, background, framing] = ["drop", "model", "background", "framing"].map(element);
const keep = element("keep");
const picture = framing.querySelector("img");
const box = framing.querySelector(".box");
const caption = framing.querySelector("figcaption");
const line = document.querySelector('.curl[data-of="encode"]');

const MASKS = { alpha: "maskAlpha", border: "maskBorder", matting: "maskMatting", none: "maskNone" };

let current; // {photo, abort} of the last photo
let handlers;

/** Set up the ways to give a photo. `actions`: `begin()`, `done(object)`, and `fail()`, each of the last photo only. */
export function startPhotos(actions) {
  handlers = actions;
  for (const input of [element("file"), element("camera")]) {
    input.addEventListener("change", () => {
      if (input.files.length) send(input.files[0]);
      input.value = ""; // so that the same file can be chosen again
    });
  }
  for (const button of document.querySelectorAll("[data-photo]")) {
    button.addEventListener("click", () => attempt(async () => send(await example(button))));
  }
  background.addEventListener("change", () => current && send(current.photo));
  acceptDrops();
  document.addEventListener("paste", (event) => {
    const [file] = event.clipboardData.files;
    if (file) send(file);
  });
}

/** Offer the models if there are several; calls leave out the default model's name. */
export async function showModels() {
  const models = await listModels();
  const options = models.map(({ name, spec }, index) => new Option(`${name} (k = ${spec.k})`, index ? name : ""));
  model.replaceChildren(...options);
  model.parentElement.hidden = models.length < 2;
}

/** Forget the photo: an object is shown that is not of it. A photo that is still being encoded is given up. */
export function hidePhoto() {
  current?.abort.abort();
  current = undefined;
  framing.hidden = true;
}

/** Encode a photo (File) and show its object, unless another photo follows meanwhile. */
function send(photo) {
  current?.abort.abort();
  const mine = { photo, abort: new AbortController() };
  current = mine;
  showPhoto(photo);
  handlers.begin();
  return attempt(async () => {
    try {
      const object = await encode(photo, query(), mine.abort.signal);
      if (current !== mine) return;
      showFraming(object.image);
      await handlers.done(object);
    } catch (error) {
      if (current !== mine) return;
      caption.textContent = text("notMade");
      handlers.fail();
      throw error;
    }
  });
}

function query() {
  const chosen = { model: model.value, background: background.value };
  if (!chosen.model) delete chosen.model;
  if (chosen.background === "auto") delete chosen.background;
  if (keep.checked) chosen.keep_photo = true;
  return chosen;
}

/** Show a photo before anything is known of it. */
function showPhoto(photo) {
  URL.revokeObjectURL(picture.src);
  picture.src = URL.createObjectURL(photo);
  box.hidden = true;
  caption.textContent = "";
  framing.hidden = false;
  showCurl(line, `-F "image=@${photo.name.replace(/["\\$`]/g, "\\$&")}"`, encodePath(query()));
}

/** Show which part of the photo was taken for the object, and how it was told from its background. */
function showFraming({ mask, box: [left, top, right, bottom], confidence, width, height }) {
  box.style.left = `${(100 * left) / width}%`;
  box.style.top = `${(100 * top) / height}%`;
  box.style.width = `${(100 * (right - left)) / width}%`;
  box.style.height = `${(100 * (bottom - top)) / height}%`;
  box.hidden = false;
  const sure = confidence === undefined ? "" : `, ${text("maskSure", { percent: Math.round(100 * confidence) })}`;
  caption.textContent = `${text(MASKS[mask])}${sure}.`;
}

async function example(button) {
  const content = await (await fetch(button.querySelector("img").src)).blob();
  return new File([content], button.dataset.photo, { type: content.type });
}

function acceptDrops() {
  const carriesFile = (event) => event.dataTransfer.types.includes("Files");
  document.addEventListener("dragover", (event) => {
    if (!carriesFile(event)) return;
    event.preventDefault();
    drop.classList.add("over");
  });
  document.addEventListener("dragleave", (event) => {
    if (!event.relatedTarget) drop.classList.remove("over");
  });
  document.addEventListener("drop", (event) => {
    if (!carriesFile(event)) return;
    event.preventDefault();
    drop.classList.remove("over");
    if (event.dataTransfer.files.length) send(event.dataTransfer.files[0]);
  });
}
