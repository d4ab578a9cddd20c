// Texts in the visitor's language: chosen on the page, else the browser's first one that the page has.
import { LANGUAGES } from "./languages.js";

const STORED = "hof-language";

/** The language of the page, such as "en". */
export const language = chosen();

/** A text by its key, with values for its {names}. */
export function text(key, values = {}) {
  return LANGUAGES[language][key].replace(/\{(\w+)\}/g, (_, name) => values[name]);
}

/** A number as the language writes it. */
export function number(value) {
  return value.toLocaleString(language);
}

/** Translate the texts of a page. */
export function translateTexts() {
  document.documentElement.lang = language;
  for (const element of document.querySelectorAll("[data-text]")) {
    if (element.tagName === "OPTGROUP") element.label = text(element.dataset.text);
    else if (element.textContent !== text(element.dataset.text)) element.textContent = text(element.dataset.text);
  }
  for (const element of document.querySelectorAll("[data-label]")) element.ariaLabel = text(element.dataset.label);
  for (const element of document.querySelectorAll("[data-placeholder]")) {
    element.placeholder = text(element.dataset.placeholder);
  }
  for (const element of document.querySelectorAll("[data-alt]")) element.alt = text(element.dataset.alt);
}

/** Translate index.html, and offer the languages. */
export function translatePage() {
  translateTexts();
  const select = document.getElementById("language");
  select.append(...Object.entries(LANGUAGES).map(([code, texts]) => new Option(texts.language, code)));
  select.value = language;
  select.addEventListener("change", () => {
    localStorage.setItem(STORED, select.value);
    location.reload();
  });
}

function chosen() {
  const wishes = [localStorage.getItem(STORED), ...navigator.languages.map((each) => each.slice(0, 2))];
  return wishes.find((each) => each && each in LANGUAGES) ?? "en";
}
