// What stands in the room: the object on its lowest point, its shadow, and the ring around its place.
import { Color, DoubleSide, Group, Mesh, MeshBasicMaterial, MeshStandardMaterial, RingGeometry } from "three";

import { shadowOf } from "../../stage/ground.js";

const GRAY = new Color(0.5, 0.5, 0.53); // linear: that of the files (service/formats/mesh/gltf.py)
const RING = [0.95, 1]; // radii of the ring, shares
const HEIGHT = 0.002; // of the ring above the ground, meters

/** An object and its shadow; its longest side is one meter, as in the files that other apps open. */
export function modelOf(surface, object, inColor) {
  const { geometry } = surface;
  const isPainted = Boolean(inColor && object.color && geometry.hasAttribute("paint"));
  if (isPainted) geometry.setAttribute("color", geometry.getAttribute("paint"));
  const color = isPainted ? "white" : GRAY;
  const material = new MeshStandardMaterial({ roughness: 1, side: DoubleSide, vertexColors: isPainted, color });
  const { min, size } = extentOf(geometry);
  const [mesh, shadow] = [new Mesh(geometry, material), shadowOf(size)];
  mesh.frustumCulled = false;
  mesh.position.y = -min.y;
  shadow.position.y = HEIGHT;
  return new Group().add(mesh, shadow);
}

/** A ring on the ground around an object. */
export function ringOf({ geometry }) {
  const [width, , depth] = extentOf(geometry).size;
  const radii = RING.map((share) => share * 0.6 * Math.hypot(width, depth));
  const ring = new Mesh(new RingGeometry(...radii, 64), new MeshBasicMaterial({ color: "white" }));
  ring.geometry.rotateX(-Math.PI / 2);
  ring.geometry.translate(0, HEIGHT, 0);
  return ring;
}

function extentOf(geometry) {
  geometry.computeBoundingBox();
  const { min, max } = geometry.boundingBox;
  return { min, size: max.clone().sub(min).toArray() };
}
