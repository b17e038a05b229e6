/** Files of a drop or a picker, each with its relative path, by which a scene finds its textures. */

import { t } from "../base/words.js";

/** @typedef {{file: File, path: string}} NamedFile */

/** More files than this are probably a home folder. */
const MAX_FILES = 5000;

class TooManyFiles extends Error {
  constructor() {
    super(t("That folder holds more than {most} files. Drop the scene's own folder, or a zip of it.", { most: MAX_FILES }));
  }
}

/**
 * Returns the files of a drop, including those in folders. Must be called in the drop event, after which the browser clears the
 * list.
 *
 * @param {DataTransfer} transfer
 * @returns {Promise<NamedFile[]>}
 */
export async function filesOfDrop(transfer) {
  const entries = [...transfer.items].filter((item) => item.kind === "file").map((item) => item.webkitGetAsEntry());
  if (!entries.length || entries.includes(null)) return filesOfList(transfer.files);
  /** @type {NamedFile[]} */
  const found = [];
  for (const entry of entries) if (entry) await walk(entry, found);
  return found;
}

/**
 * Returns the files of `<input type=file>`, with or without `webkitdirectory`.
 *
 * @param {FileList} list
 * @returns {NamedFile[]}
 */
export function filesOfList(list) {
  if (list.length > MAX_FILES) throw new TooManyFiles();
  return [...list].map((file) => ({ file, path: file.webkitRelativePath || file.name }));
}

/**
 * @param {FileSystemEntry} entry
 * @param {NamedFile[]} found
 */
async function walk(entry, found) {
  if (entry.isFile) {
    const file = await new Promise((resolve, reject) =>
      /** @type {FileSystemFileEntry} */ (entry).file(resolve, reject),
    );
    if (found.length >= MAX_FILES) throw new TooManyFiles();
    found.push({ file, path: entry.fullPath.replace(/^\//, "") });
    return;
  }
  const reader = /** @type {FileSystemDirectoryEntry} */ (entry).createReader();
  for (;;) {
    // A reader gives a hundred entries at a time, and none when it is done.
    /** @type {FileSystemEntry[]} */
    const some = await new Promise((resolve, reject) => reader.readEntries(resolve, reject));
    if (!some.length) return;
    for (const child of some) await walk(child, found);
  }
}

/**
 * The provisional title of an upload, until the service names the scene.
 * @param {NamedFile[]} files
 */
export function titleOf(files) {
  const scene = files.find(({ path }) => /\.(glb|gltf|usd[acz]?|fbx|obj|ya?ml|dae|ply|stl|off|zip)$/i.test(path)) ?? files[0];
  if (!scene) return t("Nothing");
  return files.length > 1 ? t("{path} and {n} more", { path: scene.path, n: files.length - 1 }) : scene.path;
}

/** Returns the error message for files of unsupported types. @param {NamedFile[]} files */
export function notUploadedTitle(files) {
  const title = titleOf(files);
  return files.length > 1 ? t("{title} were not accepted", { title }) : t("{title} was not accepted", { title });
}
