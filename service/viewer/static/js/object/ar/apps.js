// Apps that show an object in the visitor's room: they open a file.
import { fetchFile } from "../../api.js";
import { filePath } from "../../objects.js";

/** Open the object in Scene Viewer, which fetches the file itself; without the app, this page again. */
export async function openSceneViewer({ object, inColor }) {
  const file = new URL(meshPath(object, inColor, "glb"), document.baseURI).href;
  const query = new URLSearchParams({ file, mode: "ar_preferred", ...(object.label && { title: object.label }) });
  const intent = {
    scheme: "https",
    package: "com.google.android.googlequicksearchbox",
    action: "android.intent.action.VIEW",
    "S.browser_fallback_url": encodeURIComponent(location.href),
  };
  const fields = Object.entries(intent).map(([name, value]) => `${name}=${value};`);
  follow(`intent://arvr.google.com/scene-viewer/1.2?${query}#Intent;${fields.join("")}end;`);
}

/** Open the object in Quick Look. */
export async function openQuickLook({ object, inColor }) {
  const { blob, name } = await fetchFile(meshPath(object, inColor, "usdz"));
  const address = URL.createObjectURL(blob);
  follow(address, { rel: "ar", download: name });
  setTimeout(() => URL.revokeObjectURL(address), 60_000);
}

function meshPath(object, inColor, format) {
  return filePath(object, "mesh", { format, ...(object.color && !inColor && { color: "none" }) });
}

/** Follow a link. Quick Look opens links whose only child is a picture. */
function follow(href, attributes = {}) {
  const link = Object.assign(document.createElement("a"), { href, hidden: true, ...attributes });
  link.append(new Image());
  document.body.append(link);
  link.click();
  link.remove();
}
