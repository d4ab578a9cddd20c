// The shown object in the visitor's own room: by Quick Look on iPhone and iPad, by Scene Viewer on Android.
import { fetchFile } from "../api.js";
import { authorization } from "../key.js";
import { filePath } from "../objects.js";
import { attempt } from "../problem.js";

const QUICK_LOOK = "quick-look";
const SCENE_VIEWER = "scene-viewer";

const button = document.getElementById("ar");

/** Set up the button; `shown` returns the object and whether it is shown in color: {object, inColor}. */
export function startAr(shown) {
  button.addEventListener("click", () => attempt(() => place(shown())));
}

/** Offer the button, where an app can show the object. */
export function showAr() {
  button.hidden = !viewer();
}

export function hideAr() {
  button.hidden = true;
}

/** The app of this device; undefined without one. Scene Viewer fetches the file itself: by HTTPS, and without a key. */
function viewer() {
  if (document.createElement("a").relList.supports("ar")) return QUICK_LOOK;
  const isAndroid = /android/i.test(navigator.userAgent) && !/firefox|oculus/i.test(navigator.userAgent);
  const isOpen = location.protocol === "https:" && !("Authorization" in authorization());
  return isAndroid && isOpen ? SCENE_VIEWER : undefined;
}

async function place({ object, inColor }) {
  const color = object.color && !inColor ? { color: "none" } : {};
  if (viewer() === SCENE_VIEWER) {
    const file = new URL(filePath(object, "mesh", { format: "glb", ...color }), document.baseURI).href;
    follow(sceneViewer(file, object.label));
    return;
  }
  const { blob, name } = await fetchFile(filePath(object, "mesh", { format: "usdz", ...color }));
  const address = URL.createObjectURL(blob);
  follow(address, { rel: "ar", download: name });
  setTimeout(() => URL.revokeObjectURL(address), 60_000);
}

/** The address that opens a GLB file in Scene Viewer; without the app, this page again. */
function sceneViewer(file, title) {
  const query = new URLSearchParams({ file, mode: "ar_preferred", ...(title && { title }) });
  const intent = {
    scheme: "https",
    package: "com.google.android.googlequicksearchbox",
    action: "android.intent.action.VIEW",
    "S.browser_fallback_url": encodeURIComponent(location.href),
  };
  const fields = Object.entries(intent).map(([name, value]) => `${name}=${value};`);
  return `intent://arvr.google.com/scene-viewer/1.2?${query}#Intent;${fields.join("")}end;`;
}

/** Follow a link. Quick Look opens links whose only child is a picture. */
function follow(href, attributes = {}) {
  const link = Object.assign(document.createElement("a"), { href, hidden: true, ...attributes });
  link.append(new Image());
  document.body.append(link);
  link.click();
  link.remove();
}
