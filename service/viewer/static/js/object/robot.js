// For robots: a path around the object, between two places that are dragged or typed, and the camera of the photo.
import { planPath } from "../api.js";
import { showCurl } from "./curl.js";
import { ARROWS } from "../keys.js";
import { filePath } from "../objects.js";
import { attempt } from "../problem.js";
import { number, text } from "../text.js";

const STEP = 12; // pixels per key press
const FARTHEST = 1; // from the object's center along each axis: the service plans no farther
const REASONS = { "start inside": "noWayStart", "goal inside": "noWayGoal", enclosed: "noWayEnclosed" };

const panel = document.getElementById("robot");
const clearance = document.getElementById("clearance");
const answer = document.getElementById("way");
const [line, cameraLine] = ["path", "camera"].map((of) => panel.querySelector(`[data-of="${of}"]`));
const camera = document.getElementById("photo-camera");
const ends = ["start", "goal"].map((name) => ({
  name,
  fields: [...panel.querySelectorAll(`[data-end="${name}"] input`)],
  handle: document.querySelector(`#stage [data-end="${name}"]`),
}));

let stage; // undefined until it is open, and where it cannot open
let way; // stage/way.js
let cloud; // of the object that is shown alone
let drawn; // the line on the stage
let planning = new AbortController();

/** Set up the panel. */
export function startRobot() {
  panel.addEventListener("toggle", refresh);
  panel.addEventListener("change", refresh);
  document.getElementById("camera-look").addEventListener("click", () => stage?.lookFrom(cloud.object.camera));
}

/** Draw the path and its ends on the stage; `drawing` is stage/way.js, which needs three.js. */
export function drawRobot(theStage, drawing) {
  stage = theStage;
  way = drawing;
  stage.onDraw = placeHandles;
  for (const end of ends) listen(end);
}

/** Offer the panel for a cloud that is shown alone. */
export function showRobot(shown) {
  hideRobot();
  cloud = shown;
  panel.hidden = false;
  const { object } = cloud;
  camera.hidden = !object.camera;
  if (object.camera) showCamera(object);
  refresh();
}

/** Offer nothing: no object is shown, or several are. */
export function hideRobot() {
  planning.abort();
  removeLine();
  cloud = undefined;
  panel.hidden = true;
  showHandles(false);
}

function showCamera(object) {
  const { azimuth, elevation, distance } = object.camera;
  const values = { azimuth: Math.round(azimuth), elevation: Math.round(elevation) };
  camera.querySelector("p").textContent = text("cameraIs", { ...values, distance: number(Number(distance.toFixed(1))) });
  document.getElementById("camera-look").hidden = !stage;
  showCurl(cameraLine, "-o points.ply", filePath(object, "points", { frame: "camera", format: "ply" }));
}

/** Plan again, as the fields tell. */
function refresh() {
  const isOn = panel.open && Boolean(cloud);
  showHandles(isOn && Boolean(stage));
  if (isOn) attempt(plan);
  else {
    planning.abort();
    removeLine();
  }
}

async function plan() {
  planning.abort();
  planning = new AbortController();
  const { signal } = planning;
  if (![...panel.querySelectorAll("input")].every((input) => input.reportValidity())) return;
  const [start, goal] = ends.map(({ fields }) => fields.map((field) => field.valueAsNumber));
  const body = JSON.stringify({ start, goal, clearance: clearance.valueAsNumber });
  const { object } = cloud;
  showCurl(line, `-H "Content-Type: application/json" -d '${body}'`, `objects/${object.id}/path`);
  const found = await planPath(object.id, body, signal);
  if (signal.aborted) return;
  removeLine();
  answer.textContent = told(found);
  if (found.path && stage) {
    drawn = way.lineThrough(found.path);
    cloud.scene.add(drawn);
    stage.redraw();
  }
}

function told({ path, length, straight, reason }) {
  if (!path) return text(REASONS[reason]);
  return text(straight ? "wayStraight" : "wayAround", { length: number(Number(length.toFixed(2))) });
}

function removeLine() {
  answer.textContent = "";
  if (drawn) way.disposeLine(drawn);
  drawn = undefined;
  stage?.redraw();
}

function showHandles(isOn) {
  for (const { handle } of ends) handle.hidden = !isOn;
  if (isOn) placeHandles();
}

function placeHandles() {
  for (const { handle, fields } of ends) {
    if (handle.hidden) continue;
    const [x, y] = way.placeOf(stage, fields.map((field) => field.valueAsNumber || 0));
    handle.style.transform = `translate(${x}px, ${y}px) translate(-50%, -50%)`;
  }
}

function listen(end) {
  const { handle } = end;
  let last; // place of the pointer
  handle.addEventListener("pointerdown", (event) => {
    last = [event.clientX, event.clientY];
    handle.setPointerCapture(event.pointerId);
    stage.turntable.stop();
  });
  handle.addEventListener("pointermove", ({ clientX, clientY }) => {
    if (!last) return;
    move(end, clientX - last[0], clientY - last[1]);
    last = [clientX, clientY];
  });
  handle.addEventListener("lostpointercapture", () => {
    last = undefined;
    refresh();
  });
  handle.addEventListener("keydown", (event) => {
    const direction = ARROWS[event.key];
    if (!direction) return;
    event.preventDefault();
    stage.turntable.stop();
    move(end, ...direction.map((each) => STEP * each));
    refresh();
  });
}

function move({ fields }, right, down) {
  const from = fields.map((field) => field.valueAsNumber || 0);
  way.movedOnScreen(stage, from, right, down).forEach((value, axis) => {
    fields[axis].value = Math.min(FARTHEST, Math.max(-FARTHEST, value)).toFixed(3);
  });
  placeHandles();
}
