// A card of the gallery: the pictures of an object, its name, and what can be done with it.
import { text } from "../text.js";
import { imagesOf } from "./thumbnails.js";

/** Fill a card. `actions`: `open()`, `mix()`, `remove()`. */
export function fillCard({ object, item }, actions) {
  item.replaceChildren(...face(object, actions), foot(object, actions));
}

/** Leave nothing but the name, for searches in the page and for screen readers. The height stays, by gallery.css. */
export function emptyCard({ object, item }) {
  item.textContent = nameOf(object);
}

/** Return whether a card is filled. */
export function isFilled({ item }) {
  return item.firstElementChild !== null;
}

export function nameOf({ label, kind, image, id }) {
  const isOfScan = kind === "encoded" && !image; // or of a photo that an older service encoded
  return label ?? `${text(isOfScan ? "object" : kind)} ${id.slice(0, 6)}`;
}

/** Return whether an object can be part of a mix: it is no mix itself, and its function is applied more than once. */
export function canMix({ word, spec }) {
  return !word && spec.k > 1;
}

/** Build pictures, letter and name; pictures and name open the object. The picture is no button: Firefox drags none. */
function face(object, { open }) {
  const images = imagesOf(object);
  const letter = document.createElement("b");
  letter.className = "letter";
  const button = buttonOf("open", nameOf(object));
  for (const each of [...images, button]) each.addEventListener("click", open);
  return [...images, letter, button];
}

function foot(object, { mix, remove }) {
  const row = document.createElement("p");
  if (canMix(object)) {
    row.append(buttonOf("mix", text("mix"), text("mixNamed", { name: nameOf(object) })));
    row.firstChild.addEventListener("click", mix);
  }
  row.append(buttonOf("delete", text("delete"), text("deleteNamed", { name: nameOf(object) })));
  row.lastChild.addEventListener("click", remove);
  return row;
}

function buttonOf(name, content, label = content) {
  const button = document.createElement("button");
  Object.assign(button, { type: "button", className: name, textContent: content, ariaLabel: label });
  return button;
}
