/** Uploaded reference pictures for comparison. */

import { inProject } from "../base/project.js";
import { getReference, getReferences, removeReference } from "./api.js";
import { Listing } from "./listing.js";
import { sendFiles } from "./upload.js";

/** @typedef {import("../base/types.js").Reference} Reference */

/** @type {Listing<Reference>} */
export const references = new Listing(getReferences);

/** Reloads the list. */
export async function loadReferences() {
  await references.load();
}

/** Returns a reference picture, which may be beyond the loaded part of the list. @param {string} id */
export async function findReference(id) {
  references.adopt(await getReference(id));
}

/**
 * @param {File} file
 * @param {AbortSignal} signal
 * @returns {Promise<Reference>}
 */
export async function addReference(file, signal) {
  const options = { progress: () => {}, signal };
  const added = /** @type {Reference} */ (await sendFiles(inProject("api/references"), "file", [{ file, path: file.name }], options));
  await loadReferences();
  return added;
}

/** @param {string} id */
export async function dropReference(id) {
  await removeReference(id);
  await loadReferences();
}
