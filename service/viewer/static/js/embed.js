// An object alone, for a frame of another page: the stage, and a link to the whole page.
import { fetchObject, fetchPicture } from "./api.js";
import { addressedId } from "./objects.js";
import { Cloud } from "./stage/cloud.js";
import { Stage } from "./stage/stage.js";
import { fetchSurface } from "./stage/surface.js";
import { text, translateTexts } from "./text.js";

const STILL = 512; // pixels of the picture for browsers without WebGL

const canvas = document.querySelector("#stage canvas");
const stills = document.getElementById("stills");
const status = document.getElementById("empty");
const credit = document.getElementById("credit");

async function show() {
  const object = await fetchObject(addressedId() ?? "");
  credit.href = `.#/objects/${object.id}`;
  credit.textContent = object.label ? `${object.label} · HOF` : "HOF";
  const stage = openStage();
  if (stage) {
    const cloud = new Cloud(object, stage.materials);
    stage.set([cloud]);
    cloud.setSurface(await fetchSurface(object));
    stage.redraw();
  } else {
    stills.append(Object.assign(new Image(), { src: await fetchPicture(object, STILL), alt: object.label ?? "" }));
    stills.hidden = false;
  }
  status.hidden = true;
}

/** The stage; undefined without WebGL. The wheel scrolls the page around the frame. */
function openStage() {
  try {
    const stage = new Stage(canvas);
    stage.controls.enableZoom = false;
    return stage;
  } catch {
    return undefined;
  }
}

translateTexts();
addEventListener("hashchange", () => location.reload());
try {
  await show();
} catch (error) {
  status.textContent = `${error.title ?? text("pageFailed")}: ${error.message}`;
}
