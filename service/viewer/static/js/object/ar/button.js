// The shown object in the visitor's own room. The first way of these that the device has: WebXR, in the browser itself;
// Scene Viewer on Android; Quick Look on iPhone and iPad.
import { HAS_ADDRESSES, Problem } from "../../api.js";
import { authorization } from "../../key.js";
import { notify } from "../../notice.js";
import { attempt } from "../../problem.js";
import { text } from "../../text.js";
import { openQuickLook, openSceneViewer } from "./apps.js";

const APPS = { "Scene Viewer": openSceneViewer, "Quick Look": openQuickLook }; // by the names that people know
const REASONS = { NotAllowedError: "arRefused", SecurityError: "arBlocked", NotSupportedError: "arUnsupported" };
const NOTICE_MS = 20_000;

const button = document.getElementById("ar");

let hasSession = false; // WebXR can show the object here
let isRefused = false; // it was tried, in vain
let isOffered = false; // an object is shown
let isInside = false; // a session is open, or being opened

/** Set up the button; `shown` returns the object, whether it is shown in color, and the stage: {object, inColor, stage}. */
export async function startAr(shown) {
  button.addEventListener("click", () => attempt(() => place(shown())));
  hasSession = await isSupported();
  if (isOffered) showAr();
}

/** Offer the button, where the browser or an app can show the object. */
export function showAr() {
  isOffered = true;
  button.hidden = !hasSession && !app();
}

export function hideAr() {
  isOffered = false;
  button.hidden = true;
}

async function isSupported() {
  try {
    return Boolean(await navigator.xr?.isSessionSupported("immersive-ar"));
  } catch {
    return false; // a policy of the page's frame
  }
}

/**
 * The app of this device; undefined without one. Scene Viewer fetches the file itself: by HTTPS, and without a key.
 */
function app() {
  if (!HAS_ADDRESSES) return undefined;
  const isAndroid = /android/i.test(navigator.userAgent) && !/firefox|oculus/i.test(navigator.userAgent);
  const isOpen = location.protocol === "https:" && !("Authorization" in authorization());
  if (isAndroid && isOpen) return "Scene Viewer";
  return document.createElement("a").relList.supports("ar") ? "Quick Look" : undefined;
}

async function place(shown) {
  if (!hasSession || (isRefused && app())) {
    await APPS[app()](shown);
    return;
  }
  if (isInside) return; // the button was pressed twice: browsers have one session at a time
  isInside = true;
  try {
    const room = await opened(shown);
    if (room) await stay(room, shown);
    else await APPS[app()](shown);
  } finally {
    isInside = false;
  }
}

/** Open a session: a Room. Without one, tell why, and return undefined if there is an app; else throw a Problem. */
async function opened(shown) {
  try {
    const { openRoom } = await import("./room.js");
    return await openRoom();
  } catch (error) {
    console.warn(error);
    isRefused = true;
    const reason = text(REASONS[error.name] ?? "arFailed", { reason: error.message });
    if (!app()) throw new Problem(text("arNotStarted"), reason);
    tellInstead(reason, () => attempt(() => APPS[app()](shown)));
    return undefined;
  }
}

/** Tell why an app opens; browsers that open apps for a press alone, and not that long after it, get one to press. */
function tellInstead(reason, open) {
  const run = () => {
    hide();
    open();
  };
  const hide = notify(`${reason} ${text("arInstead", { app: app() })}`, { label: text("arOpen", { app: app() }), run });
  setTimeout(hide, NOTICE_MS);
}

/** Show the object until the visitor leaves; the page rests meanwhile. */
async function stay(room, { object, inColor, stage }) {
  stage?.turntable.hold(true);
  try {
    await room.show(object, inColor);
    await room.ended;
  } finally {
    await room.leave();
    stage?.turntable.hold(false);
    button.focus({ preventScroll: true });
  }
}
