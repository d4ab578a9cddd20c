// The colors of points, as style.css has them: near ones strong, far ones faint, for light and for dark pages.

const DARK = matchMedia("(prefers-color-scheme: dark)");

/** {near, far}: red, green, blue of each, 0 to 255. */
export function colors() {
  const style = getComputedStyle(document.documentElement);
  const channels = (name) => style.getPropertyValue(name).trim().split(/\s+/).map(Number);
  return { near: channels("--near"), far: channels("--far") };
}

/** Call back when the page turns light or dark. */
export function onColorsChange(listener) {
  DARK.addEventListener("change", listener);
}
