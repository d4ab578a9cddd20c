// Where an object stands in the room. One finger moves it over its surface, two turn it and change its size.
import { MathUtils, Plane, Ray, Vector3 } from "three";

const UP = new Vector3(0, 1, 0);
const REACH = 10; // meters: fingers near the horizon point far away
const [SMALLEST, LARGEST] = [0.1, 10]; // sizes, of the real one

export class Placing {
  /** `model`: the group to move; its origin stands on the ground. */
  constructor(model) {
    this.model = model;
    this.isPlaced = false;
    this.grip = undefined; // what the fingers held last
  }

  /** Put the object on a point, its front to the visitor's eye. */
  aim(point, eye) {
    this.model.position.copy(point);
    this.model.rotation.y = Math.atan2(eye.x - point.x, eye.z - point.z);
  }

  /** Follow the fingers: of each {source, origin, direction, x, y}. */
  follow(fingers) {
    const sources = fingers.slice(0, 2).map(({ source }) => source);
    const isSame = this.grip && sources.every((source, index) => this.grip.sources[index] === source);
    const held = sources.length === 1 ? this.#point(fingers[0]) : sources.length === 2 ? spread(...fingers) : undefined;
    if (isSame && held && this.grip.sources.length === sources.length) {
      if (sources.length === 1) this.model.position.add(held.clone().sub(this.grip.held));
      else this.#turn(held, this.grip.held);
    }
    this.grip = held && { sources, held };
  }

  /** The point of the object's surface that a finger is on; undefined beside it. */
  #point({ origin, direction }) {
    const ground = new Plane(UP, -this.model.position.y);
    const point = new Ray(origin, direction).intersectPlane(ground, new Vector3());
    return point && point.distanceTo(origin) < REACH ? point : undefined;
  }

  #turn({ angle, length }, before) {
    this.model.rotation.y += angle - before.angle;
    this.model.scale.setScalar(MathUtils.clamp((this.model.scale.x * length) / before.length, SMALLEST, LARGEST));
  }
}

/** The line between two fingers, as the visitor sees it: its angle, radians, and its length. */
function spread(first, second) {
  const [x, y] = [second.x - first.x, second.y - first.y];
  return { angle: Math.atan2(y, x), length: Math.max(Math.hypot(x, y), 1e-3) };
}
