// The photo: chosen, taken, dropped, pasted or an example. It is shown at once, then encoded; the last one wins. A scan
// or mesh comes the same ways, and is shown by its name.
import { complete, encode, encodePath, fetchPhoto, listModels } from "../api.js";
import { showCurl } from "../object/curl.js";
import { attempt } from "../problem.js";
import { number, text } from "../text.js";
import { Crop, cut, isWhole } from "./crop.js";
import { checkScans, isScan, offerScans } from "./scan.js";

const element = (id) => document.getElementById(id);
const [drop, model, background, framing] = ["drop", "model", "background", "framing"].map(element);
const keep = element("keep");
const picture = framing.querySelector("img");
const box = framing.querySelector(".box");
const fileName = framing.querySelector("figcaption strong");
const caption = framing.querySelector("figcaption span");
const cutOut = framing.querySelector("figcaption img");
const line = document.querySelector('.curl[data-of="encode"]');

const MASKS = { alpha: "maskAlpha", border: "maskBorder", matting: "maskMatting", none: "maskNone" };

const crop = new Crop(framing.querySelector(".picture"), element("crop-size"));
const [cropButton, useCrop, cancelCrop, whole] = ["crop", "crop-use", "crop-cancel", "whole"].map(element);

// {photo, part, sent, abort} of the last photo; `part` is what the visitor chose of it, if not all. A scan has `abort`.
let current;
let handlers;

/** Set up the ways to give a file. `actions`: `begin()`, `done(object)`, and `fail()`, each of the last file only. */
export function startPhotos(actions) {
  handlers = actions;
  for (const input of [element("file"), element("camera")]) {
    input.addEventListener("change", () => {
      if (input.files.length) take(input.files[0]);
      input.value = ""; // so that the same file can be chosen again
    });
  }
  for (const button of document.querySelectorAll("[data-photo]")) {
    button.addEventListener("click", () => attempt(async () => send(await example(button))));
  }
  background.addEventListener("change", () => current?.photo && send(current.photo, current.part, current.sent));
  startCropping();
  acceptDrops();
  document.addEventListener("paste", (event) => {
    const [file] = event.clipboardData.files;
    if (file) take(file);
  });
}

/** Offer scans if a model takes them, and the models of photos if there are several; calls leave out the default's. */
export async function showModels() {
  const loaded = await listModels();
  offerScans(loaded);
  const models = loaded.filter(({ framing }) => framing); // those of points have none
  const options = models.map(({ name, spec }, index) => new Option(`${name} (k = ${spec.k})`, index ? name : ""));
  model.replaceChildren(...options);
  model.parentElement.hidden = models.length < 2;
}

/** Return whether a photo or scan is shown: of the object, or of one that is being made or could not be. */
export function hasPhoto() {
  return current !== undefined;
}

/** Forget the photo or scan: an object is shown that is not of it. One that is still being encoded is given up. */
export function hidePhoto() {
  current?.abort.abort();
  current = undefined;
  stopCropping();
  framing.hidden = true;
}

function startCropping() {
  cropButton.addEventListener("click", beginCrop);
  cancelCrop.addEventListener("click", () => {
    stopCropping();
    picture.src = addressOf(current.sent);
    box.hidden = !current.framed;
    cropButton.focus();
  });
  useCrop.addEventListener("click", () => attempt(useCropped));
  whole.addEventListener("click", () => {
    send(current.photo);
    cropButton.focus();
  });
  framing.addEventListener("keydown", ({ key, target }) => {
    if (key === "Escape" && framing.classList.contains("cropping")) cancelCrop.click();
    else if (key === "Enter" && target.dataset.corner) useCrop.click();
  });
}

/** Show the whole photo, with a rectangle on it. */
async function beginCrop() {
  const mine = current;
  picture.src = addressOf(mine.photo);
  await picture.decode().catch(() => {}); // a photo that the browser cannot show has no size
  if (mine !== current) return;
  box.hidden = true;
  showCropping(true);
  crop.start(mine.part);
}

