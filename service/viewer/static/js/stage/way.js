// A path on the stage: a line of round bars, and where places of the object frame are on the screen.
import { Color, CylinderGeometry, Group, Mesh, Quaternion, ShaderMaterial, SphereGeometry, Vector3 } from "three";

const RADIUS = 0.008; // of the line; the longest side of an object is 1
const UP = new Vector3(0, 1, 0);
const COLOR = new Color(0.93, 0.42, 0.08); // seen on light and on dark stages

const VERTEX = `
  varying vec3 towards;
  void main() {
    towards = normalMatrix * normal;
    gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
  }`;
const FRAGMENT = `
  uniform vec3 color;
  varying vec3 towards;
  void main() {
    gl_FragColor = vec4((0.65 + 0.35 * abs(normalize(towards).z)) * color, 1.0);
  }`;

/** Build the line through waypoints, each [x, y, z]. */
export function lineThrough(waypoints) {
  const line = new Group();
  const material = new ShaderMaterial({
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    uniforms: { color: { value: COLOR } },
  });
  const places = waypoints.map((each) => new Vector3(...each));
  places.forEach((place, index) => {
    const knot = new Mesh(new SphereGeometry(RADIUS, 12, 8), material);
    knot.position.copy(place);
    line.add(knot);
    if (!index) return;
    const along = place.clone().sub(places[index - 1]);
    const bar = new Mesh(new CylinderGeometry(RADIUS, RADIUS, along.length(), 12), material);
    bar.position.copy(place).addScaledVector(along, -0.5);
    bar.quaternion.copy(new Quaternion().setFromUnitVectors(UP, along.clone().normalize()));
    line.add(bar);
  });
  return line;
}

export function disposeLine(line) {
  line.removeFromParent();
  line.traverse((each) => {
    each.geometry?.dispose();
    each.material?.dispose();
  });
}

/** The place of a point [x, y, z] on the stage: CSS pixels from its left and its top. */
export function placeOf({ camera, canvas }, point) {
  const { x, y } = new Vector3(...point).project(camera);
  return [(0.5 + x / 2) * canvas.clientWidth, (0.5 - y / 2) * canvas.clientHeight];
}

/** A point moved on the screen by CSS pixels, right and down; its distance from the camera's plane stays. */
export function movedOnScreen({ camera, canvas }, point, right, down) {
  const projected = new Vector3(...point).project(camera);
  projected.x += (2 * right) / canvas.clientWidth;
  projected.y -= (2 * down) / canvas.clientHeight;
  return projected.unproject(camera).toArray();
}
