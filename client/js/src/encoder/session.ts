// An ONNX file in onnxruntime-web.

import * as ort from "onnxruntime-web/wasm";

/** Where onnxruntime-web finds its code. */
export interface Runtime {
  /** Address of ort-wasm-simd-threaded.wasm, unless it is beside. */
  wasm?: string;
}

/** Open a model on one thread. */
export function openSession(model: Uint8Array, { wasm }: Runtime): Promise<ort.InferenceSession> {
  ort.env.wasm.numThreads = 1; // more need a page that is isolated from other origins
  if (wasm !== undefined) ort.env.wasm.wasmPaths = { wasm };
  return ort.InferenceSession.create(model);
}
