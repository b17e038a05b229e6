/** Light that can be chosen: presets, and images that were uploaded. */

import { inProject } from "../base/project.js";
import { getEnvironments, removeEnvironment } from "./api.js";
import { Store } from "../base/store.js";
import { sendFiles } from "./upload.js";

/** @typedef {import("../base/types.js").Environment} Environment */

/** null until the service has told. @type {Store<Environment[] | null>} */
export const environments = new Store(/** @type {Environment[] | null} */ (null));

/** Asks for them anew. */
export async function loadEnvironments() {
  environments.set(await getEnvironments());
}

/**
 * @param {File} file
 * @param {{progress: (sent: number, total: number) => void, signal: AbortSignal}} options
 * @returns {Promise<Environment>}
 */
export async function addEnvironment(file, options) {
  const added = /** @type {Environment} */ (await sendFiles(inProject("api/environments"), "file", [{ file, path: file.name }], options));
  await loadEnvironments();
  return added;
}

/** @param {string} id */
export async function dropEnvironment(id) {
  await removeEnvironment(id);
  await loadEnvironments();
}
