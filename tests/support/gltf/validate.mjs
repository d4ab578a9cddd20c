// Prints the Khronos glTF validator's report on a GLB or glTF file as JSON: node validate.mjs FILE
import { readFile } from "node:fs/promises";
import { validateBytes } from "gltf-validator";

const bytes = new Uint8Array(await readFile(process.argv[2]));
const format = bytes[0] === "{".charCodeAt(0) ? "gltf" : "glb";
console.log(JSON.stringify(await validateBytes(bytes, { format })));
