// The stored objects as cards. A click opens an object; dragging one onto another mixes the two.
import { deleteObject, fetchPhoto, fetchPicture, listObjects } from "./api.js";
import { notify } from "./notice.js";
import { attempt } from "./problem.js";
import { text } from "./text.js";

const PAGE = 24;
const SIDE = 240; // of a picture, pixels
const UNDO_MS = 7000; // until a deletion is sent

const section = document.getElementById("gallery");
const list = section.querySelector("ul");
const hint = document.getElementById("hint");
const more = document.getElementById("more");

const cards = new Map(); // by id: {object, item}
const pictures = new Map(); // addresses by id: {picture, photo}
const leaving = new Map(); // timers of deletions that can be undone, by id
let cursor = null;
let picked = null; // id of the first object of a mix
let dragged; // the object that is being dragged
let actions = {};
let marks = {}; // labels of the shown objects, by id

const seen = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) {
    if (!isIntersecting) continue;
    seen.unobserve(target);
    attempt(() => draw(target));
  }
});

/** Set up the gallery; `handlers` has `open(object)` and `compose(first, second)`. */
export function startGallery(handlers) {
  actions = handlers;
  more.addEventListener("click", () => attempt(() => load(cursor)));
  document.addEventListener("keydown", (event) => event.key === "Escape" && pick(null));
  addEventListener("pagehide", () => [...leaving.keys()].forEach((id) => deleteObject(id, true).catch(() => {})));
  pick(null);
}

/** Show the first page of objects, newest first. Returns the newest object, or undefined. */
export async function reloadGallery() {
  const items = await load(null);
  return items[0];
}

/** Mark the shown or mixed objects; `labels` maps an id to its letter, or to an empty string. */
export function markCards(labels) {
  marks = labels;
  for (const [id, { item }] of cards) {
    item.classList.toggle("shown", id in labels);
    item.querySelector(".letter").textContent = labels[id] ?? "";
  }
}

/** Show an object under its new name. */
export function updateCard(object) {
  const card = cards.get(object.id);
  if (!card) return;
  card.object = object;
  fill(card);
  draw(card.item);
  markCards(marks);
}

async function load(from) {
  const page = await listObjects(from, PAGE);
  if (from === null) {
    cards.clear();
    list.replaceChildren();
    pick(null);
  }
  const items = page.items.filter((object) => !leaving.has(object.id));
  items.forEach(add);
  markCards(marks);
  cursor = page.next;
  more.hidden = cursor === null;
  return items;
}

function add(object) {
  const item = document.createElement("li");
  item.dataset.id = object.id;
  const card = { object, item };
  cards.set(object.id, card);
  fill(card);
  if (canMix(object)) acceptDrags(card);
  list.append(item);
  seen.observe(item);
}

function fill(card) {
  card.item.replaceChildren(...face(card), foot(card));
}

/** Show the pictures of a card, when it comes into view. */
async function draw(item) {
  const { id } = item.dataset;
  if (!cards.has(id)) return; // the list was loaded again
  const { object } = cards.get(id);
  if (!pictures.has(id)) {
    const fetches = [fetchPicture(object, SIDE), object.links.photo && fetchPhoto(object)];
    const [picture, photo] = await Promise.all(fetches);
    pictures.set(id, { picture, photo });
  }
  const { picture, photo } = pictures.get(id);
  item.querySelector("img").src = picture;
  if (photo) item.querySelector(".photo").src = photo;
  item.querySelector(".photo").hidden = !photo;
}

function nameOf(object) {
  return object.label ?? `${text(object.kind)} ${object.id.slice(0, 6)}`;
}

