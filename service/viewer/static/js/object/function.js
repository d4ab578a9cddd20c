// What the function itself is worth: its bytes against those on the screen, and the same points by curl and Python.
import { showCode, showCurl } from "./curl.js";
import { authorization } from "../key.js";
import { bytesPerPoint, filePath } from "../objects.js";
import { number, text } from "../text.js";

const MEGABYTE = 1e6;

const panel = document.getElementById("function");
const [curl, python] = ["points", "python"].map((of) => panel.querySelector(`[data-of="${of}"]`));

/** Compare the file of an object's functions (function/weights.js) with n points that were computed of it. */
export function showFunction(object, functions, n, seed) {
  const bytes = n * bytesPerPoint(object);
  panel.hidden = false;
  panel.querySelector("p").textContent = text("functionBytes", {
    kilobytes: number(Math.round(functions.bytes / 1024)),
    n: number(n),
    megabytes: number(Number((bytes / MEGABYTE).toPrecision(3))),
    times: number(Number((bytes / functions.bytes).toPrecision(2))),
  });
  const query = { n, seed, format: "npy" };
  showCurl(curl, "-o points.npy", filePath(object, "points", query));
  showCode(python, lines(object, query));
}

export function hideFunction() {
  panel.hidden = true;
}

function lines({ id }, { n, seed }) {
  const key = "Authorization" in authorization() ? ', api_key=os.environ["HOF_KEY"]' : "";
  const address = new URL(".", document.baseURI).href;
  const call = `points = Client("${address}"${key}).points("${id}", n=${n}, seed=${seed})`;
  return [key && "import os", "from hof_client import Client", call].filter(Boolean).join("\n");
}
