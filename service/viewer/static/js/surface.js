// An object's surface, on the graphics card.
import { BufferAttribute, BufferGeometry, DoubleSide, Mesh, ShaderMaterial } from "three";

import { fetchBytes, filePath } from "./api.js";

const VERTEX = `
  uniform float distance;
  varying float depth; // 0 nearest, 1 farthest
  varying vec3 towards; // the normal, seen from the camera
  #ifdef PAINTED
    attribute vec3 paint; // linear
    varying vec3 painted;
  #endif
  void main() {
    #ifdef PAINTED
      painted = paint;
    #endif
    vec4 seen = modelViewMatrix * vec4(position, 1.0);
    depth = clamp(-seen.z - distance + 0.5, 0.0, 1.0);
    towards = normalMatrix * normal;
    gl_Position = projectionMatrix * seen;
  }`;
const FRAGMENT = `
  uniform vec3 near;
  uniform vec3 far;
  varying float depth;
  varying vec3 towards;
  #ifdef PAINTED
    varying vec3 painted;
  #endif
  void main() {
    float light = 0.25 + 0.75 * abs(normalize(towards).z); // a lamp at the camera; layers have two sides
    #ifdef PAINTED
      gl_FragColor = linearToOutputTexel(vec4(light * painted, 1.0));
    #else
      gl_FragColor = vec4(mix(far, mix(near, far, depth), light), 1.0);
    #endif
  }`;

/** What surfaces are shaded with, and what paints those in color; they share the uniforms of the points. */
export function surfaceMaterials(uniforms) {
  const material = (defines) =>
    new ShaderMaterial({ vertexShader: VERTEX, fragmentShader: FRAGMENT, uniforms, defines, side: DoubleSide });
  return { shaded: material({}), painted: material({ PAINTED: "" }) };
}

/** Fetch the surface of an object, with its colors if it has any, as a Mesh; its material is the cloud's to choose. */
export async function fetchSurface(object, signal) {
  const bytes = await fetchBytes(filePath(object, "mesh", { format: "glb" }), signal);
  const { positions, normals, colors, indices } = readGlb(bytes);
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(positions, 3));
  geometry.setAttribute("normal", new BufferAttribute(normals, 3));
  if (colors) geometry.setAttribute("paint", new BufferAttribute(colors, 3));
  geometry.setIndex(new BufferAttribute(indices, 1));
  const mesh = new Mesh(geometry);
  mesh.frustumCulled = false; // its bounds are those of the object frame
  return mesh;
}

/** The arrays of a GLB as the service writes it: one primitive, one buffer, nothing interleaved. */
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
