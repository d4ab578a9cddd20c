// Times points in Node: downloaded, and drawn from the downloaded weights. Prints JSON: way -> n -> milliseconds.
// node clients.mjs URL ID ROUNDS N...

import { Client, sample } from "../../client/js/dist/index.js";

const [url, id, rounds, ...sizes] = process.argv.slice(2);
const hof = new Client(url);
const ways = {
  download: (n) => hof.points(id, { n }),
  draw: async (n) => sample(await hof.functions(id), n),
};

const table = Object.fromEntries(Object.keys(ways).map((way) => [way, Object.fromEntries(sizes.map((n) => [n, []]))]));
for (const n of sizes.map(Number)) {
  for (let round = -1; round < Number(rounds); round++) {
    for (const [way, run] of Object.entries(ways)) {
      const start = performance.now();
      await run(n);
      if (round >= 0) table[way][n].push(performance.now() - start); // the first is a warm-up
    }
  }
}
console.log(JSON.stringify(table));
