// The metadata of an encoder's ONNX file, which onnxruntime-web does not tell: field 14 of the ModelProto.

import type { Spec } from "../function/weights.js";

/** What an encoder's file tells of itself. */
export interface Metadata {
  name: string;
  spec: Spec;
  colorSpec?: Spec;
  /** Side of the input, pixels, and the share of it that the object's longer side takes. */
  framing: { size: number; foreground_ratio: number };
}

const METADATA_PROPS = 14; // of ModelProto; in each, field 1 is the key and field 2 the value
const [VARINT, FIXED64, BYTES, FIXED32] = [0, 1, 2, 5]; // protobuf's wire types

/** Read the metadata of an encoder's file. Throws if it is no encoder of ours. */
export function readMetadata(model: Uint8Array): Metadata {
  const texts = new Map<string, string>();
  for (const [field, bytes] of fieldsOf(model)) {
    if (field !== METADATA_PROPS) continue;
    const entry = new Map(fieldsOf(bytes));
    texts.set(textOf(entry.get(1)), textOf(entry.get(2)));
  }
  const json = (key: string) => {
    const text = texts.get(key);
    if (text === undefined) throw new Error(`the model's metadata lacks ${key}: export it with \`hof-model export\``);
    return JSON.parse(text);
  };
  return {
    name: json("hof.card").name,
    spec: json("hof.spec"),
    ...(texts.has("hof.color_spec") && { colorSpec: json("hof.color_spec") }),
    framing: json("hof.framing"),
  };
}

function textOf(bytes: Uint8Array | undefined): string {
  return new TextDecoder().decode(bytes);
}

/** Yield the fields of a protobuf message that are bytes: number and content. */
function* fieldsOf(message: Uint8Array): Generator<[number, Uint8Array]> {
  let at = 0;
  const varint = () => {
    let [value, factor] = [0, 1];
    for (;;) {
      if (at >= message.length) throw new Error("the model is no ONNX file, or it is damaged");
      const byte = message[at++];
      value += (byte & 0x7f) * factor;
      if (byte < 0x80) return value;
      factor *= 128;
    }
  };
  while (at < message.length) {
    const tag = varint();
    const kind = tag % 8;
    if (kind === VARINT) varint();
    else if (kind === FIXED64) at += 8;
    else if (kind === FIXED32) at += 4;
    else if (kind === BYTES) {
      const length = varint();
      if (at + length > message.length) throw new Error("the model is no ONNX file, or it is damaged");
      yield [Math.floor(tag / 8), message.subarray(at, (at += length))];
    } else throw new Error("the model is no ONNX file, or it is damaged");
  }
}
