/** Pictures that were uploaded to compare with. */

import { inProject } from "../base/project.js";
import { getReferences, removeReference } from "./api.js";
import { Store } from "../base/store.js";
import { sendFiles } from "./upload.js";

/** @typedef {import("../base/types.js").Reference} Reference */

/** null until the service has told. @type {Store<Reference[] | null>} */
export const references = new Store(/** @type {Reference[] | null} */ (null));

/** Asks for them anew. */
export async function loadReferences() {
  references.set(await getReferences());
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
