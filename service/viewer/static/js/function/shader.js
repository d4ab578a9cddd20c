// The mapping function as a vertex shader: from the number of a point to the point, with nothing fetched but theta.
//
// The canonical points are those of the service (service/mapping/canonical.py): Philox 4x64-10, counted up, keyed by the
// seed. A float texture has the functions, one a row: two texels for each hidden unit (its weights and bias, then its
// column of the second layer), and in the end the second layer's bias.

const RANDOM = `
  uvec2 product(uint a, uint b) { // low, high
    uint a0 = a & 0xffffu, a1 = a >> 16, b0 = b & 0xffffu, b1 = b >> 16;
    uint low = a0 * b0, cross0 = a0 * b1, cross1 = a1 * b0;
    uint middle = (low >> 16) + (cross0 & 0xffffu) + (cross1 & 0xffffu);
    uint high = a1 * b1 + (cross0 >> 16) + (cross1 >> 16) + (middle >> 16);
    return uvec2((low & 0xffffu) | (middle << 16), high);
  }
  uvec4 product(uvec2 a, uvec2 b) { // 128 bits, lowest first
    uvec2 p00 = product(a.x, b.x), p01 = product(a.x, b.y), p10 = product(a.y, b.x), p11 = product(a.y, b.y);
    uint first = p00.y + p01.x;
    uint carry = uint(first < p01.x);
    uint second = first + p10.x;
    carry += uint(second < p10.x);
    uint third = p01.y + p10.y;
    uint over = uint(third < p10.y);
    uint fourth = third + p11.x;
    over += uint(fourth < p11.x);
    uint fifth = fourth + carry;
    over += uint(fifth < carry);
    return uvec4(p00.x, second, fifth, p11.y + over);
  }
  uvec2 sum(uvec2 a, uvec2 b) {
    uint low = a.x + b.x;
    return uvec2(low, a.y + b.y + uint(low < b.x));
  }
  vec4 uniforms(uint index) { // four numbers in [0, 1) of a point
    uvec2 c0 = uvec2(index / 2u + 1u, 0u), c1 = uvec2(0u), c2 = uvec2(0u), c3 = uvec2(0u);
    uvec2 k0 = seed, k1 = uvec2(0u);
    for (int round = 0; round < 10; round++) {
      uvec4 p0 = product(uvec2(0xE14C6C93u, 0xD2E7470Eu), c0);
      uvec4 p1 = product(uvec2(0x95121157u, 0xCA5A8263u), c2);
      c0 = p1.zw ^ c1 ^ k0;
      c1 = p1.xy;
      c2 = p0.zw ^ c3 ^ k1;
      c3 = p0.xy;
      k0 = sum(k0, uvec2(0x7F4A7C15u, 0x9E3779B9u));
      k1 = sum(k1, uvec2(0x84CAA73Bu, 0xBB67AE85u));
    }
    uvec4 words = (index & 1u) == 0u ? uvec4(c0, c1) : uvec4(c2, c3);
    return vec4(words >> 8) * exp2(-24.0);
  }`;

// Sine, cosine and cube root of our own: those of graphics cards are too coarse.
const DOMAINS = `
  vec2 circle(float turn) { // cosine and sine of a turn in [0, 1)
    float quarter = floor(4.0 * turn + 0.5);
    float a = (4.0 * turn - quarter) * 1.5707963267948966;
    float b = a * a;
    float s = a * (1.0 + b * (-1.0 / 6.0 + b * (1.0 / 120.0 + b * (-1.0 / 5040.0 + b / 362880.0))));
    float c = 1.0 + b * (-0.5 + b * (1.0 / 24.0 + b * (-1.0 / 720.0 + b / 40320.0)));
    int q = int(quarter) & 3;
    return q == 0 ? vec2(c, s) : q == 1 ? vec2(-s, c) : q == 2 ? vec2(-c, -s) : vec2(s, -c);
  }
  float cubeRoot(float value) {
    float root = pow(max(value, 1e-12), 1.0 / 3.0);
    return root - (root * root * root - value) / (3.0 * root * root); // a step of Newton
  }
  vec3 canonical(vec4 u) {
    if (domain == 2) return 2.0 * u.xyz - 1.0; // cube
    vec3 direction = vec3(2.0 * sqrt(u.y * (1.0 - u.y)) * circle(u.z), 1.0 - 2.0 * u.y);
    return domain == 1 ? direction : cubeRoot(u.x) * direction; // sphere, ball
  }`;

const FUNCTION = `
  vec3 apply(sampler2D functions, int row, int units, vec3 x) {
    vec3 y = vec3(0.0);
    for (int unit = 0; unit < units; unit++) {
      vec4 first = texelFetch(functions, ivec2(2 * unit, row), 0);
      vec4 second = texelFetch(functions, ivec2(2 * unit + 1, row), 0);
      y += second.xyz * max(0.0, dot(first.xyz, x) + first.w);
    }
    return y + texelFetch(functions, ivec2(2 * units, row), 0).xyz;
  }`;

/** Vertex shader; transform feedback takes `point` (object frame) and `paint` (blue, green, red as bytes). */
export const VERTEX = `#version 300 es
  precision highp float;
  precision highp int;
  precision highp sampler2D;
  uniform uint begin; // number of the first point
  uniform uvec2 seed; // low, high
  uniform int domain; // 0 ball, 1 sphere, 2 cube
  uniform sampler2D thetas;
  uniform int units;
  uniform int k;
  uniform ivec2 word[8]; // rows of each step, the last one applied first
  uniform float blend[8]; // of each step: 0 for the first row, 1 for the second
  uniform vec3 center;
  uniform float factor;
  uniform sampler2D colors;
  uniform int colorUnits; // 0 without color
  uniform int colorRows;
  uniform float colorShares[8]; // of each row
  out vec3 point;
  flat out uint paint;
  ${RANDOM}
  ${DOMAINS}
  ${FUNCTION}
  vec3 step_(int index, vec3 x) {
    if (blend[index] <= 0.0) return apply(thetas, word[index].x, units, x);
    if (blend[index] >= 1.0) return apply(thetas, word[index].y, units, x);
    return mix(apply(thetas, word[index].x, units, x), apply(thetas, word[index].y, units, x), blend[index]);
  }
  void main() {
    vec3 x = canonical(uniforms(begin + uint(gl_VertexID)));
    vec3 y = x;
    for (int index = k - 1; index >= 0; index--) y = step_(index, y);
    point = (y - center) * factor;
    vec3 color = vec3(0.0);
    for (int row = 0; row < colorRows; row++) {
      color += colorShares[row] * clamp(apply(colors, row, colorUnits, x), 0.0, 1.0);
    }
    uvec3 bytes = uvec3(255.0 * color + 0.5);
    paint = bytes.z | (bytes.y << 8) | (bytes.x << 16);
    gl_Position = vec4(0.0);
  }`;

/** Fragment shader that draws nothing: transform feedback needs one. */
export const FRAGMENT = `#version 300 es
  precision highp float;
  out vec4 color;
  void main() {
    color = vec4(0.0);
  }`;
