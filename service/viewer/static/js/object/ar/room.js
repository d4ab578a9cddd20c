// An object in the visitor's room, drawn by a WebXR session in a renderer of its own: the page's stage stays as it is.
// The button loads this module when it is pressed.
import { PerspectiveCamera, Scene, Vector3, WebGLRenderer } from "three";

import { fetchSurface } from "../../stage/surface.js";
import { number, text } from "../../text.js";
import { Light } from "./light.js";
import { modelOf, ringOf } from "./model.js";
import { Placing } from "./placing.js";

const LEVEL = 0.8; // least height of a surface's normal, of length 1: objects stand on floors and tables, not on walls
const [NEAREST, FARTHEST] = [0.05, 30]; // that is drawn, meters

const overlay = document.getElementById("room");
const hint = overlay.querySelector("p");
const leave = overlay.querySelector("button");
const styled = addStyle(new URL("../../../css/room.css", import.meta.url));

/** Ask for a session and open it: a Room. Throws what the browser answers, such as a NotAllowedError. */
export async function openRoom() {
  await styled;
  overlay.style.visibility = "hidden"; // browsers may be asking the visitor; they take an element that has a box
  overlay.hidden = false;
  let room;
  try {
    const session = await navigator.xr.requestSession("immersive-ar", {
      requiredFeatures: ["hit-test"],
      optionalFeatures: ["dom-overlay", "light-estimation"],
      domOverlay: { root: overlay },
    });
    room = new Room(session);
    await room.open();
    return room;
  } catch (error) {
    await room?.leave();
    throw error;
  } finally {
    overlay.hidden = !room || room.isClosed;
    overlay.style.visibility = "";
  }
}

class Room {
  constructor(session) {
    this.session = session;
    this.isClosed = false;
    this.hasMoved = false;
    this.fetching = new AbortController();
    this.fingers = new Set(); // input sources that are pressed
    this.ended = new Promise((done) => {
      session.addEventListener("end", () => {
        this.#close();
        done();
      });
    });
  }

  async open() {
    const { session } = this;
    this.renderer = new WebGLRenderer({ alpha: true, antialias: true });
    this.renderer.xr.enabled = true;
    this.renderer.xr.setReferenceSpaceType("local"); // every session has it
    this.camera = new PerspectiveCamera(50, 1, NEAREST, FARTHEST); // the session moves it
    this.scene = new Scene();
    this.light = new Light(this.scene);
    this.viewer = await session.requestReferenceSpace("viewer");
    this.surfaces = await session.requestHitTestSource({ space: this.viewer });
    await this.light.start(session);
    this.renderer.setAnimationLoop((_, frame) => frame && this.#draw(frame));
    await this.renderer.xr.setSession(session);
    this.#tell("roomSearch");
    hint.hidden = false;
    leave.onclick = () => this.leave();
    overlay.addEventListener("beforexrselect", keepTap);
  }

  /** Fetch the object and show it where the visitor looks, until a tap places it. Throws a Problem of the fetch. */
  async show(object, inColor) {
    try {
      const surface = await fetchSurface(object, this.fetching.signal);
      if (this.isClosed) return;
      this.model = modelOf(surface, object, inColor);
      this.ring = ringOf(surface);
      this.placing = new Placing(this.model);
      this.scene.add(this.model, this.ring);
      this.#listen();
    } catch (error) {
      if (!this.isClosed) throw error;
    }
  }

  /** End the session, unless it has ended. */
  async leave() {
    if (!this.isClosed) await this.session.end().catch(() => {});
    await this.ended;
  }

  #listen() {
    const { session, fingers, placing } = this;
    session.addEventListener("select", () => {
      if (this.aimed) placing.isPlaced = true;
    });
    session.addEventListener("selectstart", ({ inputSource }) => placing.isPlaced && fingers.add(inputSource));
    session.addEventListener("selectend", ({ inputSource }) => fingers.delete(inputSource));
    session.addEventListener("inputsourceschange", ({ removed }) => removed.forEach((each) => fingers.delete(each)));
  }

  #draw(frame) {
    if (this.placing) this.#place(frame, this.renderer.xr.getReferenceSpace());
    this.light.update(frame);
    this.renderer.render(this.scene, this.camera);
  }

  #place(frame, space) {
    const { placing } = this;
    if (!placing.isPlaced) this.#aim(frame, space);
    else placing.follow([...this.fingers].map((source) => this.#ray(frame, source, space)).filter(Boolean));
    this.model.visible = Boolean(this.aimed);
    this.ring.visible = this.model.visible && !placing.isPlaced;
    this.ring.position.copy(this.model.position);
    const percent = Math.round(100 * this.model.scale.x);
    if (!placing.isPlaced) this.#tell(this.aimed ? "roomTap" : "roomSearch");
    else this.#tell(percent === 100 ? "roomMove" : "roomSize", { percent: number(percent) });
    this.hasMoved ||= this.fingers.size > 0;
    hint.hidden = this.hasMoved && percent === 100; // who has moved it knows how
  }

  /** Put the object where the visitor looks, if a level surface is there; else where it was. */
  #aim(frame, space) {
    const matrices = frame.getHitTestResults(this.surfaces).map((hit) => hit.getPose(space)?.transform.matrix);
    const level = matrices.find((matrix) => matrix && matrix[5] > LEVEL); // its second column is the normal
    const pose = frame.getViewerPose(space);
    if (!level || !pose) return;
    this.aimed = true;
    this.placing.aim(new Vector3(level[12], level[13], level[14]), new Vector3().copy(pose.transform.position));
  }

  /** The ray of a finger in the room, {origin, direction}, and where it goes through the picture: {x, y}. */
  #ray(frame, source, space) {
    const inRoom = frame.getPose(source.targetRaySpace, space)?.transform.matrix;
    const inView = frame.getPose(source.targetRaySpace, this.viewer)?.transform.matrix;
    if (!inRoom || !inView) return undefined; // it is not tracked
    return {
      source,
      origin: new Vector3(inRoom[12], inRoom[13], inRoom[14]),
      direction: new Vector3(-inRoom[8], -inRoom[9], -inRoom[10]), // rays go along -z
      x: -inView[8] / inView[10],
      y: -inView[9] / inView[10],
    };
  }

  #tell(key, values) {
    const told = text(key, values);
    if (hint.textContent !== told) hint.textContent = told; // it is read aloud when it changes
  }

  #close() {
    this.isClosed = true;
    this.fetching.abort();
    overlay.hidden = true;
    overlay.removeEventListener("beforexrselect", keepTap);
    this.renderer?.setAnimationLoop(null);
    setTimeout(() => { // once three.js has closed its part
      this.renderer?.dispose();
      this.renderer?.forceContextLoss(); // browsers have few contexts; the buffers go with it
    });
  }
}

/** Add a style to the page. Resolves when it is there, or cannot be fetched. */
function addStyle(href) {
  const link = Object.assign(document.createElement("link"), { rel: "stylesheet", href });
  document.head.append(link);
  return new Promise((done) => (link.onload = link.onerror = done));
}

/** Keep a press of the overlay's button from being a tap on the floor. */
function keepTap(event) {
  if (event.target.closest("button")) event.preventDefault();
}