/** Build pictures, letter and name; pictures and name open the object. The picture is no button: Firefox drags none. */
function face({ object }) {
  const picture = Object.assign(new Image(SIDE, SIDE), { alt: "", draggable: false });
  const photo = Object.assign(new Image(), { alt: "", className: "photo", draggable: false, hidden: true });
  const letter = document.createElement("b");
  letter.className = "letter";
  const button = buttonOf("open", nameOf(object));
  for (const each of [picture, photo, button]) each.addEventListener("click", () => actions.open(object));
  return [picture, photo, letter, button];
}

function foot(card) {
  const { object } = card;
  const row = document.createElement("p");
  if (canMix(object)) {
    const mix = buttonOf("mix", text("mix"), text("mixNamed", { name: nameOf(object) }));
    mix.setAttribute("aria-pressed", "false");
    mix.addEventListener("click", () => choose(object.id));
    row.append(mix);
  }
  const remove = buttonOf("delete", text("delete"), text("deleteNamed", { name: nameOf(object) }));
  remove.addEventListener("click", () => removeCard(card));
  row.append(remove);
  return row;
}

function buttonOf(name, content, label = content) {
  const button = document.createElement("button");
  Object.assign(button, { type: "button", className: name, textContent: content, ariaLabel: label });
  return button;
}

/** Take a card away, and delete its object if that is not undone. */
function removeCard({ object, item }) {
  const next = item.nextElementSibling ?? item.previousElementSibling;
  const place = item.nextSibling;
  item.remove();
  next?.querySelector(".open").focus();
  const back = () => {
    clearTimeout(leaving.get(object.id));
    leaving.delete(object.id);
    if (cards.has(object.id)) list.insertBefore(item, place?.isConnected ? place : null);
    hide();
  };
  const hide = notify(text("deleted", { name: nameOf(object) }), { label: text("undo"), run: back });
  const send = () =>
    attempt(async () => {
      try {
        await deleteObject(object.id);
        leaving.delete(object.id);
        cards.delete(object.id);
        hide();
      } catch (error) {
        back();
        throw error;
      }
    });
  leaving.set(object.id, setTimeout(send, UNDO_MS));
}

/** Choose an object: the first one waits, the second one is mixed with it. */
function choose(id) {
  if (picked === null) pick(id);
  else if (picked === id) pick(null);
  else compose(picked, id);
}

function compose(first, second) {
  pick(null);
  actions.compose(cards.get(first).object, cards.get(second).object);
}

/** Whether an object can be part of a mix: it is no mix itself, and its function is applied more than once. */
function canMix({ word, spec }) {
  return !word && spec.k > 1;
}

/** Whether two objects can be mixed: they have functions of the same kind, from the same model. */
function isPair(first, second) {
  const kindOf = ({ model, spec }) => JSON.stringify([model, spec]);
  return first.id !== second.id && kindOf(first) === kindOf(second);
}

/** Offer only objects that can be mixed with the picked one. */
function pick(id) {
  picked = id;
  const first = cards.get(id)?.object;
  for (const [each, { item, object }] of cards) {
    const button = item.querySelector(".mix");
    if (!button) continue;
    button.setAttribute("aria-pressed", String(each === id));
    button.disabled = id !== null && each !== id && !isPair(first, object);
  }
  hint.textContent = text(id === null ? "hint" : "hintPicked");
}

function acceptDrags({ object, item }) {
  item.draggable = true;
  item.addEventListener("dragstart", (event) => {
    dragged = object;
    event.dataTransfer.setData("application/x-hof-object", object.id);
    event.dataTransfer.effectAllowed = "link";
  });
  item.addEventListener("dragover", (event) => {
    if (!event.dataTransfer.types.includes("application/x-hof-object") || !isPair(dragged, object)) return;
    event.preventDefault();
    event.dataTransfer.dropEffect = "link";
    item.classList.add("over");
  });
  item.addEventListener("dragleave", () => item.classList.remove("over"));
  item.addEventListener("drop", (event) => {
    event.preventDefault();
    item.classList.remove("over");
    if (dragged && isPair(dragged, object) && cards.has(dragged.id)) compose(dragged.id, object.id);
  });
}
