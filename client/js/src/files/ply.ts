// Binary PLY of points.

/** Write points, (n, 3), and their colors, (n, 3), as PLY. */
export function pointsPly(points: Float32Array, colors?: Uint8Array): Uint8Array<ArrayBuffer> {
  const n = points.length / 3;
  const properties = ["float x", "float y", "float z", ...(colors ? ["uchar red", "uchar green", "uchar blue"] : [])];
  const lines = [
    "ply",
    "format binary_little_endian 1.0",
    "comment +Y is up, the front faces +Z",
    `element vertex ${n}`,
    ...properties.map((property) => `property ${property}`),
    "end_header\n",
  ];
  const head = new TextEncoder().encode(lines.join("\n"));
  const stride = colors ? 15 : 12;
  const file = new Uint8Array(head.length + stride * n);
  file.set(head);
  const bytes = new Uint8Array(points.buffer, points.byteOffset, points.byteLength);
  for (let index = 0; index < n; index++) {
    file.set(bytes.subarray(12 * index, 12 * index + 12), head.length + stride * index);
    if (colors) file.set(colors.subarray(3 * index, 3 * index + 3), head.length + stride * index + 12);
  }
  return file;
}
