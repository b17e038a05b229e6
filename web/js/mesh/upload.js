/** Reads an upload's scene by the reader of its format. */

import { filesOf, find, pickMain, pictureType, unpackedFiles } from "./files.js";
import { readFbx } from "./fbx.js";
import { readGlb, readGltf } from "./glb.js";
import { readObj } from "./obj.js";
import { readPly } from "./ply.js";
import { readStl } from "./stl.js";

/** @typedef {import("./shapes.js").LocalMesh} LocalMesh */
/** @typedef {{files: import("./files.js").NamedFile[], formats: string[], main?: string}} Upload formats: suffixes, best first; main: the scene's file, if it is known */

/** @param {Upload} upload @returns {Promise<LocalMesh | null>} null if only the service can read it, which also says what is wrong with it */
export const meshOf = (upload) => readUpload(upload).catch(() => null);

/** @param {Upload} upload @returns {Promise<LocalMesh | null>} */
async function readUpload({ files: given, formats: accepted, main: chosen }) {
  const formats = accepted.filter((suffix) => suffix !== ".zip");
  let files = await filesOf(given);
  if (!chosen && !pickMain(files.names, formats)) files = await unpackedFiles(files);
  const main = chosen ?? pickMain(files.names, formats);
  if (!main) return null;
  const read = async (/** @type {string} */ reference) => {
    const name = find(files.names, reference, main);
    return name === undefined ? null : files.read(name);
  };
  /** @type {Map<Uint8Array, import("./shapes.js").Picture>} */
  const pictures = new Map(); // one object each, since parts with the same one are drawn together
  const picture = async (/** @type {string} */ reference) => {
    const [bytes, type] = [await read(reference), pictureType(reference)];
    if (!bytes || !type) return null;
    const found = pictures.get(bytes) ?? { bytes, type };
    pictures.set(bytes, found);
    return found;
  };
  const folder = main.slice(0, main.lastIndexOf("/") + 1);
  const names = files.names.filter((name) => name.startsWith(folder) && !name.slice(folder.length).includes("/")).map((name) => name.slice(folder.length));
  switch (main.slice(main.lastIndexOf(".")).toLowerCase()) {
    case ".glb":
    case ".vrm":
      return readGlb(await files.read(main));
    case ".gltf":
      return readGltf(await files.read(main), read);
    case ".fbx":
      return readFbx(await files.read(main), picture);
    case ".obj":
      return readObj(await files.read(main), { names, read, picture });
    case ".ply":
      return readPly(await files.read(main), picture);
    case ".stl":
      return readStl(await files.read(main));
    default:
      return null;
  }
}
