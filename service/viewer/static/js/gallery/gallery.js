// The stored objects as cards. A click opens an object; dragging one onto another mixes the two. Pages of the list are
// fetched as the visitor scrolls; cards far from the view keep nothing but a name.
import { deleteObject, listObjects } from "../api.js";
import { notify } from "../notice.js";
import { attempt } from "../problem.js";
import { text } from "../text.js";
import { canMix, emptyCard, fillCard, isFilled, nameOf } from "./card.js";
import { dropPictures, wantPictures } from "./thumbnails.js";

const PAGE = 60;
const NEAR = "1200px 0px"; // from the view: cards are filled, and the next page is fetched
const UNDO_MS = 7000; // until a deletion is sent

const section = document.getElementById("gallery");
const list = section.querySelector("ul");
const hint = document.getElementById("hint");
const more = document.getElementById("more");

const cards = new Map(); // by id: {object, item}
const leaving = new Map(); // timers of deletions that can be undone, by id
let cursor = null;
let loads = 0; // of pages, to tell a page of a list that was loaded again meanwhile
let picked = null; // id of the first object of a mix
let dragged; // the object that is being dragged
let actions = {};
let marks = {}; // labels of the shown objects, by id

const nearby = observer(NEAR, (card, isNear) => (isNear ? fill(card) : empty(card)));
const inView = observer("100px 0px", (card, isSeen) => (isSeen ? wantPictures(card) : dropPictures(card)));
const end = new IntersectionObserver((entries) => entries.at(-1).isIntersecting && loadMore(), { rootMargin: NEAR });

function observer(rootMargin, run) {
  const each = ({ target, isIntersecting }) => {
    const card = cards.get(target.dataset.id);
    if (card?.item === target) run(card, isIntersecting);
  };
  return new IntersectionObserver((entries) => entries.forEach(each), { rootMargin });
}

/** Set up the gallery; `handlers` has `open(object)` and `compose(first, second)`. */
export function startGallery(handlers) {
  actions = handlers;
  more.addEventListener("click", loadMore);
  list.addEventListener("focusin", ({ target }) => fillBeside(target.closest("li")));
  document.addEventListener("keydown", (event) => event.key === "Escape" && pick(null));
  addEventListener("pagehide", () => [...leaving.keys()].forEach((id) => deleteObject(id, true).catch(() => {})));
}

/** Show the first page of objects, newest first. Returns the newest object, or undefined. */
export async function reloadGallery() {
  const items = await load(null);
  return items[0];
}

/** Mark the shown or mixed objects; `labels` maps an id to its letter, or to an empty string. */
export function markCards(labels) {
  marks = labels;
  cards.forEach(mark);
}

/** Show an object under its new name. */
export function updateCard(object) {
  const card = cards.get(object.id);
  if (!card) return;
  card.object = object;
  fill(card);
}

async function load(from) {
  const mine = ++loads;
  const page = await listObjects(from, PAGE);
  if (mine !== loads) return page.items;
  if (from === null) {
    for (const each of [nearby, inView]) each.disconnect();
    cards.clear();
    list.replaceChildren();
    pick(null);
  }
  const items = page.items.filter((object) => !leaving.has(object.id));
  items.forEach(add);
  cursor = page.next;
  more.hidden = cursor === null;
  end.unobserve(more); // it tells again whether the end is still near
  end.observe(more);
  return items;
}

function loadMore() {
  end.unobserve(more); // until the page is there; where it fails, the button remains
  attempt(() => load(cursor));
}

function add(object) {
  const item = document.createElement("li");
  item.dataset.id = object.id;
  const card = { object, item };
  cards.set(object.id, card);
  emptyCard(card);
  mark(card);
  if (canMix(object)) acceptDrags(card);
  list.append(item);
  for (const each of [nearby, inView]) each.observe(item);
}

function fill(card) {
  const { object } = card;
  fillCard(card, {
    open: () => actions.open(card.object),
    mix: () => choose(object.id),
    remove: () => removeCard(card),
  });
  mark(card);
  offer(card);
}

/** Empty a card, unless it has the focus. */
function empty(card) {
  if (!card.item.contains(document.activeElement)) emptyCard(card);
}

/** Fill the cards beside one, so that the Tab key never comes to an empty one. */
function fillBeside(item) {
  for (const each of [item?.previousElementSibling, item?.nextElementSibling]) {
    const card = cards.get(each?.dataset.id);
    if (card && !isFilled(card)) fill(card);
  }
}

function mark({ object: { id }, item }) {
  item.classList.toggle("shown", id in marks);
  const letter = item.querySelector(".letter");
  if (letter) letter.textContent = marks[id] ?? "";
}

/** Take a card away, and delete its object if that is not undone. */
function removeCard({ object, item }) {
  const next = item.nextElementSibling ?? item.previousElementSibling;
  const place = item.nextSibling;
  fillBeside(item);
  if (picked === object.id) pick(null);
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

/** Return whether two objects can be mixed: they have functions of the same kind, from the same model. */
function isPair(first, second) {
  const kindOf = ({ model, spec }) => JSON.stringify([model, spec]);
  return first.id !== second.id && kindOf(first) === kindOf(second);
}

/** Pick the first object of a mix, or none (null). */
function pick(id) {
  picked = id;
  cards.forEach(offer);
  hint.textContent = text(id === null ? "hint" : "hintPicked");
}

/** Offer to mix an object if it is the picked one, or can be mixed with that. */
function offer({ object, item }) {
  const button = item.querySelector(".mix");
  if (!button) return;
  button.setAttribute("aria-pressed", String(object.id === picked));
  button.disabled = picked !== null && object.id !== picked && !isPair(cards.get(picked).object, object);
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
