// Prints the Khronos glTF validator's report on a GLB file as JSON: node validate.mjs FILE
import { readFile } from "node:fs/promises";
import { validateBytes } from "gltf-validator";

const bytes = new Uint8Array(await readFile(process.argv[2]));
console.log(JSON.stringify(await validateBytes(bytes, { format: "glb" })));
