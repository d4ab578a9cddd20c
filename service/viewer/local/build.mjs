// Writes the page as a folder that any web server can hold: node build.mjs FOLDER
// It has the page, its photos and libraries, hof-client, onnxruntime-web the default model and the matte network.

import { createHash } from "node:crypto";
import { cp, mkdir, readFile, rm, writeFile } from "node:fs/promises";
import { existsSync } from "node:fs";
import { join, resolve } from "node:path";

const VIEWER = resolve(import.meta.dirname, "..");
const ROOT = resolve(VIEWER, "..", "..");
const CLIENT = join(ROOT, "client", "js");
const RUNTIME = join(CLIENT, "node_modules", "onnxruntime-web");
const MODELS = ["hof1-k2.onnx", "hof-matte.onnx"];

const LEFT_OUT = ["docs.html", "js/docs.js", "embed.html", "js/embed.js", "bundle/swagger-ui", "index.html"].map((path) =>
  join(VIEWER, "static", path),
);
const SOURCES = [".mjs", ".gz", ".d.ts"]; // endings of files that the page does not load

const IMPORTS = {
  "./viewer/js/api.js": "./viewer/local/api.js",
  "hof-client": "./viewer/hof-client/index.js",
  "hof-client/encoder": "./viewer/hof-client/encoder/index.js",
  "onnxruntime-web/wasm": "./viewer/bundle/onnxruntime/ort.js",
};
const NEEDED = {
  [join(VIEWER, "static", "bundle", "three")]: "make serve",
  [join(CLIENT, "dist", "encoder")]: "npm run build --prefix client/js",
  [RUNTIME]: "npm ci --prefix client/js",
};

const [target] = process.argv.slice(2);
if (!target) fail("the folder to write is missing: node build.mjs FOLDER");
for (const [path, command] of Object.entries(NEEDED)) if (!existsSync(path)) fail(`${path} is missing: run \`${command}\``);

const isLoaded = (path) => !LEFT_OUT.includes(path) && !SOURCES.some((ending) => path.endsWith(ending));
const viewer = join(target, "viewer");
await rm(target, { recursive: true, force: true });
await cp(join(VIEWER, "static"), viewer, { recursive: true, filter: isLoaded });
await cp(join(VIEWER, "local"), join(viewer, "local"), { recursive: true, filter: isLoaded });
await cp(join(CLIENT, "dist"), join(viewer, "hof-client"), { recursive: true, filter: isLoaded });
await mkdir(join(viewer, "bundle", "onnxruntime"), { recursive: true });
const dist = join(RUNTIME, "dist");
const runtime = (name) => join(viewer, "bundle", "onnxruntime", name);
await cp(join(dist, "ort.wasm.bundle.min.mjs"), runtime("ort.js")); // many servers do not know .mjs
await cp(join(dist, "ort-wasm-simd-threaded.wasm"), runtime("ort-wasm-simd-threaded.wasm"));
await cp(join(ROOT, "LICENSE"), join(target, "LICENSE"));
await cp(join(ROOT, "NOTICE"), join(target, "NOTICE"));
for (const model of MODELS) await cp(join(ROOT, "model", "weights", model), join(viewer, "models", model));
await writeFile(join(target, "index.html"), page(await readFile(join(VIEWER, "static", "index.html"), "utf-8")));

/** Return index.html with the import map, the style and the policy of the static page. */
function page(html) {
  const [map] = /(?<=<script type="importmap">).*?(?=<\/script>)/s.exec(html);
  const local = JSON.stringify({ imports: { ...JSON.parse(map).imports, ...IMPORTS } }, null, 2);
  const digest = createHash("sha256").update(local).digest("base64");
  const policy =
    `default-src 'none'; script-src 'self' 'wasm-unsafe-eval' 'sha256-${digest}'; style-src 'self'; ` +
    "img-src 'self' blob: data:; connect-src 'self'; base-uri 'none'; form-action 'none'";
  return html
    .replace(map, local)
    .replace('href="viewer/js/api.js"', 'href="viewer/local/api.js"')
    .replace("<head>", `<head>\n    <meta http-equiv="Content-Security-Policy" content="${policy}">`)
    .replace("</head>", `  <link rel="stylesheet" href="viewer/local/local.css">\n  </head>`);
}

function fail(text) {
  console.error(text);
  process.exit(1);
}