async function useCropped() {
  const { photo } = current;
  const { part } = crop;
  const sent = isWhole(part) ? photo : await cut(photo, picture, part);
  if (photo === current?.photo) send(photo, sent === photo ? undefined : part, sent);
  cropButton.focus();
}

function stopCropping() {
  crop.stop();
  showCropping(false);
}

function showCropping(isOn) {
  framing.classList.toggle("cropping", isOn);
  for (const each of framing.querySelectorAll(".whilecropping")) each.hidden = !isOn;
  for (const each of framing.querySelectorAll(".uncropped")) each.hidden = isOn;
  whole.hidden = isOn || !current?.part;
}

/** Take a file that the visitor gives. */
function take(file) {
  return isScan(file) ? sendScan(file) : send(file);
}

/** Encode a photo (File), or what was `sent` of a part of it, and show its object, unless another file follows. */
function send(photo, part, sent = photo) {
  return attempt(async () => {
    const mine = follow({ photo, part, sent });
    showPhoto(sent);
    handlers.begin();
    const object = await awaitObject(mine, encode(sent, query(), mine.abort.signal), text("notMade"));
    if (!object) return;
    mine.framed = true;
    showFraming(object.image);
    if (object.links.photo) showCutOut(object, mine).catch(() => {}); // the page works without it
    await handlers.done(object);
  });
}

/** Complete a scan or mesh (File) and show its object, unless another file follows. */
function sendScan(scan) {
  return attempt(async () => {
    checkScans();
    const mine = follow({});
    showScan(scan);
    handlers.begin();
    const object = await awaitObject(mine, complete(scan, mine.abort.signal), text("scanNotMade"));
    if (!object) return;
    caption.textContent = text("scanMade", { n: number(object.placement.count) });
    await handlers.done(object);
  });
}

/** Give up the file before, if it is still being encoded, for one that follows. */
function follow(file) {
  current?.abort.abort();
  current = { ...file, abort: new AbortController() };
  return current;
}

/** Wait for the object of a file, or say that there is none; undefined if another file followed meanwhile. */
async function awaitObject(mine, answer, failure) {
  try {
    const object = await answer;
    return current === mine ? object : undefined;
  } catch (error) {
    if (current !== mine) return undefined;
    caption.textContent = failure;
    handlers.fail();
    throw error;
  }
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
  picture.src = addressOf(photo);
  showFile("");
  line.hidden = photo !== current.photo; // no file of the visitor's is the part
  if (!line.hidden) showCurl(line, formField("image", photo), encodePath(query()));
}

/** Show a scan before anything is known of it: its name, in place of a picture and what can be done with that. */
function showScan(scan) {
  showFile(scan.name);
  showCurl(line, formField("points", scan), encodePath());
}

function showFile(scanName) {
  framing.classList.toggle("scan", scanName !== "");
  fileName.textContent = scanName;
  box.hidden = cutOut.hidden = true;
  caption.textContent = "";
  framing.hidden = false;
  stopCropping();
}

/** The option of curl that sends a file. */
function formField(field, { name }) {
  return `-F "${field}=@${name.replace(/["\\$`]/g, "\\$&")}"`;
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

/** Show the object of the photo without its background. */
async function showCutOut(object, mine) {
  const address = await fetchPhoto(object);
  if (current === mine) {
    cutOut.src = address;
    cutOut.hidden = false;
    await cutOut.decode().catch(() => {});
  }
  URL.revokeObjectURL(address);
}

/** The address of a File, for the image; the one before is given up. */
function addressOf(photo) {
  URL.revokeObjectURL(picture.src);
  return URL.createObjectURL(photo);
}

async function example(button) {
  const name = button.dataset.photo;
  const content = await (await fetch(new URL(`../../photos/${name}`, import.meta.url))).blob();
  return new File([content], name, { type: content.type });
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
    if (event.dataTransfer.files.length) take(event.dataTransfer.files[0]);
  });
}
