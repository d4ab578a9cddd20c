// The triangles that an object's function stretched across gaps, which pictures leave out.

const LONGEST_EDGE = 4; // in medians; longer triangles span gaps, such as those between the legs of a chair

/**
 * Return the triangles (`indices` of vertices, three each) without the long ones. Plain loops: there are 80,000, and a
 * visitor waits.
 */
export function withoutLong(positions, indices) {
  const edges = new Float32Array(indices.length / 3); // the longest of each, squared
  for (let triangle = 0; triangle < edges.length; triangle++) {
    const [a, b, c] = [3 * indices[3 * triangle], 3 * indices[3 * triangle + 1], 3 * indices[3 * triangle + 2]];
    const [ab, bc] = [squaredDistance(positions, a, b), squaredDistance(positions, b, c)];
    edges[triangle] = Math.max(ab, bc, squaredDistance(positions, c, a));
  }
  const longest = LONGEST_EDGE ** 2 * edges.slice().sort()[Math.floor(edges.length / 2)];
  const kept = new Uint32Array(indices.length);
  let count = 0;
  for (let at = 0; at < indices.length; at++) {
    if (edges[Math.floor(at / 3)] <= longest) kept[count++] = indices[at];
  }
  return kept.subarray(0, count);
}

function squaredDistance(positions, a, b) {
  const x = positions[a] - positions[b];
  const y = positions[a + 1] - positions[b + 1];
  const z = positions[a + 2] - positions[b + 2];
  return x * x + y * y + z * z;
}
