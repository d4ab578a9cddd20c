// Materials of points: discs, shaded like small balls.
import { ShaderMaterial } from "three";

const DIMMEST = 0.8; // brightness of the farthest points, as a share of their color

const VERTEX = `
  uniform float size;
  uniform float distance;
  varying float depth; // 0 nearest, 1 farthest
  #ifdef PAINTED
    attribute vec3 bgr; // sRGB
    varying vec3 paint;
  #endif
  void main() {
    #ifdef PAINTED
      paint = bgr.bgr;
    #endif
    vec4 viewed = modelViewMatrix * vec4(position, 1.0);
    depth = clamp(-viewed.z - distance + 0.5, 0.0, 1.0);
    gl_Position = projectionMatrix * viewed;
    gl_PointSize = max(1.0, size * distance / -viewed.z);
  }`;
const FRAGMENT = `
  uniform vec3 near;
  uniform vec3 far;
  varying float depth;
  #ifdef PAINTED
    varying vec3 paint;
  #endif
  void main() {
    vec2 across = 2.0 * gl_PointCoord - 1.0;
    float radius = dot(across, across);
    if (radius > 1.0) discard;
    float light = 1.0 - 0.22 * radius - 0.1 * across.y; // from above
    #ifdef PAINTED
      gl_FragColor = vec4(light * mix(1.0, DIMMEST, depth) * paint + 0.05 * (1.0 - radius), 1.0);
    #else
      gl_FragColor = vec4(light * mix(near, far, depth), 1.0);
    #endif
  }`;

/** Materials of points, {shaded, painted}; `painted` is for objects with color. Colors are sRGB throughout. */
export function pointMaterials(uniforms) {
  const material = (defines) =>
    new ShaderMaterial({ vertexShader: VERTEX, fragmentShader: FRAGMENT, uniforms, defines });
  return { shaded: material({}), painted: material({ PAINTED: "", DIMMEST }) };
}
