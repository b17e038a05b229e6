/**
 * Parses the nodes of binary FBX files from version 7.0 on. Source: Blender's description of the format,
 * https://code.blender.org/2013/08/fbx-binary-file-format-specification/, with the 64-bit headers of 7.5.
 */

import { inflated } from "./files.js";

/** An array, as it is in the file. @typedef {{kind: string, count: number, isPacked: boolean, bytes: Uint8Array<ArrayBuffer>}} Packed */
/** @typedef {string | number | boolean | Uint8Array<ArrayBuffer> | Packed} Value ids, which may exceed the integers of doubles, are strings */
/** @typedef {{name: string, values: Value[], children: Node[]}} Node */

const MAGIC = "Kaydara FBX Binary";
const [HEAD_BYTES, OLDEST, WIDE] = [27, 7000, 7500];
const MOST_DEPTH = 32;
/** Array kinds by their letters, with the bytes of a value. */
const ARRAYS = /** @type {Record<string, {array: any, size: number}>} */ ({
  f: { array: Float32Array, size: 4 },
  d: { array: Float64Array, size: 8 },
  i: { array: Int32Array, size: 4 },
  l: { array: BigInt64Array, size: 8 },
  b: { array: Uint8Array, size: 1 },
});

/**
 * @param {Uint8Array<ArrayBuffer>} file
 * @returns {Node[] | null} the nodes at the top; null for text files and older versions
 */
export function nodesOf(file) {
  const view = new DataView(file.buffer, file.byteOffset, file.length); // throws a RangeError beyond the file's end
  const text = (/** @type {number} */ at, /** @type {number} */ length) => new TextDecoder().decode(file.subarray(at, at + length));
  if (file.length < HEAD_BYTES || text(0, MAGIC.length) !== MAGIC) return null;
  const version = view.getUint32(23, true);
  if (version < OLDEST) return null;
  const isWide = version >= WIDE;
  const header = isWide ? 25 : 13;
  const size = (/** @type {number} */ at) => (isWide ? Number(view.getBigUint64(at, true)) : view.getUint32(at, true));
  const step = isWide ? 8 : 4;
  /** @param {number} first @param {number} last @param {number} depth @returns {Node[]} */
  const read = (first, last, depth) => {
    const found = [];
    for (let at = first; at + header <= last; ) {
      const end = size(at);
      if (!end || depth > MOST_DEPTH) break; // an empty node ends a list
      const [count, bytes, length] = [size(at + step), size(at + 2 * step), view.getUint8(at + 3 * step)];
      const values = at + header + length;
      const children = values + bytes;
      if (children > end || end > last) throw new RangeError("a node is larger than the one around it"); // each byte is read once a level
      found.push({ name: text(at + header, length), values: valuesAt(values, count, children), children: read(children, end, depth + 1) });
      at = end;
    }
    return found;
  };
  /** @param {number} first @param {number} count @param {number} last @returns {Value[]} */
  const valuesAt = (first, count, last) => {
    let at = first;
    /** @type {Value[]} */
    const found = [];
    for (let i = 0; i < count; i++) {
      if (at >= last) throw new RangeError("cut off");
      const kind = String.fromCharCode(view.getUint8(at++));
      const number = { Y: () => view.getInt16(at, true), I: () => view.getInt32(at, true), F: () => view.getFloat32(at, true), D: () => view.getFloat64(at, true) }[kind];
      if (number) {
        found.push(number());
        at += { Y: 2, I: 4, F: 4, D: 8 }[kind] ?? 0;
      } else if (kind === "C" || kind === "B") found.push(view.getUint8(at++) !== 0);
      else if (kind === "L") {
        found.push(String(view.getBigInt64(at, true)));
        at += 8;
      } else if (kind === "S" || kind === "R") {
        const length = view.getUint32(at, true);
        if (at + 4 + length > file.length) throw new RangeError("cut off");
        found.push(kind === "S" ? text(at + 4, length) : file.subarray(at + 4, at + 4 + length));
        at += 4 + length;
      } else if (ARRAYS[kind]) {
        const [length, packing, bytes] = [view.getUint32(at, true), view.getUint32(at + 4, true), view.getUint32(at + 8, true)];
        if (at + 12 + bytes > file.length) throw new RangeError("cut off");
        found.push({ kind, count: length, isPacked: packing === 1, bytes: file.subarray(at + 12, at + 12 + bytes) });
        at += 12 + bytes;
      } else throw new RangeError("an unknown value");
    }
    return found;
  };
  return read(HEAD_BYTES, file.length, 0);
}

/** @param {Node | undefined} node @param {string} name @returns {Node | undefined} */
export const childOf = (node, name) => node?.children.find((child) => child.name === name);

/**
 * Returns the array of a child, decompressed.
 *
 * @param {Node | undefined} node
 * @param {string} name
 * @returns {Promise<any>} a typed array; null if there is none
 */
export async function arrayOf(node, name) {
  const value = childOf(node, name)?.values[0];
  if (typeof value !== "object" || !("kind" in value)) return null;
  const { array: Kind, size } = ARRAYS[value.kind] ?? { array: Uint8Array, size: 1 };
  const bytes = value.isPacked ? await inflated(new Blob([value.bytes]), "deflate", value.count * size) : value.bytes.slice();
  return new Kind(bytes.buffer, 0, value.count);
}

/** @param {Node | undefined} node @returns {Map<string, Value[]>} its properties by name */
export function propertiesOf(node) {
  const found = new Map();
  for (const { values } of childOf(node, "Properties70")?.children ?? []) found.set(values[0], values.slice(4));
  return found;
}
