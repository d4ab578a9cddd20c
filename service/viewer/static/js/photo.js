// The photo: chosen, dropped or an example. It is encoded, then shown with the part that was used.
import { encode, encodePath, listModels } from "./api.js";
import { showCurl } from "./curl.js";
import { attempt } from "./problem.js";

const section = document.getElementById("photo");
const file = document.getElementById("file");
const drop = document.getElementById("drop");
const model = document.getElementById("model");
const framing = document.getElementById("framing");
const picture = framing.querySelector("img");
const line = section.querySelector(".curl");

const MASKS = {
  alpha: "Background removed by transparency",
  border: "Background removed by its single color",
  matting: "Background removed by the matting model",
  none: "Background not recognized: the whole picture was used",
};

/** Call `listener` with the object of each encoded photo. */
export function onEncoded(listener) {
  const send = (photo) => attempt(async () => listener(await encodePhoto(await photo)));
  file.addEventListener("change", () => {
    if (file.files.length) send(file.files[0]);
    file.value = ""; // so that the same file can be chosen again
  });
  for (const button of section.querySelectorAll("[data-photo]")) {
    button.addEventListener("click", () => send(example(button)));
  }
  acceptDrops(send);
}

/** Offer the models if there are several; calls leave out the default model's name. */
export async function showModels() {
  const models = await listModels();
  const options = models.map(({ name, spec }, index) => new Option(`${name} (k = ${spec.k})`, index ? name : ""));
  model.replaceChildren(...options);
  model.parentElement.hidden = models.length < 2;
}

async function encodePhoto(photo) {
  URL.revokeObjectURL(picture.src);
  framing.hidden = true;
  showCurl(line, `-F "image=@${photo.name.replace(/["\\$`]/g, "\\$&")}"`, encodePath(model.value));
  section.setAttribute("aria-busy", "true");
  try {
    const object = await encode(photo, model.value);
    picture.src = URL.createObjectURL(photo);
    showFraming(object.image);
    return object;
  } finally {
    section.removeAttribute("aria-busy");
  }
}

function showFraming({ mask, box, confidence, width, height }) {
  const [left, top, right, bottom] = box;
  const place = framing.querySelector(".box").style;
  place.left = `${(100 * left) / width}%`;
  place.top = `${(100 * top) / height}%`;
  place.width = `${(100 * (right - left)) / width}%`;
  place.height = `${(100 * (bottom - top)) / height}%`;
  const certainty = confidence === undefined ? "" : `, ${Math.round(100 * confidence)}% sure`;
  framing.querySelector("figcaption").textContent = `${MASKS[mask]}${certainty}.`;
  framing.hidden = false;
}

async function example(button) {
  const content = await (await fetch(button.querySelector("img").src)).blob();
  return new File([content], button.dataset.photo, { type: content.type });
}

function acceptDrops(send) {
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
