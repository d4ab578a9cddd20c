// The name of the object that is shown alone; visitors may change it.
import { relabel } from "../api.js";
import { attempt } from "../problem.js";

const input = document.getElementById("name");

let shown; // the object

/** Set up the field; `renamed(object)` is called with the object under its new name. */
export function startNaming(renamed) {
  input.addEventListener("keydown", (event) => event.key === "Enter" && input.blur());
  input.addEventListener("change", () =>
    attempt(async () => {
      const object = await relabel(shown.id, input.value);
      if (shown.id === object.id) showName(object);
      renamed(object);
    }),
  );
}

/** Offer to name an object. */
export function showName(object) {
  shown = object;
  input.value = object.label ?? "";
  input.parentElement.hidden = false;
}

/** Offer nothing: no object is shown, or several are. */
export function hideName() {
  input.parentElement.hidden = true;
}
