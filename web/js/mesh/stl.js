/** Reads STL files, binary and text, for a preview. The attributes of binary files, which may be colours, are left to the service. */

import { Scanner, growingFloats } from "./text.js";
import { GREY, modelOf } from "./model.js";

const [HEAD, ROW] = [84, 50];

/**
 * @param {Uint8Array<ArrayBuffer>} file
 * @param {number} [most] triangles, about
 * @returns {import("./shapes.js").LocalMesh | null} null if the file is damaged
 */
export function readStl(file, most) {
  const positions = isBinary(file) ? binaryCorners(file) : textCorners(file);
  if (!positions || positions.length % 9) return null;
  const indices = new Uint32Array(positions.length / 3);
  for (let i = 0; i < indices.length; i++) indices[i] = i;
  return modelOf([{ shape: { positions, normals: null, uvs: null, indices }, color: GREY, image: null }], "z", false, most);
}

/** @param {Uint8Array<ArrayBuffer>} file */
const countIn = ({ buffer, byteOffset, length }) => (length < HEAD ? 0 : new DataView(buffer, byteOffset).getUint32(80, true));

/** Returns whether a file is binary: also binary files may begin with "solid". @param {Uint8Array<ArrayBuffer>} file */
function isBinary(file) {
  if (file.length === HEAD + ROW * countIn(file)) return true;
  const text = new TextDecoder().decode(file.subarray(0, 200)).trimStart();
  return file.length >= HEAD && !(text.slice(0, 5).toLowerCase() === "solid" && !file.subarray(0, 512).includes(0));
}

/** @param {Uint8Array<ArrayBuffer>} file @returns {Float32Array | null} null: cut off */
function binaryCorners(file) {
  const there = Math.floor((file.length - HEAD) / ROW);
  const count = countIn(file) || there;
  if (count > there) return null;
  const view = new DataView(file.buffer, file.byteOffset);
  const found = new Float32Array(9 * count);
  for (let i = 0, at = HEAD + 12; i < count; i++, at += ROW) for (let k = 0; k < 9; k++) found[9 * i + k] = view.getFloat32(at + 4 * k, true);
  return found;
}

const [LOWER_V, LOWER_E] = [118, 101];

/** @param {Uint8Array<ArrayBuffer>} file */
function textCorners(file) {
  const text = new Scanner(file);
  const found = growingFloats();
  while (text.next()) {
    const lower = (file[text.at] ?? 0) | 32;
    if (lower === LOWER_V && ((file[text.at + 1] ?? 0) | 32) === LOWER_E) {
      text.at += "vertex".length;
      for (let k = 0; k < 3; k++) if (text.nextInLine()) found.push(text.number());
    }
    text.endLine();
  }
  return found.whole;
}
