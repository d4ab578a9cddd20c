// NumPy's Philox 4x64-10, keyed by a seed: four uniform numbers for each point. One step of its counter gives two
// points. A word of 64 bits is two numbers of 32, the lower one first.

const ROUNDS = 10;
const MULTIPLIERS = [0xe14c6c93, 0xd2e7470e, 0x95121157, 0xca5a8263].map((word) => word | 0); // two words
const WEYL = [0x7f4a7c15, 0x9e3779b9, 0x84caa73b, 0xbb67ae85].map((word) => word | 0); // two words
const TO_UNIT = 2 ** -24;

/** Draws the four numbers in [0, 1) of points, as the service does for `seed`. */
export class Philox {
  readonly #key: Int32Array;
  readonly #round = new Int32Array(4); // the key of a round
  readonly #counter = new Int32Array(8);
  readonly #products = new Int32Array(8);

  constructor(seed: bigint) {
    this.#key = new Int32Array([Number(seed & 0xffffffffn), Number((seed >> 32n) & 0xffffffffn), 0, 0]);
  }

  /** Draw the numbers of points `index` and `index` + 1, for an even index: 8 in all. */
  pair(index: number, out: Float64Array): void {
    const step = index / 2 + 1;
    const [counter, key] = [this.#counter.fill(0), this.#round];
    counter[0] = step | 0;
    counter[1] = (step / 2 ** 32) | 0;
    key.set(this.#key);
    for (let round = 0; round < ROUNDS; round++) this.#advance(counter, key);
    for (let at = 0; at < 8; at++) out[at] = (counter[at] >>> 8) * TO_UNIT;
  }

  #advance(counter: Int32Array, key: Int32Array): void {
    const products = this.#products;
    multiply(MULTIPLIERS[0], MULTIPLIERS[1], counter[0], counter[1], products, 0);
    multiply(MULTIPLIERS[2], MULTIPLIERS[3], counter[4], counter[5], products, 4);
    const [c2, c3, c6, c7] = [counter[2], counter[3], counter[6], counter[7]];
    counter[0] = products[6] ^ c2 ^ key[0];
    counter[1] = products[7] ^ c3 ^ key[1];
    counter[2] = products[4];
    counter[3] = products[5];
    counter[4] = products[2] ^ c6 ^ key[2];
    counter[5] = products[3] ^ c7 ^ key[3];
    counter[6] = products[0];
    counter[7] = products[1];
    for (const low of [0, 2]) {
      const sum = (key[low] >>> 0) + (WEYL[low] >>> 0);
      key[low] = sum | 0;
      key[low + 1] = (key[low + 1] + WEYL[low + 1] + (sum > 0xffffffff ? 1 : 0)) | 0;
    }
  }
}

/** Multiply two words of 64 bits; write the 128 bits, lowest first, to four places of `out`. */
function multiply(aLow: number, aHigh: number, bLow: number, bHigh: number, out: Int32Array, at: number): void {
  const [h00, h01, h10, h11] = [high(aLow, bLow), high(aLow, bHigh), high(aHigh, bLow), high(aHigh, bHigh)];
  const second = h00 + (Math.imul(aLow, bHigh) >>> 0) + (Math.imul(aHigh, bLow) >>> 0);
  const third = h01 + h10 + (Math.imul(aHigh, bHigh) >>> 0) + Math.floor(second / 2 ** 32);
  out[at] = Math.imul(aLow, bLow);
  out[at + 1] = second | 0;
  out[at + 2] = third | 0;
  out[at + 3] = (h11 + Math.floor(third / 2 ** 32)) | 0;
}

/** Upper 32 bits of the product of two numbers of 32 bits. */
function high(a: number, b: number): number {
  const [a0, a1, b0, b1] = [a & 0xffff, a >>> 16, b & 0xffff, b >>> 16];
  const cross = a0 * b1 + Math.floor((a0 * b0) / 2 ** 16); // below 2^48
  const middle = (cross % 2 ** 16) + a1 * b0;
  return a1 * b1 + Math.floor(cross / 2 ** 16) + Math.floor(middle / 2 ** 16);
}
