// A soft shadow on the ground under an object.
import { Mesh, PlaneGeometry, ShaderMaterial } from "three";

const SPREAD = 1.7; // side of the shadow, relative to the object's

const VERTEX = `
  varying vec2 place;
  void main() {
    place = 2.0 * uv - 1.0;
    gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
  }`;
const FRAGMENT = `
  varying vec2 place;
  void main() {
    float fade = smoothstep(1.0, 0.1, length(place));
    gl_FragColor = vec4(0.0, 0.0, 0.0, 0.3 * fade * fade);
  }`;

/** The shadow of an object with these dimensions: [width, height, depth]. */
export function shadowOf([width, height, depth]) {
  const material = new ShaderMaterial({
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    transparent: true,
    depthWrite: false,
  });
  const shadow = new Mesh(new PlaneGeometry(SPREAD * Math.max(width, 0.2), SPREAD * Math.max(depth, 0.2)), material);
  shadow.rotation.x = -Math.PI / 2;
  shadow.position.y = -height / 2 - 0.005;
  return shadow;
}
