// The point colors of style.css: near points strong, far points faint, for light and dark pages.

const DARK = matchMedia("(prefers-color-scheme: dark)");

/** Read the colors: {near, far}, each [red, green, blue] from 0 to 255. */
export function colors() {
  const style = getComputedStyle(document.documentElement);
  const channels = (name) => style.getPropertyValue(name).trim().split(/\s+/).map(Number);
  return { near: channels("--near"), far: channels("--far") };
}

/** Whether the page is dark. */
export function isDark() {
  return DARK.matches;
}

/** Call `listener` when the page turns light or dark. */
export function onColorsChange(listener) {
  DARK.addEventListener("change", listener);
}
