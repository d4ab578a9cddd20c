// The surface of an object on the graphics card.
import { BufferAttribute, BufferGeometry, DoubleSide, Mesh, ShaderMaterial } from "three";

import { fetchBytes } from "../api.js";
import { filePath } from "../objects.js";

const VERTEX = `
  uniform float distance;
  varying float depth; // 0 nearest, 1 farthest
  varying vec3 towards; // the normal, in camera space
  #ifdef PAINTED
    attribute vec3 paint; // linear
    varying vec3 painted;
  #endif
  void main() {
    #ifdef PAINTED
      painted = paint;
    #endif
    vec4 viewed = modelViewMatrix * vec4(position, 1.0);
    depth = clamp(-viewed.z - distance + 0.5, 0.0, 1.0);
    towards = normalMatrix * normal;
    gl_Position = projectionMatrix * viewed;
  }`;
const FRAGMENT = `
  uniform vec3 near;
  uniform vec3 far;
  varying float depth;
  varying vec3 towards;
  #ifdef PAINTED
    varying vec3 painted;
  #endif
  vec3 encode(vec3 linear) { // sRGB
    return mix(12.92 * linear, 1.055 * pow(linear, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, linear));
  }
  void main() {
    vec3 normal = normalize(towards);
    normal *= normal.z < 0.0 ? -1.0 : 1.0; // both sides are lit
    float light = 0.5 + 0.18 * normal.y + 0.42 * max(0.0, dot(normal, normalize(vec3(-0.4, 0.6, 0.8))));
    float shine = 0.07 * pow(max(0.0, dot(normal, normalize(vec3(-0.3, 0.5, 1.3)))), 12.0); // shows what is black, too
    #ifdef PAINTED
      gl_FragColor = vec4(encode(1.15 * light * painted) + shine, 1.0);
    #else
      gl_FragColor = vec4(light * mix(near, far, 0.6 * depth), 1.0);
    #endif
  }`;

/** Materials of surfaces, {shaded, painted}; they share the uniforms of the points. */
export function surfaceMaterials(uniforms) {
  const material = (defines) =>
    new ShaderMaterial({ vertexShader: VERTEX, fragmentShader: FRAGMENT, uniforms, defines, side: DoubleSide });
  return { shaded: material({}), painted: material({ PAINTED: "" }) };
}

/** Fetch the surface of an object, colored if the object is, as a Mesh; the cloud chooses its material. */
export async function fetchSurface(object, signal) {
  const bytes = await fetchBytes(filePath(object, "mesh", { format: "glb" }), signal);
  const { positions, normals, colors, indices } = readGlb(bytes);
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(positions, 3));
  geometry.setAttribute("normal", new BufferAttribute(normals, 3));
  if (colors) geometry.setAttribute("paint", new BufferAttribute(colors, 3));
  geometry.setIndex(new BufferAttribute(indices, 1));
  const mesh = new Mesh(geometry);
  mesh.triangles = indices.length / 3;
  mesh.frustumCulled = false; // always in view: an object fills the object frame
  return mesh;
}

/** Read the arrays of a GLB of the service: one primitive, one buffer, nothing interleaved. */
function readGlb(bytes) {
  const jsonBytes = new DataView(bytes).getUint32(12, true);
  const document = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 20, jsonBytes)));
  const [{ attributes, indices }] = document.meshes[0].primitives;
  const array = (Type, index) => {
    const { byteOffset, byteLength } = document.bufferViews[document.accessors[index].bufferView];
    return new Type(bytes, 20 + jsonBytes + 8 + byteOffset, byteLength / Type.BYTES_PER_ELEMENT);
  };
  return {
    positions: array(Float32Array, attributes.POSITION),
    normals: array(Float32Array, attributes.NORMAL),
    colors: "COLOR_0" in attributes ? array(Float32Array, attributes.COLOR_0) : undefined,
    indices: array(Uint32Array, indices),
  };
}
