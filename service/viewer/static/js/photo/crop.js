// A part of the photo, chosen by the visitor: drawn or dragged with a pointer, or moved corner by corner with the keys.
import { ARROWS } from "../keys.js";
import { number, text } from "../text.js";

const LEAST = 0.04; // smallest side of the part, as a share of the photo's
const STEP = 0.01; // share of the photo's side per key press; ten times as much with Shift
const MAX_SIDE = 2048; // pixels of what is sent; the encoder looks at far fewer
const WHOLE = { left: 0, top: 0, right: 1, bottom: 1 };

/** The rectangle over a photo. Its sides are shares of the photo's. */
export class Crop {
  /** `picture`: the element around the photo's image; `told` shows the size of the part. */
  constructor(picture, told) {
    this.image = picture.querySelector("img");
    this.area = picture.querySelector(".crop");
    this.told = told;
    picture.addEventListener("pointerdown", (event) => this.#grab(event));
    picture.addEventListener("pointermove", (event) => this.#drag(event));
    for (const end of ["pointerup", "pointercancel"]) picture.addEventListener(end, () => (this.drag = undefined));
    for (const corner of this.area.querySelectorAll("button")) {
      corner.addEventListener("keydown", (event) => this.#key(event, corner.dataset.corner));
    }
  }

  /** Let the visitor choose a part, from this one on. */
  start(part) {
    this.area.hidden = false;
    this.#set(part ?? { left: 0.1, top: 0.1, right: 0.9, bottom: 0.9 });
    this.area.querySelector("button").focus();
  }

  stop() {
    this.area.hidden = true;
    this.drag = undefined;
  }

  #set({ left, top, right, bottom }) {
    this.part = { left, top, right, bottom };
    const { style } = this.area;
    for (const [side, share] of [["left", left], ["top", top], ["width", right - left], ["height", bottom - top]]) {
      style[side] = `${100 * share}%`;
    }
    const [, , width, height] = pixelsOf(this.part, this.image);
    this.told.textContent = text("cropSize", { width: number(width), height: number(height) });
  }

  #place({ clientX, clientY }) {
    const { left, top, width, height } = this.image.getBoundingClientRect();
    return [limited((clientX - left) / width), limited((clientY - top) / height)];
  }

  /** A corner is moved, the part is moved, or beside it a new one is drawn. */
  #grab(event) {
    if (this.area.hidden || event.button) return;
    const [x, y] = this.#place(event);
    const { left, top, right, bottom } = this.part;
    const corner = event.target.dataset?.corner;
    const isInside = x > left && x < right && y > top && y < bottom;
    if (corner) this.drag = { corner };
    else if (isInside) this.drag = { x, y, part: this.part };
    else this.drag = { from: [x, y] };
    event.currentTarget.setPointerCapture(event.pointerId);
    if (!corner) event.preventDefault(); // no drag of the image, no lost focus
  }

  #drag(event) {
    if (!this.drag) return;
    const { corner, from, part } = this.drag;
    const [x, y] = this.#place(event);
    if (corner) this.#moveCorner(corner, x, y);
    else if (part) this.#set(moved(part, x - this.drag.x, y - this.drag.y));
    else this.#set(spanned(from, [x, y]));
  }

  #moveCorner(corner, x, y) {
    const part = { ...this.part };
    const [down, across] = corner.split("-");
    if (across === "left") part.left = Math.min(x, part.right - LEAST);
    else part.right = Math.max(x, part.left + LEAST);
    if (down === "top") part.top = Math.min(y, part.bottom - LEAST);
    else part.bottom = Math.max(y, part.top + LEAST);
    this.#set(part);
  }

  #key(event, corner) {
    const direction = ARROWS[event.key];
    if (!direction) return;
    event.preventDefault();
    const step = event.shiftKey ? 10 * STEP : STEP;
    const [down, across] = corner.split("-");
    const [x, y] = [this.part[across] + step * direction[0], this.part[down] + step * direction[1]];
    this.#moveCorner(corner, limited(x), limited(y));
  }
}

/** Cut a part out of a photo (File), upright as its EXIF data tells. `image`: the photo on the page. Returns a File. */
export async function cut(photo, image, part) {
  const [left, top, width, height] = pixelsOf(part, image);
  const scale = Math.min(1, MAX_SIDE / Math.max(width, height));
  const canvas = document.createElement("canvas");
  canvas.width = Math.max(1, Math.round(scale * width));
  canvas.height = Math.max(1, Math.round(scale * height));
  canvas.getContext("2d").drawImage(image, left, top, width, height, 0, 0, canvas.width, canvas.height);
  const type = photo.type === "image/jpeg" ? "image/jpeg" : "image/png"; // PNG keeps transparency
  const blob = await new Promise((done) => canvas.toBlob(done, type, 0.95));
  return new File([blob], photo.name.replace(/(\.\w+)?$/, `-crop.${type.slice(6)}`), { type });
}

/** Whether a part is all of the photo. */
export function isWhole(part) {
  return Object.entries(WHOLE).every(([side, share]) => part[side] === share);
}

function pixelsOf({ left, top, right, bottom }, { naturalWidth: width, naturalHeight: height }) {
  const [x, y] = [Math.round(left * width), Math.round(top * height)];
  return [x, y, Math.max(1, Math.round(right * width) - x), Math.max(1, Math.round(bottom * height) - y)];
}

function limited(share) {
  return Math.min(1, Math.max(0, share));
}

function moved({ left, top, right, bottom }, across, down) {
  const [x, y] = [Math.min(1 - right, Math.max(-left, across)), Math.min(1 - bottom, Math.max(-top, down))];
  return { left: left + x, top: top + y, right: right + x, bottom: bottom + y };
}

/** The part between two points, not smaller than allowed and not outside of the photo. */
function spanned([x, y], [otherX, otherY]) {
  const range = (a, b) => {
    const low = Math.min(a, b, 1 - LEAST);
    return [low, Math.max(a, b, low + LEAST)];
  };
  const [[left, right], [top, bottom]] = [range(x, otherX), range(y, otherY)];
  return { left, top, right, bottom };
}
