// The main path of the page in Firefox, by WebDriver BiDi: a photo in, a picture drawn, a download, a mix of two.
// node firefox.mjs ADDRESS PHOTO FOLDER; prints JSON of what was seen, and writes screenshots and the file to FOLDER.
import { readdirSync } from "node:fs";
import { join } from "node:path";
import puppeteer from "puppeteer-core";

const [address, photo, folder] = process.argv.slice(2);
const WAIT = { timeout: 120_000 };

const browser = await puppeteer.launch({
  browser: "firefox",
  executablePath: process.env.FIREFOX,
  headless: false, // without a window it has no WebGL: the test gives it a screen that nobody sees
  defaultViewport: { width: 1100, height: 900 },
  extraPrefsFirefox: {
    "browser.download.folderList": 2,
    "browser.download.dir": folder,
    "ui.prefersReducedMotion": 1, // no turntable
    "webgl.force-enabled": true,
  },
});
const faults = [];
const page = await browser.newPage();
page.on("pageerror", (error) => faults.push(String(error)));
page.on("console", (message) => message.type() === "error" && faults.push(message.text()));

const text = (selector) => page.$eval(selector, (element) => element.textContent);
const shown = (selector, pattern) =>
  page.waitForFunction(
    (selector, source) => new RegExp(source).test(document.querySelector(selector)?.textContent),
    WAIT,
    selector,
    pattern.source,
  );

await page.goto(address);
await page.waitForSelector("#empty:not([hidden])", WAIT);
const empty = join(folder, "firefox-empty.png");
await (await page.$("#stage")).screenshot({ path: empty });
await (await page.$("#file")).uploadFile(photo);
await shown("#count", /^[\d,]{5,} triangles$/);
await page.waitForSelector("#working", { hidden: true, ...WAIT });
await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
await (await page.$("#stage")).screenshot({ path: join(folder, "firefox-stage.png") });
await page.screenshot({ path: join(folder, "firefox.png") });
const caption = await text("#framing figcaption");

await page.click("#download button");
for (const end = Date.now() + WAIT.timeout; ; ) {
  const files = readdirSync(folder).filter((name) => name.endsWith(".glb"));
  if (files.length && !readdirSync(folder).some((name) => name.endsWith(".part"))) break;
  if (Date.now() > end) throw new Error("nothing was downloaded");
  await new Promise((done) => setTimeout(done, 200));
}

await page.click('[data-photo="armchair.webp"]');
await page.waitForFunction(() => document.querySelectorAll("#gallery .mix").length === 2, WAIT);
await shown("#count", /^[\d,]{5,} triangles$/);
for (const mix of await page.$$("#gallery .mix")) {
  await mix.evaluate((button) => button.scrollIntoView());
  await mix.click();
}
await page.waitForSelector("#words:not([hidden])", WAIT);
await shown("#count", /^[\d,]{5,} triangles$/);
const words = await page.$$eval("#words button", (buttons) => buttons.map((button) => button.textContent));
await page.screenshot({ path: join(folder, "firefox-mix.png"), fullPage: true });
console.log(JSON.stringify({ version: await browser.version(), caption, words, faults }));
await browser.close();
