// The stored objects as cards. A click opens an object; dragging one onto another composes the two.
import { fetchPoints, listObjects } from "./api.js";
import { onColorsChange } from "./stage/colors.js";
import { attempt } from "./problem.js";
import { drawThumbnail } from "./thumbnail.js";

const PAGE = 24;
const POINTS = 2500; // of a thumbnail
const SIDE = 240; // of a thumbnail, pixels

const section = document.getElementById("gallery");
const list = section.querySelector("ul");
const hint = document.getElementById("hint");
const more = document.getElementById("more");

const cards = new Map(); // by id: {object, item, points}
let cursor = null;
let picked = null; // id of the first object of a composition
let actions = {};

/** Set up the gallery; `handlers` has `open(object)` and `compose(first, second)`. */
export function startGallery(handlers) {
  actions = handlers;
  more.addEventListener("click", () => attempt(() => load(cursor)));
  document.addEventListener("keydown", (event) => event.key === "Escape" && pick(null));
  onColorsChange(() => cards.forEach(draw));
  pick(null);
}

/** Show the first page of objects, newest first. Returns the newest object, or undefined. */
export async function reloadGallery() {
  const items = await load(null);
  return items[0];
}

/** Mark the shown or composed objects; `labels` maps an id to its letter, or to an empty string. */
export function markCards(labels) {
  for (const [id, { item }] of cards) {
    item.classList.toggle("shown", id in labels);
    item.querySelector(".letter").textContent = labels[id] ?? "";
  }
}

async function load(from) {
  const page = await listObjects(from, PAGE);
  if (from === null) {
    const kept = new Map(cards);
    cards.clear();
    list.replaceChildren();
    for (const object of page.items) add(object, kept.get(object.id)?.points);
    pick(null);
  } else page.items.forEach((object) => add(object));
  cursor = page.next;
  more.hidden = cursor === null;
  return page.items;
}

function add(object, points) {
  const item = document.createElement("li");
  const card = { object, item, points };
  cards.set(object.id, card);
  item.append(...face(card));
  if (!object.word) {
    item.append(mixButton(card));
    acceptDrags(card);
  }
  list.append(item);
  if (points) draw(card);
  else attempt(async () => {
    card.points = await fetchPoints(object, { n: POINTS });
    draw(card);
  });
}

function draw({ object, item, points }) {
  if (points) drawThumbnail(item.querySelector("canvas"), object, points);
}

/** Build picture, letter and name; picture and name open the object. The picture is a canvas: Firefox drags no button. */
function face({ object }) {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = SIDE;
  const letter = document.createElement("b");
  letter.className = "letter";
  const button = document.createElement("button");
  button.type = "button";
  button.className = "open";
  button.textContent = `${object.kind} ${object.id.slice(0, 6)}`;
  for (const each of [canvas, button]) each.addEventListener("click", () => actions.open(object));
  return [canvas, letter, button];
}

function mixButton({ object }) {
  const button = document.createElement("button");
  button.type = "button";
  button.className = "mix";
  button.textContent = "Compose";
  button.setAttribute("aria-label", `Compose ${object.id.slice(0, 6)}`);
  button.setAttribute("aria-pressed", "false");
  button.addEventListener("click", () => choose(object.id));
  return button;
}

/** Choose an object: the first one waits, the second one is composed with it. */
function choose(id) {
  if (picked === null) pick(id);
  else if (picked === id) pick(null);
  else compose(picked, id);
}

function compose(first, second) {
  pick(null);
  actions.compose(cards.get(first).object, cards.get(second).object);
}

function pick(id) {
  picked = id;
  for (const [each, { item }] of cards) item.querySelector(".mix")?.setAttribute("aria-pressed", String(each === id));
  hint.textContent =
    id === null
      ? "Drag one object onto another to compose them, or press Compose on both."
      : "Now press Compose on a second object. Press Escape to cancel.";
}

function acceptDrags({ object, item }) {
  item.draggable = true;
  item.addEventListener("dragstart", (event) => {
    event.dataTransfer.setData("application/x-hof-object", object.id);
    event.dataTransfer.effectAllowed = "link";
  });
  item.addEventListener("dragover", (event) => {
    if (!event.dataTransfer.types.includes("application/x-hof-object")) return;
    event.preventDefault();
    event.dataTransfer.dropEffect = "link";
    item.classList.add("over");
  });
  item.addEventListener("dragleave", () => item.classList.remove("over"));
  item.addEventListener("drop", (event) => {
    event.preventDefault();
    item.classList.remove("over");
    const id = event.dataTransfer.getData("application/x-hof-object");
    if (cards.has(id) && id !== object.id) compose(id, object.id);
  });
}
